"""The laws of the paper by their names: that of the head, and its rivals."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from minorloop.operators.tracker import Tracker
from minorloop_head.control.controller import Loop, heating
from minorloop_head.control.head import Law
from minorloop_head.control.observer import ObserverControl
from minorloop_head.heated_wire import HeatedState, HeatedWire
from papers.catheter.control.adaptive import AdaptiveControl
from papers.catheter.control.internal_model import InternalModel
from papers.catheter.control.model_reference import ModelReference


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

    tracker: Tracker


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


@dataclass(frozen=True, eq=False)
class FeedforwardState:
    """State of open loop: the simulated wire, and the present current."""

    wire: HeatedState
    applied: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Feedforward(Loop):
    """Open-loop control by the model, without a sensor.

    References
    ----------
    Boudjabi, Ferreira and Krupa, Proc. IEEE ICRA 2003, Fig. 7; the order of lag and operator is
    that of the physics, and the model follows the current that was applied.
    """

    wire: HeatedWire
    response: float = 0.4
    """Time constant in seconds with which the angle follows, within the limits of the current."""

    def begin(self, measurement: float = 0.0, current: float = 0.0) -> FeedforwardState:
        """Return the state of a wire that has settled at an angle under a current."""
        return FeedforwardState(self.wire.found(current**2, measurement), current)

    def step(
        self, state: FeedforwardState, reference: float, measurement: float = math.nan
    ) -> tuple[float, FeedforwardState]:
        """Return the current for the next interval and the next state, without the measurement."""
        wire = self.wire.step(state.wire, state.applied**2, self.interval)
        current = self.current(heating(self.wire, wire, reference, response=self.response))
        return current, replace(state, wire=wire, applied=current)


def _without_model(wire: HeatedWire, **options: Any) -> ProportionalIntegral:
    return ProportionalIntegral(**options)


def _adaptive(wire: HeatedWire, **options: Any) -> AdaptiveControl:
    return AdaptiveControl(control=ObserverControl(wire=wire, **options))


def slow_pole(wire: HeatedWire, **options: Any) -> InternalModel:
    """Return the internal model with the G(s) of Fig 9, which places a pole at -1/tau_H.

    In series with C(s) = (1 + tau_H s) / (1 + lambda s), G(s) = (1 + lambda s) / (1 + tau_H s)
    leaves the inverse alone before the wire: its pole replaces that of C(s).
    """
    law = InternalModel(wire=wire, **options)
    return replace(law, response=law.model_lag)


LAWS: Mapping[str, Law] = {
    "observer": ObserverControl,
    "feedforward": Feedforward,
    "pi": _without_model,
    "internal_model": InternalModel,
    "adaptive": _adaptive,
    "feedforward_pi": FeedforwardPI,
    "model_reference": ModelReference,
}
"""The first is that of the head; the adaptive one has its options from the law that it adapts."""
