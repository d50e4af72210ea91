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

_FEWEST = 4
"""Least holds after a rise and after a fall: fewer may agree by chance."""
_SURE = 6.0
"""Standard errors of a drift."""
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

    It is the part of the slopes that does not depend on the step before, up or down.

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
    if min(np.count_nonzero(step > 0), np.count_nonzero(step < 0)) < _FEWEST:
        return None
    rate, sd = _constant(slope, step)
    span = float(np.nanmax(ends) - np.nanmin(ends))
    share = rate * float(t[-1] - t[0]) / span if span else 0.0
    if abs(share) < _LEAST or not abs(rate) >= _SURE * sd:
        return None
    return SensorDrift(rate, sd, share)


def _constant(slope: FloatArray, step: FloatArray) -> tuple[float, float]:
    """Return the slope without a step, and its standard error.

    What remains of a transient is in proportion to the step, by another factor for falls.
    """
    way = step / np.abs(step).max()
    rows = np.column_stack([np.ones_like(way), np.maximum(way, 0.0), np.minimum(way, 0.0)])
    inverse = np.linalg.pinv(rows)
    weights = inverse @ slope
    rest = slope - rows @ weights
    squares = max(float(rest @ rest), _ROUNDING * float(slope @ slope))
    noise = math.sqrt(squares / (rest.size - weights.size))
    return float(weights[0]), noise * float(np.linalg.norm(inverse[0]))
