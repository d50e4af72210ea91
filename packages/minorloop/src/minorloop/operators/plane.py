"""Levels and cells of the Preisach plane; weights and Everett values.

Cell (i, j), j <= i, covers alpha in [levels[i], levels[i + 1]] and beta in
[levels[j], levels[j + 1]]; cells on the diagonal are triangles. ``weights[i, j]`` is the
integral of the density over the cell. ``nodes[a, b]``, b <= a, is the integral over the
triangle levels[b] <= beta <= alpha <= levels[a].
"""

from collections.abc import Callable
from typing import Literal, TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, IntArray, Levels
from minorloop.errors import ParameterError

Density = Callable[[FloatArray, FloatArray], npt.ArrayLike]
Relay: TypeAlias = Literal["bipolar", "unipolar"]
RELAYS: tuple[Relay, ...] = get_args(Relay)
"""Whether the output of a relay is -1 or +1, or 0 or 1."""

_QUADRATURE_ORDER = 8
"""Quadrature that is exact for polynomials up to degree 15 in each cell, for densities that change
much within a cell."""


def swing(relay: Relay) -> float:
    """Return the output change of a relay of unit weight that switches: 2, or 1 if unipolar."""
    return 2.0 if relay == "bipolar" else 1.0


def off_output(relay: Relay) -> float:
    """Return the output of a relay of unit weight that is off: -1, or 0 if unipolar."""
    return 1.0 - swing(relay)


def relay_outputs(relay: Relay, on: FloatArray) -> FloatArray:
    """Return the mean output of relays of unit weight, of which the share ``on``, 0 to 1, is on."""
    return off_output(relay) + swing(relay) * on


def nodes_from_weights(weights: FloatArray) -> FloatArray:
    """Return the Everett values at the nodes from cell weights.

    ``nodes[a, b]``, (L + 1, L + 1), is the sum of the cells i < a, j >= b.

    ``weights`` (L, L): cell weights in the lower triangle, in the unit of the output.
    """
    bands = len(weights)
    nodes = np.zeros((bands + 1, bands + 1))
    nodes[1:, :-1] = np.cumsum(np.cumsum(weights, axis=0)[:, ::-1], axis=1)[:, ::-1]
    return np.tril(nodes, -1)


def weights_from_nodes(nodes: FloatArray) -> FloatArray:
    """(L, L) cell weights from Everett values at the nodes, their mixed differences.

    ``nodes`` (L + 1, L + 1): Everett values; the upper triangle and the diagonal are zero.
    """
    lower = np.tril(nodes, -1)
    return np.tril(lower[1:, :-1] - lower[:-1, :-1] - lower[1:, 1:] + lower[:-1, 1:])


def cell_areas(levels: Levels) -> FloatArray:
    """Return the area of each cell, (L, L), zero above the diagonal; unit of the input squared."""
    heights = np.diff(levels)
    areas = np.tril(np.outer(heights, heights))
    areas[np.diag_indices_from(areas)] /= 2
    return areas


def integrate_density(levels: Levels, density: Density) -> FloatArray:
    """(L, L) cell weights of a density, by Gauss-Legendre quadrature of order 8 per axis.

    Raises a `ParameterError` if the density is not finite somewhere on the plane.

    ``levels`` (L + 1,): thresholds; ``density``: ``density(alpha, beta)``, vectorised over equal
    shapes, unit of the output per squared unit of the input.
    """
    x, w = np.polynomial.legendre.leggauss(_QUADRATURE_ORDER)
    x, w = (x + 1) / 2, w / 2
    lower, heights = levels[:-1], np.diff(levels)
    points = lower[:, None] + heights[:, None] * x
    i, j = np.tril_indices(len(heights), -1)
    weights = np.zeros((len(heights), len(heights)))
    if i.size:
        alpha = np.broadcast_to(points[i][:, :, None], (i.size, x.size, x.size))
        beta = np.broadcast_to(points[j][:, None, :], alpha.shape)
        square = np.einsum("kab,a,b->k", _evaluate(density, alpha, beta), w, w)
        weights[i, j] = square * heights[i] * heights[j]
    # Collapsed coordinates map a unit square onto the triangle beta <= alpha of a band.
    alpha = lower[:, None, None] + heights[:, None, None] * np.broadcast_to(
        x[:, None], (len(heights), x.size, x.size)
    )
    beta = lower[:, None, None] + (alpha - lower[:, None, None]) * x
    triangle = np.einsum("kab,a,b->k", _evaluate(density, alpha, beta), w * x, w)
    weights[np.diag_indices_from(weights)] = triangle * heights**2
    return weights


