"""Find a drift of the sensor from the slopes at the ends of holds.

What remains of a transient goes the way of the step before the hold. A drift is common to all
holds.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.lab.holds import FoundHold
from minorloop.lab.settling import STRETCH, trend

__all__ = ["SensorDrift", "find_drift"]

_FEWEST = 4
"""Least holds after a rise and after a fall: fewer may agree by chance."""
_SURE, _SURE_EACH = 6.0, 3.0
"""Standard errors of a drift: over all holds, and over those after rises or falls alone."""
_LEAST = 0.005
"""Least drift over the record that is reported, in spans of the outputs at the ends of holds."""
_ROUNDING = 1e-24
"""Share of the squared slopes that is rounding."""


@dataclass(frozen=True)
class SensorDrift:
    """A change of the output that all holds have in common."""

    rate: float
    sd: float
    """``rate`` and ``sd``: slope and its standard error, in the unit of the output per second."""
    share: float
    """Change over the record, in spans of the outputs at the ends of the holds."""


def find_drift(
    t: FloatArray, y: FloatArray, holds: Sequence[FoundHold], window: float
) -> SensorDrift | None:
    """Return the slope that the ends of all holds have in common; None where there is none.

    The constant part of the slopes must go the same way after rises and after falls: what remains
    of transients alone, however fast they are each way, does not.

    Parameters
    ----------
    t, y : (T,) array
        Times in seconds, and outputs; NaN where nothing was measured.
    holds : sequence of FoundHold
        Holds of the input, in order.
    window : float
        Trailing part over which a slope is taken in a judgement, as a share of a hold; ``STRETCH``
        of them are taken here.
    """
    slopes, ends = [], []
    for hold in holds:
        part = slice(hold.begin, hold.end)
        held = float(t[hold.end - 1] - t[hold.begin])
        line = trend(t[part], y[part], STRETCH * window * held)
        slopes.append(line.slope if line else math.nan)
        ends.append(line.value if line else math.nan)
    slope, step = np.array(slopes)[1:], np.diff(ends)
    known = np.isfinite(slope) & np.isfinite(step)
    slope, step = slope[known], step[known]
    sides = (step > 0, step < 0)
    if min(np.count_nonzero(some) for some in sides) < _FEWEST:
        return None
    rate, sd = _constant(slope, step)
    span = float(np.nanmax(ends) - np.nanmin(ends))
    share = rate * float(t[-1] - t[0]) / span if span else 0.0
    if abs(share) < _LEAST or not abs(rate) >= _SURE * sd:
        return None
    way = np.sign(rate)
    if any(
        way * float(np.median(slope[some])) < _SURE_EACH * _error(slope[some]) for some in sides
    ):
        return None
    return SensorDrift(rate, sd, share)


def _constant(slope: FloatArray, step: FloatArray) -> tuple[float, float]:
    """Return the slope without a step, and its standard error.

    What remains of a transient is in proportion to the step, by another factor for falls. Without
    it the constant is better known; the penalty of Schwarz (Estimating the dimension of a model,
    1978) decides.
    """
    way = step / np.abs(step).max()
    every = np.column_stack([np.ones_like(way), np.maximum(way, 0.0), np.minimum(way, 0.0)])
    found = []
    for rows in (every[:, :1], every):
        inverse = np.linalg.pinv(rows)
        weights = inverse @ slope
        rest = slope - rows @ weights
        squares = max(float(rest @ rest), _ROUNDING * float(slope @ slope))
        noise = math.sqrt(squares / (rest.size - weights.size))
        score = rest.size * math.log(squares or 1.0) + weights.size * math.log(rest.size)
        found.append((score, float(weights[0]), noise * float(np.linalg.norm(inverse[0]))))
    return min(found)[1:]


def _error(values: FloatArray) -> float:
    """Return the standard error of the median, from the quartiles of a normal distribution."""
    low, high = np.percentile(values, [25, 75])
    return float(high - low) / 1.349 * math.sqrt(math.pi / 2 / values.size)
