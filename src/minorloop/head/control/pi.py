"""Proportional and integral action on the heating power: control without a model."""

from __future__ import annotations

import math
from dataclasses import dataclass

from minorloop.head.control.controller import Loop, within


@dataclass(frozen=True)
class ProportionalIntegralState:
    """State of the loop: integral and requested power in A^2, and the present current."""

    integral: float
    wanted: float
    applied: float


@dataclass(frozen=True, kw_only=True)
class ProportionalIntegral(Loop):
    """A loop without a model: power proportional to the error and to its integral.

    Parameters
    ----------
    proportional : float
        A^2 per degree, 0 to 1.
    integral : float
        A^2 per degree and second, 0 to 1.
    unwinding : float
        Time constant in seconds with which the integral returns to the applied power while the
        current is at a limit.
    interval, delay, highest
        As in `Loop`.

    Raises
    ------
    ParameterError
        If a number is out of its range.

    Notes
    -----
    The default gains put the crossing of the nominal wire, a lag of about 6 s and 600 degrees
    per A^2, near 0.6 rad/s.
    """

    proportional: float = 0.006
    integral: float = 0.0012
    unwinding: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        within("proportional", self.proportional, 0.0, 1.0, "A^2/deg")
        within("integral", self.integral, 0.0, 1.0, "A^2/(deg s)")
        within("unwinding", self.unwinding, self.interval, 600.0, "s")

    def begin(self, measurement: float = 0.0, current: float = 0.0) -> ProportionalIntegralState:
        """Return a state that keeps the present current if the error is zero."""
        return ProportionalIntegralState(current**2, current**2, current)

    def step(
        self, state: ProportionalIntegralState, reference: float, measurement: float
    ) -> tuple[float, ProportionalIntegralState]:
        """Return the next current and state; a missing reading keeps the present current."""
        missed = (state.applied**2 - state.wanted) * min(self.interval / self.unwinding, 1.0)
        if math.isnan(measurement):
            return state.applied, ProportionalIntegralState(
                state.integral, state.applied**2, state.applied
            )
        error = reference - measurement
        most = self.highest**2
        integral = state.integral + missed + self.integral * self.interval * error
        integral = min(max(integral, -most), 2 * most)
        wanted = self.proportional * error + integral
        current = self.current(wanted)
        return current, ProportionalIntegralState(integral, wanted, current)
