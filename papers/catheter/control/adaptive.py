"""Certainty equivalence: control with the newest estimate of the model.

The fast bias of the observer compensates ambient and convection. Errors that differ between
targets, which a bias does not explain, change the weights of the operator: from settled samples
only, in small steps, undone if predictions become worse.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from minorloop.identification.recursive import Recursive, RecursiveState
from minorloop.operators.preisach import Preisach
from minorloop_head.control.controller import width
from minorloop_head.control.observer import Estimate, ObserverControl, ObserverState
from minorloop_head.heated_wire import HeatedState, HeatedWire


@dataclass(frozen=True, eq=False)
class AdaptiveEstimate:
    """Estimate of the model."""

    control: ObserverControl
    """The law with the estimated operator."""
    recursion: RecursiveState
    """Recursion of its weights."""
    free: HeatedState
    identified: HeatedState
    """Estimated and identified wire, simulated with the current and the slow bias."""
    ambient: float
    """Slow bias in A^2: the common part of settled samples."""
    score: float = 0.0
    identified_score: float = 0.0
    """Smoothed absolute errors of these two wires at settled samples, in degrees."""
    updates: int = 0
    rollbacks: int = 0
    """Numbers of changes and of resets of the weights."""


@dataclass(frozen=True, eq=False)
class AdaptiveState:
    """State of the loop."""

    observer: ObserverState
    adapted: AdaptiveEstimate
    still: float
    """Seconds for which the wire has been settled at its target."""
    anchor: float
    learnt: float
    """Effective powers in A^2: at the beginning of that time, and of the last sample used."""
    applied: float
    """Present current in A."""

    @property
    def estimate(self) -> Estimate:
        """Estimate of the observer."""
        return self.observer.estimate


@dataclass(frozen=True, eq=False, kw_only=True)
class AdaptiveControl:
    """Observer control that updates its operator while it runs.

    References
    ----------
    Tan and Baras, Automatica 40, 2004: adaptive inverse control with a recursive density.
    """

    control: ObserverControl
    """The law, with the identified wire."""
    settling: float = 2.0
    """Seconds for which the wire must be settled at its target before a sample is used."""
    forgetting: float = 0.98
    """Weight that a sample keeps per update."""
    prior: float = 1.0
    """Strength of the prior at the present weights, in samples."""
    largest_update: float = 0.02
    """Largest sum of changes of the weights in one update, as a share of the range."""
    tolerance: float = 0.3
    """Degrees by which the estimated wire may predict worse than the identified one before the
    weights are reset."""

    @cached_property
    def _recursive(self) -> Recursive:
        operator = self.control.wire.operator
        return Recursive(
            operator.levels,
            forgetting=self.forgetting,
            prior=self.prior,
            relay=operator.relay,
            diagonal=operator.diagonal,
        )

    @property
    def interval(self) -> float:
        """Time between two steps in seconds."""
        return self.control.interval

    def begin(self, measurement: float = 0.0, current: float = 0.0) -> AdaptiveState:
        """Return the state of a wire that has settled at an angle under a current."""
        observer = self.control.begin(measurement, current)
        wire = observer.estimate.wire
        adapted = AdaptiveEstimate(
            control=self.control,
            recursion=self._recursive.begin(model=self.control.wire.operator),
            free=wire,
            identified=wire,
            ambient=observer.estimate.ambient,
        )
        return AdaptiveState(observer, adapted, 0.0, wire.power, wire.power, current)

    def step(
        self, state: AdaptiveState, reference: float, measurement: float
    ) -> tuple[float, AdaptiveState]:
        """Return the current for the next interval and the next state.

        A wire is settled within 0.4 degrees of its target and 1 % of the range of power; samples
        that are nearer than 2 % of this range to the last one add no information.
        """
        # The two free wires are simulated for an interval.
        adapted, options = state.adapted, {"ambient": state.adapted.ambient}
        for_interval = (state.applied**2, self.interval)
        adapted = replace(
            adapted,
            free=adapted.control.wire.step(adapted.free, *for_interval, **options),
            identified=self.control.wire.step(adapted.identified, *for_interval, **options),
        )
        before = replace(state.observer, applied=state.applied)
        current, observer = adapted.control.step(before, reference, measurement)
        power = observer.estimate.wire.power
        near = abs(reference - measurement) < 0.4
        span = width(self.control.wire)
        if not (near and abs(power - state.anchor) < 0.01 * span):
            return current, AdaptiveState(observer, adapted, 0.0, power, state.learnt, current)
        still = state.still + self.interval
        new = AdaptiveState(observer, adapted, still, state.anchor, state.learnt, current)
        if still < self.settling or abs(power - state.learnt) < 0.02 * span:
            return current, new
        return current, self._learnt(new, reference)

    def _learnt(self, state: AdaptiveState, angle: float) -> AdaptiveState:
        """Return the state after a settled sample at an angle.

        Before that, it updates the slow bias with a weight of a fifth, and the errors of the two
        free wires with a weight of a tenth.
        """
        adapted, estimate = state.adapted, state.observer.estimate
        own, first = abs(adapted.free.angle - angle), abs(adapted.identified.angle - angle)
        adapted = replace(
            adapted,
            ambient=adapted.ambient + 0.2 * (estimate.ambient - adapted.ambient),
            score=adapted.score + 0.1 * (own - adapted.score),
            identified_score=adapted.identified_score + 0.1 * (first - adapted.identified_score),
        )
        if adapted.score > adapted.identified_score + self.tolerance:
            adapted = replace(
                self._with(adapted, self.control.wire.operator),
                recursion=self._recursive.begin(model=self.control.wire.operator),
                score=adapted.identified_score,
                rollbacks=adapted.rollbacks + 1,
            )
        else:
            adapted = self._updated(adapted, angle)
        observer = replace(
            state.observer,
            estimate=replace(estimate, wire=_moved_to(estimate.wire, adapted.control.wire)),
        )
        return replace(state, observer=observer, adapted=adapted, learnt=estimate.wire.power)

    def _updated(self, adapted: AdaptiveEstimate, angle: float) -> AdaptiveEstimate:
        """Change the weights to explain the sample, within the limit of one update."""
        memory = adapted.free.tracker.memory
        before = replace(adapted.recursion, memory=memory, updates=0)
        after = self._recursive.update(before, memory.u, angle)
        change = after.theta - before.theta
        size, (low, high) = float(np.abs(change).sum()), self.control.wire.operator.range
        if not np.isfinite(size) or size == 0.0:
            return adapted
        theta = before.theta + min(1.0, self.largest_update * (high - low) / size) * change
        updates = adapted.updates + 1
        recursion = replace(after, theta=theta, updates=updates)
        learnt = replace(adapted, recursion=recursion, updates=updates)
        return self._with(learnt, self._recursive.model(recursion))

    def _with(self, adapted: AdaptiveEstimate, operator: Preisach) -> AdaptiveEstimate:
        """Return the estimate with another operator, its free wire at the same effective power."""
        wire = replace(self.control.wire, operator=operator)
        control = replace(adapted.control, wire=wire)
        return replace(adapted, control=control, free=_moved_to(adapted.free, wire))


def _moved_to(state: HeatedState, wire: HeatedWire) -> HeatedState:
    """Return a state with the same memory and effective power in another operator."""
    return wire.moved(wire.begin(state.power, state.tracker.memory), state.power)
