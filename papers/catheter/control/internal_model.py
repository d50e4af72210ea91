"""Internal-model control around the inverse operator.

The inverse operator cancels the hysteresis, so that from its input v to the angle a lag and a
delay remain: H(s) = e^(-sd) / (1 + tau_H s). The model is simulated beside the plant, and the
difference is fed back. The model follows the current that was applied, not the requested one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.operators.tracker import Tracker
from minorloop_head.control.controller import MOST_DELAY, Loop, mean_slope
from minorloop_head.heated_wire import HeatedWire


def mean_lag(wire: HeatedWire) -> float:
    """Return the heating lag of a wire that moves, in seconds, on average over its levels."""
    return wire.lag + wire.latent * mean_slope(wire)


@dataclass(frozen=True, eq=False, kw_only=True)
class InverseLoop(Loop):
    """A loop around the inverse of an operator."""

    wire: HeatedWire

    def found(self, measurement: float, current: float) -> tuple[Tracker, float]:
        """Return the memory of a wire that has settled under a current, and the model's angle."""
        tracker = self.wire.found(current**2, measurement).tracker.copy()
        return tracker, tracker.push(current**2)

    def inverse(self, tracker: Tracker, angle: float) -> float:
        """Return the current in A whose power brings an operator to an angle in degrees.

        It is the largest for angles at the end of the range and beyond: if the plane is flat there,
        the inverse would return the least input that reaches the end.
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
        return mean_lag(self.wire) if self.lag is None else self.lag

    def begin(self, measurement: float = 0.0, current: float = 0.0) -> InternalModelState:
        """Return a state that keeps the present current if the reference is the measurement."""
        tracker, angle = self.found(measurement, current)
        past = (angle,) * self.delay
        return InternalModelState(tracker, past, current, angle, angle, measurement - angle)

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
        # The filter uses the input that would have given the achieved output (Hanus, 1987).
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


@dataclass(frozen=True)
class Margins:
    """Edges of stability, each with the rest of the plant as in the model.

    From the input v of the inverse operator to the angle, the plant is a gain, a lag and a delay.
    The loop is linear while the current is not at a limit, so that its poles tell whether it is
    stable. Where the operator of the plant differs from the model, its slope along a branch is the
    gain.
    """

    gain: float
    """Greatest slope of the plant over that of the model."""
    delay: float
    """Longest delay of the sensor beyond that of the model, in seconds, in whole intervals."""
    lag: float
    """Shortest lag of the plant over that of the model; 0 if there is none."""


def poles(law: InternalModel, *, gain: float = 1.0, delay: int = 0, lag: float = 1.0) -> FloatArray:
    """Return the magnitudes of the discrete poles of the loop, the greatest first.

    With H = z^-d (1 - a) / (z - a) of the model and P of the plant, the loop has the poles of
    1 + C (P - H) = 0, C = m + (1 - m) (1 - b) / (z - b), where a and b are the decays of the
    lags tau_H and lambda in an interval and m = tau_H / lambda (Morari and Zafiriou, Robust Process
    Control, 1989, chapters 3 and 4).

    ``gain`` and ``lag`` are the slope and the lag of the plant over those of the model, above 0;
    the readings are by ``delay`` intervals older than the model's.
    """
    ratio = law.model_lag / law.response
    own = math.exp(-law.interval / law.model_lag)
    plant = math.exp(-law.interval / (law.model_lag * lag))
    filtered = math.exp(-law.interval / law.response)
    corrector = [ratio, (1.0 - ratio) * (1.0 - filtered) - ratio * filtered]
    late, sooner = np.zeros(law.delay + delay + 1), np.zeros(delay + 1)
    late[0] = sooner[0] = 1.0
    beside = np.polymul([1.0, -filtered], np.polymul([1.0, -own], [1.0, -plant]))
    missing = np.polysub(
        gain * (1.0 - plant) * np.array([1.0, -own]),
        np.polymul((1.0 - own) * np.array([1.0, -plant]), sooner),
    )
    loop = np.polyadd(np.polymul(beside, late), np.polymul(corrector, missing))
    return np.asarray(np.sort(np.abs(np.roots(loop)))[::-1])


def margins(law: InternalModel, *, gain: float = 1.0, lag: float = 1.0) -> Margins:
    """Return the edges of stability, each with the other quantities of the stated plant.

    Gains and ratios of lags up to 1e4 are tried: no actuator differs so much from its model.
    """
    far = 1e4
    unstable = (
        k for k in range(1, MOST_DELAY) if poles(law, gain=gain, delay=k, lag=lag)[0] >= 1.0
    )
    longest = next(unstable, MOST_DELAY) - 1
    shortest = 0.0
    if poles(law, gain=gain, lag=1.0 / far)[0] >= 1.0:
        shortest = _edge(lambda ratio: poles(law, gain=gain, lag=ratio)[0], 1.0 / far)
    greatest = _edge(lambda ratio: poles(law, gain=ratio, lag=lag)[0], far)
    return Margins(greatest, longest * law.interval, shortest)


def robust_margins(law: InternalModel) -> Margins:
    """Return the worst edges of stability over the plants that identification leaves possible.

    The inverse may mistake one branch of the loop for the other, which changes the gain, or the
    wire may be at angles without transformation, where its lag lacks the latent heat. Both do not
    occur together: if the slope is large, so is the latent heat.
    """
    cold = law.wire.lag / law.model_lag
    found = [margins(law, gain=slope_ratio(law.wire)), margins(law, lag=cold)]
    return Margins(
        min(each.gain for each in found),
        min(each.delay for each in found),
        max(each.lag for each in found),
    )


def _edge(radius: Callable[[float], float], far: float) -> float:
    """Return the ratio between 1, which is stable, and another, which is not, at the edge."""
    inside, outside = 1.0, far
    for _ in range(50):  # to 1e-14 of it
        middle = math.sqrt(inside * outside)
        inside, outside = (middle, outside) if radius(middle) < 1.0 else (inside, middle)
    return inside


def slope_ratio(wire: HeatedWire) -> float:
    """Return the greatest ratio of the slopes of the two branches of the major loop.

    An inverse that mistakes one branch for the other meets this gain. Slopes are compared at
    equal angles, over the middle 80 % of the stroke: at the ends both branches are flat.
    """
    levels = wire.operator.levels
    up = np.linspace(levels[0], levels[-1], 10 * levels.size)
    angles = wire.operator.simulate(np.concatenate([up, up[::-1]]))
    low, high = wire.operator.range
    at = np.linspace(low + 0.1 * (high - low), high - 0.1 * (high - low), 81)
    rising, falling = (
        1.0 / np.gradient(np.interp(at, np.maximum.accumulate(angle), up), at)
        for angle in (angles[: up.size], angles[up.size :][::-1])
    )
    return float(np.maximum(rising / falling, falling / rising).max())
