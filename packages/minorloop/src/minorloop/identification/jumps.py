"""Find jumps in a record: thresholds at which many relays switch at once.

In a band of the plane, relays are spread evenly. The output of relays that all switch at one
threshold would be smeared over the band. Several jumps of the output between the same inputs show
such a threshold; two levels around it make its band too narrow for a sample to lie in it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, IntArray, Levels, as_levels
from minorloop.identification.curves import Curves

_STEEP = 4.0
"""Least height of a jump over the largest change of the output in its neighbourhood that the slope
does not explain; and over the resolution of the output if another jump is near."""
_NEAR = 5
"""Number of steps before and after a jump in its neighbourhood."""
_SEEN = 3
"""Least number of jumps between the same inputs."""
_CLEAR = 0.25
"""Distance from a jump, in mean bands, within which the jump replaces other levels; and largest
width of a given band for a jump."""


@dataclass(frozen=True)
class Jump:
    """A threshold at which the output jumps."""

    low: float
    high: float
    """``low`` and ``high``: nearest applied inputs before and after the threshold."""
    rising: bool
    """Whether the input rises through the threshold."""
    seen: int
    """Number of jumps of the output there."""

    def __str__(self) -> str:
        way = "rising" if self.rising else "falling"
        return f"{(self.low + self.high) / 2:.6g} {way}"


def find_jumps(
    u: FloatArray, y: FloatArray, fitted: BoolArray, curves: Curves, levels: Levels
) -> tuple[Jump, ...]:
    """Find thresholds at which the output jumps.

    An output jumps between two samples if it changes by at least 2 % of its range, and by at least
    four times the changes in the neighbouring steps, after the local slope is subtracted. Of each
    constant input, the last sample counts. At a threshold the output jumps at least three times.
    More than eight thresholds count as none.

    ``u`` and ``y`` (T,): inputs, delayed as the output is, and outputs; ``fitted`` (T,) of bool:
    samples to use; ``curves``: parts of the record; ``levels`` (L + 1,): thresholds without jumps;
    a step of the input by more than half of their mean distance is too wide to locate a jump.
    """
    span = float(np.ptp(y[fitted]))
    # Number of first rows to search
    rows = min(u.size, 200_000)
    last = np.flatnonzero(np.append(np.diff(u[:rows]) != 0, True))  # of each constant input
    inputs, outputs = u[last], np.where(fitted[last], y[last], np.nan)
    moved, changed = np.diff(inputs), np.diff(outputs)
    changed[np.diff(curves.first_rows(rows)[last]) != 0] = np.nan
    # Widest step of the input, in mean bands, that locates the threshold
    narrow = np.abs(moved) <= 0.5 * _mean_band(levels)
    # Least height of a jump over the range of the output
    steps = np.flatnonzero(narrow & (np.abs(changed) >= 0.02 * span))
    steps = steps[_stand_out(moved, changed, steps)]
    found = []
    for rising in (True, False):
        here = steps[(moved[steps] > 0) == rising]
        low = np.minimum(inputs[here], inputs[here + 1])
        high = np.maximum(inputs[here], inputs[here + 1])
        found += [Jump(*ends, rising, seen) for ends, seen in _common(low, high)]
    # With more thresholds, jumps are not exceptions: the sensor may have so few steps
    return tuple(found) if len(found) <= 8 else ()


def with_jumps(levels: Levels, jumps: Sequence[Jump]) -> Levels:
    """Return levels (L + 1,) with narrow bands around jumps in place of the levels near them."""
    ends = [end for jump in jumps for end in (jump.low, jump.high)]
    near = _CLEAR * _mean_band(levels)
    free = np.ones(levels.size, dtype=np.bool_)
    for jump in jumps:
        free &= (levels <= jump.low - near) | (levels >= jump.high + near)
    free[[0, -1]] = True
    low, high = float(levels[0]), float(levels[-1])
    return as_levels(np.union1d(levels[free], np.clip(ends, low, high)))


def narrow_bands(levels: Levels) -> IntArray:
    """Return the numbers of the bands that are at most a quarter as wide as the mean band."""
    return np.flatnonzero(np.diff(levels) <= _CLEAR * _mean_band(levels))


def in_narrow_bands(jumps: Sequence[Jump], levels: Levels) -> tuple[Jump, ...]:
    """Return the jumps that overlap a narrow band of given levels (L + 1,)."""
    narrow = narrow_bands(levels)
    low, high = levels[narrow], levels[narrow + 1]
    return tuple(jump for jump in jumps if ((low <= jump.high) & (jump.low <= high)).any())


def _mean_band(levels: Levels) -> float:
    return float(levels[-1] - levels[0]) / (levels.size - 1)


def _stand_out(moved: FloatArray, changed: FloatArray, steps: IntArray) -> BoolArray:
    """Whether the output changes much more in these steps than in neighbouring steps."""
    offsets = np.concatenate([np.arange(-_NEAR, 0), np.arange(1, _NEAR + 1)])
    places = steps[:, None] + offsets
    inside = (places >= 0) & (places < moved.size)
    places = np.clip(places, 0, max(moved.size - 1, 0))
    du, dy = moved[places], np.where(inside, changed[places], np.nan)
    known = np.isfinite(dy)
    slope = _median(dy / du)
    changes = np.abs(np.where(known, dy - slope[:, None] * du, 0.0))
    second, first = np.partition(changes, [-2, -1], axis=1)[:, -2:].T
    excess = np.abs(changed[steps] - slope * moved[steps])
    # The largest change may be another jump, but not if the sensor has such steps.
    usual = np.where(np.abs(changed[steps]) > _STEEP * _resolution(changed), second, first)
    return np.asarray((known.sum(axis=1) >= _NEAR) & (excess >= _STEEP * usual))


def _resolution(changed: FloatArray) -> float:
    """Least change of the output; 0 if it never changes."""
    sizes = np.abs(changed[np.isfinite(changed) & (changed != 0)])
    return float(sizes.min()) if sizes.size else 0.0


def _median(values: FloatArray) -> FloatArray:
    """Median of the finite values of each row; 0 for rows without any."""
    empty = np.asarray(~np.isfinite(values).any(axis=1))
    return np.asarray(np.nanmedian(np.where(empty[:, None], 0.0, values), axis=1))


def _common(low: FloatArray, high: FloatArray) -> list[tuple[tuple[float, float], int]]:
    """Return intersections of intervals and their numbers; the intersection of most comes first."""
    found = []
    while low.size >= _SEEN:
        ends = np.sort(low)
        over = np.searchsorted(ends, ends, side="right") - np.searchsorted(
            np.sort(high), ends, side="right"
        )
        best = ends[int(np.argmax(over))]
        here = (low <= best) & (best < high)
        if np.count_nonzero(here) < _SEEN:
            break
        shared = float(low[here].max()), float(high[here].min())
        found.append((shared, int(np.count_nonzero(here))))
        low, high = low[~here], high[~here]
    return found
