"""Internal-model control around the inverse operator.

The inverse operator cancels the hysteresis, so that from its input v to the angle a lag and a
delay remain: H(s) = e^(-sd) / (1 + tau_H s). The model is simulated beside the plant, and the
difference is fed back. The model follows the current that was applied, not the requested one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from minorloop.operators.tracker import Tracker
from minorloop_head.control.controller import Loop, mean_slope
from minorloop_head.heated_wire import HeatedWire


@dataclass(frozen=True, eq=False, kw_only=True)
class InverseLoop(Loop):
    """A loop around the inverse of an operator."""

    wire: HeatedWire

    @property
    def wire_lag(self) -> float:
        """Lag of the wire in seconds, with the latent heat of its mean slope."""
        return self.wire.lag + self.wire.latent * mean_slope(self.wire)

    def inverse(self, tracker: Tracker, angle: float) -> float:
        """Return the current in A whose power brings an operator to an angle in degrees.

        It is the largest for angles at the end of the range and beyond: where the plane is flat
        there, the inverse would give the least input that reaches it.
        """
        beyond = angle >= tracker.model.range[1]
        return self.highest if beyond else self.current(tracker.aim(angle, "clip"))


@dataclass(frozen=True, eq=False)
class InverseState:
    """State of a loop around the inverse."""

    tracker: Tracker
    """Memory of the inverse operator; it is copied and never pushed."""
    past: tuple[float, ...]
    """Angles of a model, newest first, up to the age of a reading."""
    applied: float
    """Present current in A."""


@dataclass(frozen=True, eq=False)
class InternalModelState(InverseState):
    """State of the loop."""

    filter: float
    """State of the controller C(s), in degrees."""
    lag: float
    """Angle of the model H(s) before its delay."""
    missing: float
    """Last difference between plant and model, in degrees."""


@dataclass(frozen=True, eq=False, kw_only=True)
class InternalModel(InverseLoop):
    """Control by the difference between plant and model.

    v = C (r - (y - H v)), u = sqrt(Gamma^-1[v]), C(s) = (1 + tau_H s) / (1 + lambda s).

    References
    ----------
    Morari and Zafiriou, Robust Process Control, 1989, chapter 4: design of C(s).
    Boudjabi, Ferreira and Krupa, Proc. IEEE ICRA 2003, Fig. 9: the loop around the inverse.
    """

    response: float = 0.6
    """lambda: time constant with which the angle follows, in seconds."""
    lag: float | None = None
    """tau_H in seconds; that of the wire if not given."""

    @property
    def model_lag(self) -> float:
        """tau_H in seconds."""
        return self.wire_lag if self.lag is None else self.lag

    def begin(self, measurement: float = 0.0, current: float = 0.0) -> InternalModelState:
        """Return a state that keeps the present current if the reference is the measurement."""
        tracker = self.wire.found(current**2, measurement).tracker.copy()
        angle = tracker.push(current**2)
        return InternalModelState(
            tracker, (angle,) * self.delay, current, angle, angle, measurement - angle
        )

    def step(
        self, state: InternalModelState, reference: float, measurement: float
    ) -> tuple[float, InternalModelState]:
        """Return the next current and state; a missing reading keeps the last difference."""
        tracker = state.tracker.copy()
        achieved = tracker.push(state.applied**2)
        lag = achieved + (state.lag - achieved) * math.exp(-self.interval / self.model_lag)
        seen = (lag, *state.past)
        missing = state.missing
        if math.isfinite(measurement):
            missing = measurement - seen[-1]
        wanted = reference - missing
        ratio = self.model_lag / self.response
        v = state.filter + ratio * (wanted - state.filter)
        current = self.inverse(tracker, v)
        # The filter sees the input that would have given what is achieved (Hanus, 1987).
        settled = tracker.peek(current**2)
        driven = state.filter + (settled - state.filter) / ratio
        filtered = driven + (state.filter - driven) * math.exp(-self.interval / self.response)
        return current, replace(
            state,
            tracker=tracker,
            filter=filtered,
            lag=lag,
            past=seen[: self.delay],
            applied=current,
            missing=missing,
        )
