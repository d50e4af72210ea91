"""What every controller of a heated wire looks like, and what all of them share.

A controller is frozen configuration. Its state is a value that goes in and comes out of
``step``; the state says which current it asked for in ``applied``, and whoever had to apply
another puts that there before the next step, so that models follow what was achieved.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol

from minorloop.arrays import as_finite
from minorloop.errors import ParameterError
from minorloop.head.control.heating import SMALLEST_CHANGE, HeatedState, HeatedWire

INTERVAL = 0.04
"""Time between two steps in seconds, 25 Hz."""
HIGHEST_CURRENT = 0.4
"""In A: what the wires of the head may have."""
MOST_DELAY = 250
"""Longest delay of the sensor, in steps."""


class Controller(Protocol):
    """A control law for one wire: from a wish and a reading to a current."""

    @property
    def interval(self) -> float:
        """Time between two steps in seconds."""

    def begin(self, measurement: float = 0.0, current: float = 0.0) -> Any:
        """State before the first step.

        Parameters
        ----------
        measurement : float
            Angle at which the wire is found, in degrees.
        current : float
            Under which it has settled there, in A.
        """

    def step(self, state: Any, reference: float, measurement: float) -> tuple[float, Any]:
        """Current for the next interval, and the state after it; nothing is changed in place.

        Parameters
        ----------
        state : as ``begin`` gives it
        reference : float
            Angle wanted, in degrees.
        measurement : float
            Newest reading in degrees; NaN where there is none.

        Returns
        -------
        current : float
            In A, within the limits.
        state
        """


@dataclass(frozen=True, kw_only=True)
class Loop:
    """The clock and the limits of a loop.

    Parameters
    ----------
    interval : float
        Time between two steps in seconds, above 0 and up to 1.
    delay : int
        By how many intervals a reading is old when it is given, 0 to 250.
    highest : float
        Largest current in A, above 0 and up to 0.4.

    Raises
    ------
    ParameterError
        If a number is out of its range.
    """

    interval: float = INTERVAL
    delay: int = 1
    highest: float = HIGHEST_CURRENT

    def __post_init__(self) -> None:
        within("interval", self.interval, 1e-4, 1.0, "s")
        within("highest", self.highest, 1e-6, HIGHEST_CURRENT, "A")
        whole = isinstance(self.delay, int) and not isinstance(self.delay, bool)
        if not whole or not 0 <= self.delay <= MOST_DELAY:
            raise ParameterError(f"delay is {self.delay!r}; give 0 to {MOST_DELAY} intervals")

    def current(self, power: float) -> float:
        """Current that gives a power as far as the limits allow, in A."""
        return min(math.sqrt(max(power, 0.0)), self.highest)


def within(name: str, value: float, low: float, high: float, unit: str = "") -> float:
    """Give a parameter of a controller as a float, refused outside its range.

    Raises
    ------
    ParameterError
        If it is not a number from low to high.
    """
    number = as_finite(name, value)
    if not low <= number <= high:
        of = f" {unit}" if unit else ""
        raise ParameterError(f"{name} is {value}{of}; give {low:g} to {high:g}{of}")
    return number


def width(wire: HeatedWire) -> float:
    """Range of the power of a wire, in A^2."""
    return float(wire.operator.levels[-1] - wire.operator.levels[0])


def mean_slope(wire: HeatedWire) -> float:
    """Range of the angle over that of the power, in degrees per A^2."""
    low, high = wire.operator.range
    return (high - low) / width(wire)


def heating(
    wire: HeatedWire,
    state: HeatedState,
    reference: float,
    *,
    response: float,
    ambient: float = 0.0,
    steepest: float = math.inf,
) -> float:
    """Power that takes a wire to an angle as if it had a lag of ``response`` alone, in A^2.

    The inverse of the operator says which effective power is needed, the inverse of the heating
    lag, latent heat included, how to get there.

    Parameters
    ----------
    wire : HeatedWire
    state : HeatedState
        Where it is.
    reference : float
        Angle wanted, in degrees.
    response : float
        Time constant wanted, in seconds.
    ambient : float
        Power that the surroundings add, in A^2.
    steepest : float
        Degrees per A^2: an error asks for no more power than its share of this, so that a small
        one does not jump the whole width of the loop. Infinite for no such bound.
    """
    change = state.tracker.aim(reference) - state.power
    if math.isfinite(steepest):
        most = abs(reference - state.angle) / steepest
        change = min(max(change, -most), most)
    slope = 0.0
    if abs(change) > SMALLEST_CHANGE and wire.latent > 0:
        slope = (state.tracker.peek(state.power + change) - state.angle) / change
    return state.power - ambient + (wire.lag + wire.latent * slope) * change / response
