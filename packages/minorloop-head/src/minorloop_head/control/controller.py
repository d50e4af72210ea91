"""Interface of every controller of a heated wire, and what all of them share.

A controller is frozen configuration; ``step`` takes a state and returns the next one. ``applied``
of the state is the current that the controller requested. If another current was applied, the
caller puts it there before the next step, so that models follow the applied current.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Protocol, Self

from minorloop.arrays import as_finite
from minorloop.errors import ParameterError
from minorloop_head.heated_wire import SMALLEST_CHANGE, HeatedState, HeatedWire

INTERVAL = 0.04
"""Time between two steps in seconds, 25 Hz."""
HIGHEST_CURRENT = 0.4
"""Largest current of the wires of the head, in A."""
MOST_DELAY = 250
"""Longest delay of the sensor, in steps: 10 s at 25 Hz, more than the lag of a wire."""


class Controller(Protocol):
    """A control law for one wire: from a target and a reading to a current."""

    @property
    def interval(self) -> float:
        """Time between two steps in seconds."""

    def begin(self, measurement: float = 0.0, current: float = 0.0) -> Any:
        """Return the state before the first step.

        ``measurement``: angle at which the wire has settled, in degrees; ``current``: current under
        which it has settled, in A.
        """

    def step(self, state: Any, reference: float, measurement: float) -> tuple[float, Any]:
        """Return the current for the next interval and the next state; nothing changes in place.

        The current is in A, within the limits.

        ``reference``: wanted angle, in degrees. ``measurement``: newest reading in degrees; NaN
        where there is none.
        """


@dataclass(frozen=True, kw_only=True)
class Loop:
    """The clock and the limits of a loop.

    Raises a `ParameterError` if a number is out of its range.
    """

    interval: float = INTERVAL
    """Time between two steps in seconds, above 0 and up to 1."""
    delay: int = 1
    """Age of a reading in intervals, 0 to 250."""
    highest: float = HIGHEST_CURRENT
    """Largest current in A, above 0 and up to 0.4."""

    def __post_init__(self) -> None:
        bounds = {"interval": (1e-4, 1.0, "s"), "highest": (1e-6, HIGHEST_CURRENT, "A")}
        for name, (low, high, unit) in bounds.items():
            object.__setattr__(self, name, within(name, getattr(self, name), low, high, unit))
        whole = isinstance(self.delay, int) and not isinstance(self.delay, bool)
        if not whole or not 0 <= self.delay <= MOST_DELAY:
            raise ParameterError(f"delay is {self.delay!r}; give 0 to {MOST_DELAY} intervals")

    def later(self, steps: int) -> Self:
        """Return the loop for readings that are older by some intervals; states remain valid."""
        return replace(self, delay=min(self.delay + steps, MOST_DELAY))

    def current(self, power: float) -> float:
        """Return the current in A for a power, within the limits."""
        return min(math.sqrt(max(power, 0.0)), self.highest)


def within(name: str, value: float, low: float, high: float, unit: str = "") -> float:
    """Return a parameter as a float, checked against its range.

    Raises a `ParameterError` if it is not a number from low to high.
    """
    number = as_finite(name, value)
    if not low <= number <= high:
        of = f" {unit}" if unit else ""
        raise ParameterError(f"{name} is {value}{of}; give {low:g} to {high:g}{of}")
    return number


def width(wire: HeatedWire) -> float:
    """Return the range of the power of a wire, in A^2."""
    return float(wire.operator.levels[-1] - wire.operator.levels[0])


def mean_slope(wire: HeatedWire) -> float:
    """Return the range of the angle over that of the power, in degrees per A^2."""
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
    """Return the power in A^2 that drives a wire to an angle with a lag of ``response``.

    The inverse of the operator gives the effective power, the inverse of the heating lag, with
    latent heat, the power that leads there.

    ``state``: of the wire. ``reference``: wanted angle, in degrees. ``response``: wanted time
    constant, in seconds. ``ambient``: power that the surroundings add, in A^2. ``steepest``: slope
    in degrees per A^2 that limits the power for an error, so that a small error does not cross the
    whole width of the loop. Infinite for no such limit.
    """
    change = state.tracker.aim(reference, "clip") - state.power
    if math.isfinite(steepest):
        most = abs(reference - state.angle) / steepest
        change = min(max(change, -most), most)
    slope = 0.0
    if abs(change) > SMALLEST_CHANGE and wire.latent > 0:
        slope = (state.tracker.peek(state.power + change) - state.angle) / change
    return state.power - ambient + (wire.lag + wire.latent * slope) * change / response
