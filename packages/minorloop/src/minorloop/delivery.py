"""Reach targets quickly with the inverse of a model with after-effect, and stay there.

The actuator is first saturated until it has settled, so that the model knows its state. Then each
interval gets a new input, with which the output meets the target at the end of the interval in
spite of creep. Thus a target is reached within one interval and kept. Readings of the sensor are
not used, only compared with the targets afterwards.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from minorloop.arrays import FloatArray, as_finite, as_samples, as_seconds
from minorloop.drive import (
    ALLOWED_ERRORS,
    LEAST_ALLOWED,
    Arrival,
    Chooser,
    DriveResult,
    TargetDrive,
)
from minorloop.errors import ParameterError
from minorloop.lab.actuator import Channel
from minorloop.lab.plan import FEWEST, Plan
from minorloop.lab.store import Point
from minorloop.operators.after_effect import AfterEffect, TimedTracker

_MOST_INTERVALS = 10_000
"""Most intervals of a delivery, as all previous inputs are simulated again before each."""
_REMEDY = "give longer intervals (--every), in which more can be reached"
_SAMPLES = 4 * FEWEST
"""Samples of an interval; a line through the last quarter gives the output at its end."""


@dataclass(frozen=True, eq=False)
class Delivery(Chooser):
    """Chooses inputs that bring an actuator to each target within an interval, and keep it there.

    Raises a `ParameterError` if the model has no after-effect, or a number is out of range; a
    `NotInvertibleError` if the model is not monotone.
    """

    model: AfterEffect
    """The model."""
    targets: FloatArray
    """Shape (n,). Target outputs, in order, in the unit of the output."""
    every: float
    """Interval in seconds."""
    hold: float
    """How long each target is kept, in seconds: one interval or more."""
    saturation: float
    """Input that saturates the actuator before the first target."""
    low: float
    high: float
    """``low`` and ``high``: least and greatest input of the actuator."""
    nrmse: float = 0.0
    """Error of the model, over the range of its output; see `TargetDrive`."""
    written: Callable[[float], float] = field(default=float)
    """Returns the input that the source really gives for a requested one."""

    def __post_init__(self) -> None:
        if not isinstance(self.model, AfterEffect):
            raise ParameterError(
                f"the model is a {type(self.model).__name__}, whose output does not change while "
                "its input is held; identify one with creep (--law viscosity), or leave --every out"
            )
        self.model.require_monotone()
        object.__setattr__(self, "targets", np.atleast_1d(as_samples(self.targets, name="targets")))
        for name in ("saturation", "low", "high", "nrmse"):
            as_finite(name, getattr(self, name))
        as_seconds("every", self.every)
        if as_seconds("hold", self.hold) < self.every:
            raise ParameterError(
                f"a target is held for {self.hold:g} s and its input renewed every {self.every:g} "
                "s; give a hold (--hold) of one interval (--every) or more"
            )
        if self.targets.size * self.intervals > _MOST_INTERVALS:
            raise ParameterError(
                f"{self.targets.size} targets take {self.targets.size * self.intervals} intervals "
                f"of {self.every:g} s, more than the limit of {_MOST_INTERVALS}; give longer "
                "intervals (--every) or shorter holds (--hold)"
            )

    @property
    def intervals(self) -> int:
        """Number of intervals of each target."""
        return max(round(self.hold / self.every), 1)

    @property
    def settling(self) -> float:
        """Seconds in saturation."""
        slowest = max([self.model.settling, *self.model.times], default=0.0)
        # After five time constants, less than 1 % of the slowest creep is left
        return max(5.0 * slowest, 2 * self.hold)

    def plan(self, *, input: str) -> Plan:
        """Return the plan of a run: the saturation, then intervals without inputs yet.

        The name and unit of the input are as of `TargetDrive.plan`.
        """
        count = self.targets.size * self.intervals
        holds = np.r_[self.settling, np.full(count, self.every)]
        interval = self.every / _SAMPLES
        return Plan(
            np.r_[self.saturation, np.full(count, np.nan)],
            holds,
            shortest=holds,
            window=FEWEST * interval,
            # Any output counts as settled, but an interval ends only after its time
            tolerance=1e300,
            sample_interval=interval,
            input=input,
        )

    def check(self, channel: Channel) -> None:
        """Refuse targets that the actuator never reaches, before anything is applied.

        Raises a `ParameterError` or an `UnreachableError` as `TargetDrive.check`, for the settled
        model.
        """
        TargetDrive(self.model.settled, self.targets, self.saturation).check(channel)

    def choose(self, points: Sequence[Point]) -> float | None:
        """Return the next input, as of `TargetDrive.choose`; None when every target is done."""
        if not points:
            return self.saturation
        done = len(points) - 1
        if done == self.targets.size * self.intervals:
            return None
        tracker = self._followed(points)[0]
        if (gap := _gap(*points[-2:])) > 0:  # there will be another such gap
            tracker.push(points[-1].input, gap)
        found = tracker.aim(float(self.targets[done // self.intervals]), self.every, "clip")
        return self.written(min(max(found, self.low), self.high))

    def result(self, points: Sequence[Point]) -> DriveResult:
        """Return the results so far: for each target, those at the end of its first interval."""
        low, high = self.model.range
        width = high - low
        _, predicted = self._followed(points)
        offset = points[0].value - predicted[0] if points else float("nan")
        allowed = max(ALLOWED_ERRORS * self.nrmse, LEAST_ALLOWED) * width
        arrivals = []
        for index, target in enumerate(self.targets.tolist()):
            first = 1 + index * self.intervals
            part = points[first : first + self.intervals]
            if part:
                errors = [point.value - offset - target for point in part]
                worst = max(map(abs, errors))
                said = f"within {worst:.2g} for {part[-1].t - points[first - 1].t:.4g} s"
                arrivals.append(
                    Arrival(target, part[0].input, target + errors[0], part[0].sd, len(part), said)
                )
        return DriveResult(offset, tuple(arrivals), allowed, 0, width, _REMEDY)

    def _followed(self, points: Sequence[Point]) -> tuple[TimedTracker, list[float]]:
        """Return the model after the points, and its outputs at the end of each.

        In saturation it has settled. Between two holds, the input of the first continues.
        """
        settled, memory = self.model.settled.step("negative", self.saturation)
        tracker, predicted = self.model.track(memory), [float(settled)]
        for before, point in itertools.pairwise(points):
            if (gap := _gap(before, point)) > 0:
                tracker.push(before.input, gap)
            predicted.append(tracker.push(point.input, point.held))
        return tracker, predicted


def _gap(before: Point, point: Point | None = None) -> float:
    """Seconds between two holds, while the first input continues; 0 if it is a rounding error."""
    if point is None:
        return 0.0
    gap = point.t - before.t - point.held
    # Largest rounding error, as a share of the second hold
    return gap if gap > 1e-9 * point.held else 0.0
