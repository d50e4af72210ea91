"""Map from a stick to the rates of the catheter.

Forward pushes the catheter into the pipe, right rolls it to the right. A stick without messages for
some time counts as released.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

Rates: TypeAlias = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class StickMap:
    """Parameters of the map from a stick to rates.

    Notes
    -----
    The rates are such that the motors, with 40 mm/s^2 and 180 degrees/s^2, stop in 0.15 s.
    """

    advance: float = 6e-3
    roll: float = math.radians(27.0)
    """Rates at full deflection, in m/s and rad/s."""
    dead_band: float = 0.05
    """Share of the deflection without effect, from 0 to below 1."""
    expo: float = 0.6
    """Shape of the response, from 0, linear, to 1, cubic."""
    advance_acceleration: float = 12e-3
    roll_acceleration: float = math.radians(60.0)
    """Fastest changes of the rates, in m/s^2 and rad/s^2."""
    timeout: float = 0.1
    """Age of a deflection in seconds beyond which the catheter stops."""

    def shaped(self, deflection: float) -> float:
        """Return the share of the full rate, -1 to 1, for a deflection from -1 to 1; 0 for NaN."""
        if not math.isfinite(deflection):
            return 0.0
        beyond = (min(abs(deflection), 1.0) - self.dead_band) / (1.0 - self.dead_band)
        if beyond <= 0:
            return 0.0
        return math.copysign((1 - self.expo) * beyond + self.expo * beyond**3, deflection)


def push(
    config: StickMap, before: Rates, deflection: tuple[float, float] | None, interval: float
) -> Rates:
    """Return rates of advance and roll after an interval, in m/s and rad/s.

    Parameters
    ----------
    config : StickMap
    before : (float, float)
        Present rates.
    deflection : (float, float), optional
        Forward and right, each from -1 to 1. None stops at once, as fast as the motors can.
    interval : float
        In seconds.
    """
    if deflection is None:
        return 0.0, 0.0
    advance = _towards(
        before[0],
        config.advance * config.shaped(deflection[0]),
        config.advance_acceleration * interval,
    )
    roll = _towards(
        before[1], config.roll * config.shaped(deflection[1]), config.roll_acceleration * interval
    )
    return advance, roll


def _towards(before: float, wanted: float, most: float) -> float:
    return before + min(max(wanted - before, -most), most)
