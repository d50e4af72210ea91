"""Proportional and integral action on the heating power, alone and beside the inverse operator."""

from __future__ import annotations

import math
from dataclasses import dataclass

from minorloop.operators.preisach import Preisach
from minorloop.operators.tracker import Tracker
from minorloop_head.control.controller import Loop
from minorloop_head.heated_wire import HeatedWire


@dataclass(frozen=True)
class ProportionalIntegralState:
    """State of the loop: integral and requested power in A^2, and the present current."""

    integral: float
    wanted: float
    applied: float


@dataclass(frozen=True, eq=False)
class FeedforwardPIState(ProportionalIntegralState):
    """The same, and the memory of the inverse operator, which follows the targets.

    The tracker is copied and never pushed.
    """

    tracker: Tracker[Preisach]


@dataclass(frozen=True, kw_only=True)
class ProportionalIntegral(Loop):
    """A loop without a model: power proportional to the error and to its integral.

    Notes
    -----
    The default gains put the crossing of the nominal wire, a lag of about 6 s and 600 degrees
    per A^2, near 0.6 rad/s.
    """

    proportional: float = 0.006
    """A^2 per degree."""
    integral: float = 0.0012
    """A^2 per degree and second."""
    unwinding: float = 1.0
    """Time constant in seconds with which the integral returns to the applied power while the
    current is at a limit."""

    def begin(self, measurement: float = 0.0, current: float = 0.0) -> ProportionalIntegralState:
        """Return a state that keeps the present current if the error is zero."""
        return ProportionalIntegralState(current**2, current**2, current)

    def step(
        self, state: ProportionalIntegralState, reference: float, measurement: float
    ) -> tuple[float, ProportionalIntegralState]:
        """Return the next current and state; a missing reading keeps the present current."""
        current, integral, wanted = self.follow(state, reference - measurement)
        return current, ProportionalIntegralState(integral, wanted, current)

    def follow(
        self, state: ProportionalIntegralState, error: float, ahead: float = 0.0
    ) -> tuple[float, float, float]:
        """Return current, integral and requested power after an error in degrees.

        A power in A^2 is ``ahead`` of the feedback; an error of NaN keeps the present current.
        """
        if math.isnan(error):
            return state.applied, state.integral, state.applied**2
        missed = (state.applied**2 - state.wanted) * min(self.interval / self.unwinding, 1.0)
        most = self.highest**2
        integral = state.integral + missed + self.integral * self.interval * error
        integral = min(max(integral, -most), 2 * most)
        wanted = ahead + self.proportional * error + integral
        return self.current(wanted), integral, wanted


@dataclass(frozen=True, eq=False, kw_only=True)
class FeedforwardPI(ProportionalIntegral):
    """Feedforward by the inverse operator with proportional and integral feedback.

    u^2 = Gamma^-1[r] + k_p e + k_i times the integral of e, e = r - y. The lag of the wire is left
    to the feedback.

    References
    ----------
    Ge and Jouaneh, Precision Engineering 20, 1997, pp. 91-111, for a piezoceramic actuator;
    Boudjabi, Ferreira and Krupa (2003) name it beside their own controller.

    Notes
    -----
    With twice the gains of the loop without feedforward, circles and a warming ambient are followed
    best; a step settles no sooner with others (specimens 1000 to 1002).
    """

    wire: HeatedWire
    proportional: float = 0.012
    integral: float = 0.0024

    def begin(self, measurement: float = 0.0, current: float = 0.0) -> FeedforwardPIState:
        """Return a state that keeps the present current if the reference is the measurement."""
        power = current**2
        tracker = self.wire.found(power, measurement).tracker.copy()
        ahead = tracker.aim(measurement, "clip")
        tracker.push(ahead)
        return FeedforwardPIState(power - ahead, power, current, tracker)

    def step(
        self, state: ProportionalIntegralState, reference: float, measurement: float
    ) -> tuple[float, FeedforwardPIState]:
        """Return the next current and state; a missing reading keeps the present current."""
        assert isinstance(state, FeedforwardPIState)
        tracker = state.tracker.copy()
        ahead = tracker.aim(reference, "clip")
        tracker.push(ahead)
        current, integral, wanted = self.follow(state, reference - measurement, ahead)
        return current, FeedforwardPIState(integral, wanted, current, tracker)
