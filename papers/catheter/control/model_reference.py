"""Model-reference adaptive control around the inverse operator.

The inverse operator cancels the hysteresis, so that a lag with unknown gain, time constant and bias
remains between its input v and the angle. The weights of target, reading and a constant in v adapt
until the angle follows a given lag.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from papers.catheter.control.internal_model import InverseLoop, InverseState, mean_lag


@dataclass(frozen=True, eq=False)
class ModelReferenceState(InverseState):
    """State of the loop."""

    weights: tuple[float, float, float]
    """Weights of the target and of the reading, and a constant in degrees."""
    seen: float
    """Last reading in degrees."""
    model: float
    """Angle of the reference model before the delay."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ModelReference(InverseLoop):
    """Adaptive control that makes the angle follow a reference model.

    v = w_r r + w_y y + w_0, u^2 = Gamma^-1[v], with the reference model
    lambda dy_m/dt = r - y_m and, for e = y - y_m and phi = (r, y, S) / S,

    dw/dt = -gamma e phi / (S (1 + phi . phi)).

    S is the stroke. While the current is at a limit, the model follows the target that would
    have given the applied current.

    References
    ----------
    Song and Li, Mechatronics 9, 1999, pp. 391-410: a reference model around the inverse
    Preisach operator of a piezoceramic actuator. Ioannou and Sun, Robust Adaptive Control,
    1996, section 6.4: the normalised law of adaptation, and dead zone and projection.

    Notes
    -----
    Of responses of 0.4, 0.6 and 1 s and rates of 0.5, 2 and 4 1/s, the defaults settle soonest
    and follow circles best (specimens 1000 to 1002).
    """

    response: float = 0.4
    """lambda: time constant of the reference model, in seconds."""
    adaptation: float = 4.0
    """gamma: rate of adaptation in 1/s; 0 for none."""

    def begin(self, measurement: float = 0.0, current: float = 0.0) -> ModelReferenceState:
        """Return a state that keeps the present current if the reference is the measurement."""
        tracker, angle = self.found(measurement, current)
        ratio = mean_lag(self.wire) / self.response
        weights = (ratio, 1.0 - ratio, angle - measurement)
        past = (measurement,) * self.delay
        return ModelReferenceState(tracker, past, current, weights, measurement, measurement)

    def step(
        self, state: ModelReferenceState, reference: float, measurement: float
    ) -> tuple[float, ModelReferenceState]:
        """Return the next current and state; without a reading, the model's is used."""
        tracker = state.tracker.copy()
        of_target, of_reading, constant = state.weights
        achieved = tracker.push(state.applied**2)
        followed = (achieved - of_reading * state.seen - constant) / of_target
        model = followed + (state.model - followed) * math.exp(-self.interval / self.response)
        models = (model, *state.past)
        seen, weights = models[-1], state.weights
        if math.isfinite(measurement):
            seen = measurement
            weights = self._adapted(state.weights, followed, seen, seen - models[-1])
        v = weights[0] * reference + weights[1] * seen + weights[2]
        current = self.inverse(tracker, v)
        past = models[: self.delay]
        return current, ModelReferenceState(tracker, past, current, weights, seen, model)

    def _adapted(
        self, weights: tuple[float, float, float], target: float, reading: float, error: float
    ) -> tuple[float, float, float]:
        """Return the weights after a difference between reading and reference model.

        One of 0.1 degrees, twice the noise of a sensor, adapts nothing. Weights stay within 0.5 to
        2 times the value of the identified wire: its lag and gain change by less than twofold in
        surroundings in which it still moves.
        """
        low, high = self.wire.operator.range
        # The weight of the target for the identified wire: its lag over that of the model.
        stroke, ratio = high - low, mean_lag(self.wire) / self.response
        beyond = math.copysign(max(abs(error) - 0.1, 0.0), error)
        phi = np.array([target, reading, stroke]) / stroke
        rate = self.adaptation * self.interval * beyond / (stroke * (1.0 + phi @ phi))
        moved = np.array(weights) - rate * phi * (1.0, 1.0, stroke)
        least = (0.5 * ratio, 2.0 * (1.0 - ratio), -stroke)
        most = (2.0 * ratio, 0.5 * (1.0 - ratio), stroke)
        of_target, of_reading, constant = np.clip(moved, least, most).tolist()
        return of_target, of_reading, constant
