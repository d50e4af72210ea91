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
class AdaptiveState:
    """State of the loop."""

    observer: ObserverState
    control: ObserverControl
    """The law with the estimated operator."""
    recursion: RecursiveState
    """Recursion of its weights."""
    free: HeatedState
    identified: HeatedState
    """Estimated and identified wire, simulated with the current and the slow bias."""
    ambient: float
    """Slow bias in A^2: the common part of settled samples."""
    anchor: float
    learnt: float
    """Effective powers in A^2: where the wire has settled at its target, and of the last sample
    used."""
    applied: float
    """Present current in A."""
    still: float = 0.0
    """Seconds for which the wire has been settled at its target."""
    score: float = 0.0
    identified_score: float = 0.0
    """Smoothed absolute errors of the two wires at settled samples, in degrees."""

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
        return AdaptiveState(
            observer=observer,
            control=self.control,
            recursion=self._recursive.begin(model=self.control.wire.operator),
            free=wire,
            identified=wire,
            ambient=observer.estimate.ambient,
            anchor=wire.power,
            learnt=wire.power,
            applied=current,
        )

    def step(
        self, state: AdaptiveState, reference: float, measurement: float
    ) -> tuple[float, AdaptiveState]:
        """Return the current for the next interval and the next state.

        A wire is settled within 0.4 degrees of its target and 1 % of the range of power; samples
        that are nearer than 2 % of this range to the last one add no information.
        """
        before = replace(state.observer, applied=state.applied)
        current, observer = state.control.step(before, reference, measurement)
        for_interval, options = (state.applied**2, self.interval), {"ambient": state.ambient}
        new = replace(
            state,
            observer=observer,
            applied=current,
            free=state.control.wire.step(state.free, *for_interval, **options),
            identified=self.control.wire.step(state.identified, *for_interval, **options),
        )
        power, span = observer.estimate.wire.power, width(self.control.wire)
        near = abs(reference - measurement) < 0.4
        if not (near and abs(power - state.anchor) < 0.01 * span):
            return current, replace(new, still=0.0, anchor=power)
        new = replace(new, still=state.still + self.interval)
        if new.still < self.settling or abs(power - state.learnt) < 0.02 * span:
            return current, new
        return current, self._learnt(new, reference)

    def _learnt(self, state: AdaptiveState, angle: float) -> AdaptiveState:
        """Return the state after a settled sample at an angle.

        Before that, it updates the slow bias with a weight of a fifth, and the errors of the two
        free wires with a weight of a tenth.
        """
        estimate, operator = state.observer.estimate, self.control.wire.operator
        own, first = abs(state.free.angle - angle), abs(state.identified.angle - angle)
        state = replace(
            state,
            ambient=state.ambient + 0.2 * (estimate.ambient - state.ambient),
            learnt=estimate.wire.power,
            score=state.score + 0.1 * (own - state.score),
            identified_score=state.identified_score + 0.1 * (first - state.identified_score),
        )
        if state.score > state.identified_score + self.tolerance:
            recursion = self._recursive.begin(model=operator)
            state = replace(state, recursion=recursion, score=state.identified_score)
            state = self._with(state, operator)
        else:
            state = self._updated(state, angle)
        estimate = replace(estimate, wire=_moved_to(estimate.wire, state.control.wire))
        return replace(state, observer=replace(state.observer, estimate=estimate))

    def _updated(self, state: AdaptiveState, angle: float) -> AdaptiveState:
        """Change the weights to explain the sample, within the limit of one update."""
        memory = state.free.tracker.memory
        before = replace(state.recursion, memory=memory, updates=0)
        after = self._recursive.update(before, memory.u, angle)
        change = after.theta - before.theta
        size, (low, high) = float(np.abs(change).sum()), self.control.wire.operator.range
        if not np.isfinite(size) or size == 0.0:
            return state
        theta = before.theta + min(1.0, self.largest_update * (high - low) / size) * change
        recursion = replace(after, theta=theta)
        learnt = replace(state, recursion=recursion)
        return self._with(learnt, self._recursive.model(recursion))

    def _with(self, state: AdaptiveState, operator: Preisach) -> AdaptiveState:
        """Return the state with another operator, its free wire at the same effective power."""
        wire = replace(self.control.wire, operator=operator)
        control = replace(state.control, wire=wire)
        return replace(state, control=control, free=_moved_to(state.free, wire))


def _moved_to(state: HeatedState, wire: HeatedWire) -> HeatedState:
    """Return a state with the same memory and effective power in another operator."""
    return wire.moved(wire.begin(state.power, state.tracker.memory), state.power)
