"""One-sided dead zones: a memoryless, piecewise linear and monotone curve through the origin.

Placed after symmetric plays it bends their loops into saturating, asymmetric ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from minorloop.arrays import (
    ByValue,
    FloatArray,
    frozen,
)
from minorloop.errors import NotInvertibleError, ParameterError


@dataclass(frozen=True, eq=False)
class DeadZones(ByValue):
    """A weighted sum of one-sided dead zones.

    ``S(x) = sum of weights[k] * d_k(x)``, where ``d_k(x)`` is ``max(x - s, 0)`` for a threshold
    s > 0, ``min(x - s, 0)`` for s < 0, and ``x`` for s = 0.

    Raises
    ------
    ParameterError
        If there is no threshold, they do not increase, lengths differ, or a number is not finite.

    References
    ----------
    Kuhnen, European Journal of Control 9 (2003) 407: superposition operators.
    """

    thresholds: FloatArray
    """Shape (K,). Strictly increasing, in the unit of x; a zero among them is the linear term."""
    weights: FloatArray
    """Shape (K,). Change of slope at each threshold, away from the origin; for threshold zero the
    slope at the origin."""

    def __post_init__(self) -> None:
        thresholds, weights = as_paired(self.thresholds, self.weights, name="thresholds")
        object.__setattr__(self, "thresholds", thresholds)
        object.__setattr__(self, "weights", weights)

    @classmethod
    def from_slopes(cls, knots: npt.ArrayLike, slopes: npt.ArrayLike) -> DeadZones:
        """Return dead zones from the slope of each piece.

        Raises a `ParameterError` if a knot is zero or the lengths differ.

        Parameters
        ----------
        knots : (K,) array_like
            Where the slope changes, strictly increasing, none of them zero; may be empty.
        slopes : (K + 1,) array_like
            Slope of each piece, from left to right.
        """
        knots, slopes = np.asarray(knots, dtype=np.float64), np.asarray(slopes, dtype=np.float64)
        if knots.ndim != 1 or slopes.shape != (knots.size + 1,):
            raise ParameterError(
                f"slopes have shape {slopes.shape}; {knots.size} knots need ({knots.size + 1},)"
            )
        if (knots == 0).any():
            raise ParameterError("a knot is zero; the piece through the origin must be straight")
        centre = int(np.count_nonzero(knots < 0))
        below = slopes[:centre] - slopes[1 : centre + 1]
        above = np.diff(slopes[centre:])
        thresholds = np.insert(knots, centre, 0.0)
        return cls(thresholds, np.concatenate([below, slopes[centre : centre + 1], above]))

    @cached_property
    def knots(self) -> FloatArray:
        """Points where the slope changes: the thresholds without zero."""
        return frozen(self.thresholds[self.thresholds != 0])

    @cached_property
    def slopes(self) -> FloatArray:
        """Slope of each piece, one more than knots."""
        negative, positive = self.thresholds < 0, self.thresholds > 0
        straight = self.weights[~(negative | positive)].sum()
        below = straight + np.cumsum(self.weights[negative][::-1])[::-1]
        above = straight + np.cumsum(self.weights[positive])
        return frozen(np.concatenate([below, [straight], above]))

    @property
    def invertible(self) -> bool:
        """Whether every piece rises."""
        return bool((self.slopes > 0).all())

    def __call__(self, x: npt.ArrayLike) -> FloatArray:
        """Return the values of the curve at x, of any shape."""
        return _follow(np.asarray(x, dtype=np.float64), self.knots, self.slopes, self.heights)

    def invert(self, y: npt.ArrayLike) -> FloatArray:
        """Return the x at which the curve has the values y, of any shape.

        Raises a `NotInvertibleError` if a piece does not rise.
        """
        if not self.invertible:
            piece = int(np.argmin(self.slopes))
            raise NotInvertibleError(
                f"piece {piece} of the dead zones has slope {self.slopes[piece]:g}; give weights "
                "whose cumulative sums from zero outwards are all positive"
            )
        return _follow(np.asarray(y, dtype=np.float64), self.heights, 1 / self.slopes, self.knots)

    @cached_property
    def heights(self) -> FloatArray:
        """Value of the curve at each knot."""
        centre = int(np.count_nonzero(self.knots < 0))
        corners = np.insert(self.knots, centre, 0.0)
        pieces = np.concatenate([self.slopes[1 : centre + 1], self.slopes[centre:-1]])
        rises = np.diff(corners) * pieces
        heights = np.concatenate(
            [-np.cumsum(rises[:centre][::-1])[::-1], np.cumsum(rises[centre:])]
        )
        return frozen(heights)


def as_paired(
    places: npt.ArrayLike, weights: npt.ArrayLike, *, name: str
) -> tuple[FloatArray, FloatArray]:
    """Return strictly increasing places and their weights, both read-only.

    Raises a `ParameterError` if there is none, they do not increase, lengths differ, or a number is
    not finite.
    """
    try:
        first, second = frozen(places), frozen(weights)
    except (TypeError, ValueError) as error:
        raise ParameterError(f"{name} or weights are not numbers: {error}") from None
    if first.ndim != 1 or first.size == 0 or first.shape != second.shape:
        raise ParameterError(
            f"{name} have shape {first.shape} and weights {second.shape}; give as many weights "
            f"as {name}, at least one, in one dimension"
        )
    for label, values in ((name, first), ("weights", second)):
        if not np.isfinite(values).all():
            index = int(np.argmin(np.isfinite(values)))
            raise ParameterError(f"{label}[{index}] is {values[index]}; all must be finite")
    if not (np.diff(first) > 0).all():
        index = int(np.argmin(np.diff(first) > 0))
        raise ParameterError(
            f"{name} are not strictly increasing: {first[index]:g} at index {index} is followed "
            f"by {first[index + 1]:g}"
        )
    return first, second


def _follow(
    x: FloatArray, knots: FloatArray, slopes: FloatArray, heights: FloatArray
) -> FloatArray:
    """Return the values at x of the piecewise linear curve through the origin and the knots."""
    centre = int(np.count_nonzero(knots < 0))
    # Each piece begins at its corner nearer to the origin, where rounding errors are smallest.
    corner_x = np.insert(knots, centre, 0.0)
    corner_y = np.insert(heights, centre, 0.0)
    piece = np.searchsorted(knots, x)
    return np.asarray(corner_y[piece] + slopes[piece] * (x - corner_x[piece]))
