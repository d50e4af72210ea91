"""Levels and cells of the Preisach plane; weights and Everett values.

Cell (i, j), j <= i, covers alpha in [levels[i], levels[i + 1]] and beta in
[levels[j], levels[j + 1]]; cells on the diagonal are triangles. ``weights[i, j]`` is the
integral of the density over the cell. ``nodes[a, b]``, b <= a, is the integral over the
triangle levels[b] <= beta <= alpha <= levels[a].
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, IntArray, Levels
from minorloop.errors import ParameterError

Density = Callable[[FloatArray, FloatArray], npt.ArrayLike]
Relay: TypeAlias = Literal["bipolar", "unipolar"]
"""Whether a relay gives -1 and +1, or 0 and 1."""

_QUADRATURE_ORDER = 8


def swing(relay: Relay) -> float:
    """Output change of a relay of unit weight that switches.

    Parameters
    ----------
    relay : {"bipolar", "unipolar"}
        Whether it gives -1 and +1, or 0 and 1.
    """
    return 2.0 if relay == "bipolar" else 1.0


def off_output(relay: Relay) -> float:
    """Output of a relay of unit weight that is off: -1 or 0.

    Parameters
    ----------
    relay : {"bipolar", "unipolar"}
        Whether it gives -1 and +1, or 0 and 1.
    """
    return 1.0 - swing(relay)


def relay_outputs(relay: Relay, on: FloatArray) -> FloatArray:
    """Mean output of relays of unit weight of which a share is on.

    Parameters
    ----------
    relay : {"bipolar", "unipolar"}
        Whether a relay gives -1 and +1, or 0 and 1.
    on : array
        Shares, from 0 to 1.
    """
    return off_output(relay) + swing(relay) * on


def nodes_from_weights(weights: FloatArray) -> FloatArray:
    """Everett values at the nodes from cell weights.

    Parameters
    ----------
    weights : (L, L) array
        Lower triangle: cell weights, in the unit of the output.

    Returns
    -------
    (L + 1, L + 1) array
        ``nodes[a, b]``: sum of the cells i < a, j >= b.
    """
    bands = len(weights)
    nodes = np.zeros((bands + 1, bands + 1))
    nodes[1:, :-1] = np.cumsum(np.cumsum(weights, axis=0)[:, ::-1], axis=1)[:, ::-1]
    return np.tril(nodes, -1)


def weights_from_nodes(nodes: FloatArray) -> FloatArray:
    """Cell weights from Everett values at the nodes: their mixed differences.

    Parameters
    ----------
    nodes : (L + 1, L + 1) array
        Everett values; the upper triangle and the diagonal are zero.

    Returns
    -------
    (L, L) array
    """
    lower = np.tril(nodes, -1)
    return np.tril(lower[1:, :-1] - lower[:-1, :-1] - lower[1:, 1:] + lower[:-1, 1:])


def cell_areas(levels: Levels) -> FloatArray:
    """Area of each cell, (L, L), zero above the diagonal; unit of the input squared."""
    heights = np.diff(levels)
    areas = np.tril(np.outer(heights, heights))
    areas[np.diag_indices_from(areas)] /= 2
    return areas


def integrate_density(levels: Levels, density: Density) -> FloatArray:
    """Cell weights of a density, by Gauss-Legendre quadrature of order 8 a side.

    Parameters
    ----------
    levels : (L + 1,) array
        Thresholds.
    density : callable
        ``density(alpha, beta)``, vectorised over equal shapes, output unit per input unit
        squared.

    Returns
    -------
    (L, L) array

    Raises
    ------
    ParameterError
        If the density is not finite somewhere on the plane.
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
    # Collapsed coordinates take a unit square onto the triangle beta <= alpha of a band.
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
    """Smallest rate dy/du over every branch of every history, in output per input.

    Negative where the model is not monotone. On a rising branch the rate is the integral of
    the density along the row it moves, which is linear along every piece; so it is enough to
    look at the ends of the pieces, and the same along columns for falling branches.
    """
    heights = np.diff(levels)
    diagonal = np.diag(weights)
    ends = np.stack([0 * diagonal, 2 * diagonal]) if bow else diagonal[None]
    strict = np.tril(weights, -1)
    # Row i over columns j..i-1 and column j over rows j+1..i, whichever part is swept.
    rows = np.cumsum(strict[:, ::-1], axis=1).min(axis=1)
    columns = np.cumsum(strict, axis=0).min(axis=0)
    swept = np.minimum(np.minimum(rows, columns), 0.0) + ends.min(axis=0)
    return float(np.min(slope + swing * swept / heights))


def extremes(
    levels: Levels, weights: FloatArray, slope: float, swing: float
) -> tuple[float, float]:
    """Least and greatest of slope*u plus the switched-on weight times ``swing``.

    Over every memory whose extrema are thresholds. The switched-on region is a staircase that
    falls from left to right and ends at the present input; columns are added from the
    diagonal outwards, keeping the best staircase for each height.
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
    """For each of 4 L equal slices, the last band begun before it; and slices per unit.

    Which slice a threshold is in is worked out as the kernel does it for an input, so that
    rounding cannot put the two on different sides of an edge.
    """
    count = 4 * (levels.size - 1)
    per_unit = count / (levels[-1] - levels[0])
    slices = ((levels[:-1] - levels[0]) * per_unit).astype(np.int64)
    begun = np.searchsorted(slices, np.arange(count + 3), side="left") - 1
    return np.maximum(begun, 0), per_unit