def _evaluate(density: Density, alpha: FloatArray, beta: FloatArray) -> FloatArray:
    values = np.asarray(density(np.ascontiguousarray(alpha), np.ascontiguousarray(beta)))
    values = np.broadcast_to(values.astype(np.float64), alpha.shape)
    if not np.isfinite(values).all():
        where = tuple(np.argwhere(~np.isfinite(values))[0])
        raise ParameterError(
            f"density is {values[where]} at alpha {alpha[where]}, beta {beta[where]}; "
            "it must be finite on the whole plane"
        )
    return values


def slack(levels: Levels, weights: FloatArray, slope: float, swing: float, bow: bool) -> float:
    """Return the smallest slope dy/du over all branches of all histories, in output per input.

    It is negative if the model is not monotone. The slope of a rising branch is the integral of the
    density along a part of a row of the plane. It changes linearly within a cell, so that only the
    ends of cells are compared. Falling branches move along columns.
    """
    heights = np.diff(levels)
    diagonal = np.diag(weights)
    ends = np.stack([0 * diagonal, 2 * diagonal]) if bow else diagonal[None]
    strict = np.tril(weights, -1)
    # Row i over columns j..i-1 and column j over rows j+1..i, for every j.
    rows = np.cumsum(strict[:, ::-1], axis=1).min(axis=1)
    columns = np.cumsum(strict, axis=0).min(axis=0)
    swept = np.minimum(np.minimum(rows, columns), 0.0) + ends.min(axis=0)
    return float(np.min(slope + swing * swept / heights))


def extremes(
    levels: Levels, weights: FloatArray, slope: float, swing: float
) -> tuple[float, float]:
    """Return the least and greatest of slope*u plus the switched-on weight times ``swing``.

    It compares all memories whose extrema are thresholds. The switched-on region is a staircase
    that falls from left to right and ends at the present input. Dynamic programming adds columns
    from the diagonal outwards and keeps the best staircase of each height.
    """
    low = _best_staircase(levels, -swing * weights, -slope)
    return -low, _best_staircase(levels, swing * weights, slope)


def _best_staircase(levels: Levels, weights: FloatArray, slope: float) -> float:
    bands = len(weights)
    best = np.full(bands + 1, -np.inf)  # best total so far, by height of the staircase
    best[bands] = slope * levels[bands]
    for j in range(bands - 1, -1, -1):
        column = np.concatenate([[0.0], np.cumsum(weights[:, j])])
        best = np.maximum.accumulate(best) + column
        best[:j] = -np.inf
        best[j] = slope * levels[j]  # staircases that begin here: the present input
    return float(np.max(best))


def buckets(levels: FloatArray) -> tuple[IntArray, float]:
    """Return the last band that begins before each of 4 L equal slices, and slices per unit.

    The slice of a threshold is computed with the same arithmetic as that of an input in the
    kernel, so that rounding cannot separate the two.
    """
    count = 4 * (levels.size - 1)
    per_unit = count / (levels[-1] - levels[0])
    slices = ((levels[:-1] - levels[0]) * per_unit).astype(np.int64)
    begun = np.searchsorted(slices, np.arange(count + 3), side="left") - 1
    return np.maximum(begun, 0), per_unit
