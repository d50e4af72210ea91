"""Proportional and integral action on the heating power: control without a model."""

from __future__ import annotations

import math
from dataclasses import dataclass

from minorloop_head.control.controller import Loop, within


@dataclass(frozen=True)
class ProportionalIntegralState:
    """State of the loop: integral and requested power in A^2, and the present current."""

    integral: float
    wanted: float
    applied: float


@dataclass(frozen=True, kw_only=True)
class Feedback(Loop):
    """Power from the error and its integral, beside a power that something else gives.

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
    """

    proportional: float = 0.006
    integral: float = 0.0012
    unwinding: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        within("proportional", self.proportional, 0.0, 1.0, "A^2/deg")
        within("integral", self.integral, 0.0, 1.0, "A^2/(deg s)")
        within("unwinding", self.unwinding, self.interval, 600.0, "s")

    def follow(
        self, state: ProportionalIntegralState, error: float, ahead: float = 0.0
    ) -> tuple[float, float, float]:
        """Return current, integral and requested power after an error in degrees.

        Parameters
        ----------
        state : ProportionalIntegralState
            Before.
        error : float
            Target minus reading; NaN keeps the present current.
        ahead : float
            Power beside the feedback, in A^2.
        """
        if math.isnan(error):
            return state.applied, state.integral, state.applied**2
        missed = (state.applied**2 - state.wanted) * min(self.interval / self.unwinding, 1.0)
        most = self.highest**2
        integral = state.integral + missed + self.integral * self.interval * error
        integral = min(max(integral, -most), 2 * most)
        wanted = ahead + self.proportional * error + integral
        return self.current(wanted), integral, wanted


@dataclass(frozen=True, kw_only=True)
class ProportionalIntegral(Feedback):
    """A loop without a model: power proportional to the error and to its integral.

    Parameters
    ----------
    proportional, integral, unwinding
        As in `Feedback`.
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

    def begin(self, measurement: float = 0.0, current: float = 0.0) -> ProportionalIntegralState:
        """Return a state that keeps the present current if the error is zero."""
        return ProportionalIntegralState(current**2, current**2, current)

    def step(
        self, state: ProportionalIntegralState, reference: float, measurement: float
    ) -> tuple[float, ProportionalIntegralState]:
        """Return the next current and state; a missing reading keeps the present current."""
        current, integral, wanted = self.follow(state, reference - measurement)
        return current, ProportionalIntegralState(integral, wanted, current)
