"""The achieved power of a wire and the bias of its surroundings, observed; and control with them.

The model runs on the current that was applied. Where its angle and the reading differ, the
effective power is moved along the operator towards the reading, and the bias that ambient and
convection add is learnt slowly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from minorloop.head.control.controller import Loop, heating, mean_slope, within
from minorloop.head.control.heating import HeatedState, HeatedWire

_FLATTEST = 0.3
_LARGEST_ERROR = 0.45
_MOST_BIAS = 0.6


@dataclass(frozen=True, eq=False)
class Estimate:
    """What is believed about a wire.

    Parameters
    ----------
    wire : HeatedState
        Effective power and memory now.
    ambient : float
        Power that the surroundings add, in A^2.
    error : float
        Smoothed difference between reading and model, in degrees.
    past : tuple of float
        Angles of the model, newest first, as old as the delay.
    """

    wire: HeatedState
    ambient: float
    error: float
    past: tuple[float, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class PowerObserver(Loop):
    """Observer of the effective power and of the bias of the surroundings.

    Parameters
    ----------
    wire : HeatedWire
        The model.
    correction : float
        How fast the effective power follows the readings, in 1/s.
    learning : float
        How fast the bias is learnt, in 1/s.
    smoothing : float
        Time constant of the filter on the difference between reading and model, in seconds.
    dead_band : float
        Differences up to this many degrees are taken for noise.
    interval, delay, highest
        As in `Loop`.

    Raises
    ------
    ParameterError
        If a number is out of its range.

    Notes
    -----
    Where a branch is flat, no power explains a difference. Slopes are therefore not taken
    below 0.3 of the mean slope of the operator.
    """

    wire: HeatedWire
    correction: float = 3.75
    learning: float = 3.75
    smoothing: float = 0.044
    dead_band: float = 0.05

    def __post_init__(self) -> None:
        super().__post_init__()
        within("correction", self.correction, 0.0, 1.0 / self.interval, "1/s")
        within("learning", self.learning, 0.0, 1.0 / self.interval, "1/s")
        within("smoothing", self.smoothing, 0.0, 10.0, "s")
        within("dead_band", self.dead_band, 0.0, 10.0, "degrees")

    def found(self, measurement: float = 0.0, current: float = 0.0) -> Estimate:
        """What to believe of a wire that is found settled at an angle under a current."""
        wire = self.wire.found(current**2, measurement)
        return Estimate(wire, wire.power - current**2, 0.0, (wire.angle,) * self.delay)

    def update(self, estimate: Estimate, current: float, measurement: float) -> Estimate:
        """What to believe one interval later, the current having been on.

        Parameters
        ----------
        estimate : Estimate
            Before.
        current : float
            In A.
        measurement : float
            Reading in degrees; NaN where there is none.
        """
        wire = self.wire.step(estimate.wire, current**2, self.interval, ambient=estimate.ambient)
        seen = (wire.angle, *estimate.past)
        ambient, error = estimate.ambient, 0.0
        if math.isfinite(measurement):
            error = self._smoothed(estimate.error, measurement - seen[-1])
            wire, ambient = self._corrected(wire, ambient, error)
        return Estimate(wire, ambient, error, (wire.angle, *seen[1:])[: self.delay])

    def _smoothed(self, before: float, now: float) -> float:
        keep = math.exp(-self.interval / self.smoothing) if self.smoothing > 0 else 0.0
        return now + (before - now) * keep

    def _corrected(
        self, wire: HeatedState, ambient: float, error: float
    ) -> tuple[HeatedState, float]:
        """Wire and bias after a difference between reading and model."""
        beyond = math.copysign(max(abs(error) - self.dead_band, 0.0), error)
        if beyond == 0.0:
            return wire, ambient
        slope = _FLATTEST * mean_slope(self.wire)
        towards = self.correction * self.interval * beyond
        change = wire.tracker.aim(wire.angle + towards) - wire.power
        most = abs(towards) / slope
        moved = self.wire.moved(wire, wire.power + min(max(change, -most), most))
        learnt = min(max(beyond, -_LARGEST_ERROR), _LARGEST_ERROR) / slope
        bound = _MOST_BIAS * self.highest**2
        ambient += self.learning * self.interval * learnt
        return moved, min(max(ambient, -bound), bound)


@dataclass(frozen=True, eq=False)
class ObserverState:
    """What the loop remembers: what it believes of the wire, and the current that is on."""

    estimate: Estimate
    applied: float


@dataclass(frozen=True, eq=False, kw_only=True)
class ObserverControl(PowerObserver):
    """Control by the inverse operator and the inverse lag, from the state that is observed.

    Parameters
    ----------
    response : float
        Time constant in seconds with which the effective power is to follow, as far as the
        current allows.
    steepness : float
        Slope of the operator, over its mean slope, by which a small error is turned into power
        at most; it keeps the loop calm where the operator is flat.
    wire, correction, learning, smoothing, dead_band, interval, delay, highest
        As in `PowerObserver`.

    Raises
    ------
    ParameterError
        If a number is out of its range.
    """

    response: float = 0.4
    steepness: float = 1.33

    def __post_init__(self) -> None:
        super().__post_init__()
        within("response", self.response, self.interval, 60.0, "s")
        within("steepness", self.steepness, 0.01, 1e6)

    def begin(self, measurement: float = 0.0, current: float = 0.0) -> ObserverState:
        """State of a wire that is found settled at an angle under a current."""
        return ObserverState(self.found(measurement, current), current)

    def step(
        self, state: ObserverState, reference: float, measurement: float
    ) -> tuple[float, ObserverState]:
        """Current for the next interval, and the state after it."""
        estimate = self.update(state.estimate, state.applied, measurement)
        power = heating(
            self.wire,
            estimate.wire,
            reference,
            response=self.response,
            ambient=estimate.ambient,
            steepest=self.steepness * mean_slope(self.wire),
        )
        current = self.current(power)
        return current, ObserverState(estimate, current)
