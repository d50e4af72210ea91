"""Observer of the effective power of a wire and of the bias of its surroundings, and control.

The model is simulated with the current that was applied. The difference between its angle and the
reading moves the effective power along the operator, and slowly changes the bias that ambient and
convection add. Inside a loop, where the wire hardly moves, it only adds an offset to the angle, so
that the observer still knows at which power the wire will move on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.operators.tracker import Tracker
from minorloop_head.control import _observer_kernels as _kernels
from minorloop_head.control.controller import Loop, heating, mean_slope, within
from minorloop_head.heated_wire import SOLVES, HeatedState, HeatedWire

_FLATTEST = 0.3
"""Least slope over the mean slope of the operator with which a power is corrected."""
_MOST_OFFSET = 0.3
"""Largest difference in degrees that may be an offset: a larger one shows that the wire is
elsewhere in its loop."""
_LARGEST_ERROR = 0.45
"""Differences above this many degrees change the bias no faster: they are motion."""
_CALM = 0.6
"""Largest product of the correction and the age of readings without oscillation: an integral with a
delay oscillates from 1.6 on, and the bias takes a part of that."""
_MOST_BIAS = 0.6
"""Largest bias as a share of full power."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """Estimate of a wire."""

    wire: HeatedState
    """Effective power and memory now."""
    ambient: float
    """Power that the surroundings add, in A^2."""
    error: float
    """Smoothed difference between reading and model, in degrees."""
    past: tuple[float, ...]
    """Angles of the model, newest first, up to the age of a reading."""
    offset: float = 0.0
    """Part of the angle less that of the model that no power explains, in degrees."""
    way: float = 0.0
    """Change of the effective power in the last interval, in A^2."""

    @property
    def angle(self) -> float:
        """Angle of the wire now, in degrees."""
        return self.wire.angle + self.offset

    @property
    def expected(self) -> float:
        """Angle expected in the reading now, in degrees, for a predicted estimate."""
        return self.past[-1] + self.offset

    @property
    def values(self) -> FloatArray:
        """Its numbers (6,) in the order of the compiled steps."""
        power, angle = self.wire.power, self.wire.angle
        return np.array([power, angle, self.ambient, self.error, self.offset, self.way])


@dataclass(frozen=True, eq=False, kw_only=True)
class PowerObserver(Loop):
    """Observer of the effective power and of the bias of the surroundings.

    Raises a `ParameterError` if a number is out of its range.

    Notes
    -----
    The power explains a share of a difference: the slope of the branch, in the direction in which
    the power moves, over the mean slope of the operator, at most 1. An offset of the angle, up to
    0.3 degrees, explains the rest, and decays where the branch is steep. The slope for the
    correction of the power is at least 0.3 of the mean one.
    """

    wire: HeatedWire
    """The model."""
    correction: float = 3.75
    """Rate at which the effective power follows the readings, in 1/s."""
    learning: float = 3.75
    """Rate at which the bias changes, in 1/s."""
    smoothing: float = 0.044
    """Time constant of the filter on the difference between reading and model, in seconds."""
    dead_band: float = 0.05
    """Differences up to this many degrees count as noise."""

    def __post_init__(self) -> None:
        super().__post_init__()
        within("correction", self.correction, 0.0, 1.0 / self.interval, "1/s")
        within("learning", self.learning, 0.0, 1.0 / self.interval, "1/s")
        within("smoothing", self.smoothing, 0.0, 10.0, "s")
        within("dead_band", self.dead_band, 0.0, 10.0, "degrees")

    def later(self, steps: int) -> Self:
        """Return the loop for readings that are older by some intervals; states remain valid.

        It follows them more slowly: they show a correction only after their age.
        """
        found = super().later(steps)
        most = _CALM / max(found.delay * self.interval, 1e-9)
        slower = min(most / max(self.correction, 1e-9), 1.0)
        return replace(
            found, correction=slower * self.correction, learning=slower**2 * self.learning
        )

    def found(self, measurement: float = 0.0, current: float = 0.0) -> Estimate:
        """Return the estimate of a wire that has settled at an angle under a current."""
        wire = self.wire.found(current**2, measurement)
        return Estimate(wire, wire.power - current**2, 0.0, (wire.angle,) * self.delay)

    def update(self, estimate: Estimate, current: float, measurement: float) -> Estimate:
        """Return the estimate one interval later, under a current.

        ``estimate``: before. ``current``: in A. ``measurement``: reading in degrees; NaN where
        there is none.
        """
        return self.corrected(self.predicted(estimate, current), measurement)

    def predicted(self, estimate: Estimate, current: float) -> Estimate:
        """Return the estimate one interval later, under a current, before its reading."""
        tracker, values = estimate.wire.tracker.copy(), estimate.values
        tracker.run(_kernels.predict, self.constants, values, current**2)
        past = (float(values[_kernels.ANGLE]), *estimate.past)
        return _estimate(values, tracker, past)

    def corrected(self, predicted: Estimate, measurement: float) -> Estimate:
        """Return a predicted estimate after its reading, NaN where there is none."""
        past = predicted.past
        if not math.isfinite(measurement):
            return replace(predicted, error=0.0, past=past[: self.delay])
        tracker, values = predicted.wire.tracker.copy(), predicted.values
        off = measurement - predicted.expected
        tracker.run(_kernels.correct, self.wire.operator.range, self.gains, values, off)
        past = (float(values[_kernels.ANGLE]), *past[1:])[: self.delay]
        return _estimate(values, tracker, past)

    @cached_property
    def constants(self) -> tuple[float, float, float, float]:
        """Constants of the wire, for the compiled steps."""
        return self.wire.lag, self.wire.latent, self.interval, float(SOLVES)

    @cached_property
    def gains(self) -> tuple[float, ...]:
        """Constants of a correction, for the compiled steps.

        They are the shares of a difference by which the power and the bias change in an interval;
        the weight of the old value in the filter; dead band in degrees; mean and least slope in
        degrees per A^2; offset and largest difference in degrees; largest bias in A^2.
        """
        mean = mean_slope(self.wire)
        return (
            self.correction * self.interval,
            self.learning * self.interval,
            math.exp(-self.interval / self.smoothing) if self.smoothing > 0 else 0.0,
            self.dead_band,
            mean,
            _FLATTEST * mean,
            _MOST_OFFSET,
            _LARGEST_ERROR,
            _MOST_BIAS * self.highest**2,
        )


def _estimate(values: FloatArray, tracker: Tracker, past: tuple[float, ...]) -> Estimate:
    power, angle, ambient, error, offset, way = values.tolist()
    return Estimate(HeatedState(power, angle, tracker), ambient, error, past, offset, way)


@dataclass(frozen=True, eq=False)
class ObserverState:
    """State of the loop: the estimate of the wire, and the present current."""

    estimate: Estimate
    applied: float


@dataclass(frozen=True, eq=False, kw_only=True)
class ObserverControl(PowerObserver):
    """Control by the inverse operator and the inverse lag, from the observed state.

    Raises a `ParameterError` if a number is out of its range.
    """

    response: float = 0.4
    """Time constant in seconds with which the effective power follows, within the limits of the
    current."""
    steepness: float = 1.33
    """Largest power for a small error, as the slope of the operator over its mean slope; it keeps
    the loop calm where the operator is flat."""

    def __post_init__(self) -> None:
        super().__post_init__()
        within("response", self.response, self.interval, 60.0, "s")
        within("steepness", self.steepness, 0.01, 1e6)

    def begin(self, measurement: float = 0.0, current: float = 0.0) -> ObserverState:
        """Return the state of a wire that has settled at an angle under a current."""
        return ObserverState(self.found(measurement, current), current)

    def step(
        self, state: ObserverState, reference: float, measurement: float
    ) -> tuple[float, ObserverState]:
        """Return the current for the next interval and the next state."""
        estimate = self.update(state.estimate, state.applied, measurement)
        current = self.toward(estimate, reference)
        return current, ObserverState(estimate, current)

    def toward(self, estimate: Estimate, reference: float) -> float:
        """Return the current in A that drives a wire to an angle in degrees, within the limits."""
        power = heating(
            self.wire,
            estimate.wire,
            reference - estimate.offset,
            response=self.response,
            ambient=estimate.ambient,
            steepest=self.steepness * mean_slope(self.wire),
        )
        return self.current(power)
