"""Drive an actuator to targets with the inverse of a model, in open loop or corrected by a sensor.

The actuator is first saturated, so that the model knows its memory. Then each target is inverted
from the memory that the previous inputs left, and its input is held until the output settles. With
corrections, the error of a hold is added to the output that is inverted, and the target is tried
again. As the next input depends only on the points so far, a resumed run gives the same inputs as
one that was not stopped.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Self

import msgspec
import numpy as np
import numpy.typing as npt

from minorloop._modelschema import AnyModel, StaticModel, build, kind_of, plain
from minorloop.arrays import FloatArray, as_finite, as_samples
from minorloop.errors import (
    InstrumentError,
    NotInvertibleError,
    ParameterError,
    UnreachableError,
    are,
    counted,
)
from minorloop.lab.actuator import Channel
from minorloop.lab.plan import Plan
from minorloop.lab.store import Point
from minorloop.operators.relays import RelayModel

_SURE = 2.0
"""An error below this many standard deviations of the measured value is not corrected."""


_LEAST_GAIN, _MOST_GAIN = 1 / 3, 3.0
"""Bounds of the gain of the measured over the predicted outputs, from saturation on; outside them
the sensor or its conversion is wrong."""
ALLOWED_ERRORS, LEAST_ALLOWED = 3.0, 0.05
"""Errors of the model, and share of its range, that the error of a missed target exceeds."""
_CLEAR = 10.0
"""Standard deviations of a measured value that predicted outputs must span to check the gain."""


class MismatchError(InstrumentError):
    """The sensor does not match the model; the same points give the same error again."""


@dataclass(frozen=True)
class Arrival:
    """How one target was reached."""

    target: float
    """The target output, in its unit, from the zero of the model."""
    input: float
    """The input that was applied last."""
    achieved: float
    """The settled output, less the offset of the sensor; NaN where nothing was measured."""
    sd: float
    """Its standard deviation."""
    tries: int
    """Number of holds for this target."""
    verdict: str
    """Of the last hold: ``settled``, ``extrapolated`` or ``unsettled``."""

    @property
    def error(self) -> float:
        """Achieved minus target."""
        return self.achieved - self.target


@dataclass(frozen=True)
class DriveResult:
    """Results of a drive so far."""

    offset: float
    """Output measured in saturation minus that of the model; NaN until it is measured."""
    arrivals: tuple[Arrival, ...]
    """The targets that are done, in order."""
    allowed: float = float("inf")
    """Error of a target beyond which it counts as missed."""
    corrections: int = 0
    """Most further holds of a target."""
    width: float = float("inf")
    """Range of the outputs of the model."""
    remedy: str = ""
    """First advice about missed targets; if empty, to correct or to hold longer."""

    @property
    def rows(self) -> list[list[str]]:
        """A row of a table for each target: target, input, output, error, and how it was met."""
        return [
            [
                *(f"{x:.6g}" for x in (one.target, one.input, one.achieved)),
                *(f"{one.error:+.3g}", f"{one.sd:.2g}", str(one.tries), one.verdict),
            ]
            for one in self.arrivals
        ]

    @property
    def errors(self) -> FloatArray:
        """(n,) achieved minus target; NaN where nothing was measured."""
        return np.array([arrival.error for arrival in self.arrivals])

    @property
    def missed(self) -> list[int]:
        """Targets whose error is beyond ``allowed`` and twice its standard deviation."""
        return [
            index
            for index, arrival in enumerate(self.arrivals)
            if abs(arrival.error) > max(self.allowed, _SURE * arrival.sd)
        ]

    @property
    def advice(self) -> list[str]:
        """Advice about a large offset of the sensor and about missed targets."""
        return [*self._about_offset(), *self._about_missed()]

    def _about_offset(self) -> list[str]:
        share = abs(self.offset) / self.width
        # Share of the model's range above which an offset of the sensor is reported
        if not share > 0.25:
            return []
        return [
            f"the sensor reads {self.offset:+.4g} more than the model in saturation, which is "
            f"{share:.0%} of the range of the model: this is expected if the zero of the sensor "
            "has moved since the model was measured; otherwise check the offset of its conversion, "
            "and that the actuator was saturated"
        ]

    def _about_missed(self) -> list[str]:
        if not (missed := self.missed):
            return []
        worst = max(missed, key=lambda index: abs(self.arrivals[index].error))
        count = len(self.arrivals)
        more = self.remedy or (
            f"correct more often (--corrections, now {self.corrections}), hold longer (--hold)"
            if self.corrections
            else "correct by the sensor (--corrections), hold longer (--hold)"
        )
        return [
            f"{len(missed)} of {counted(count, 'target')} ended off by more than "
            f"{self.allowed:.3g}, the error to expect of this model; the worst is target "
            f"{worst + 1}, by {self.arrivals[worst].error:+.3g}: {more}, "
            "check the conversion of the sensor, or identify this actuator anew"
        ]

    def summary(self) -> dict[str, float | None]:
        """Return rms and largest error over the measured targets; None if there are none."""
        errors = self.errors[np.isfinite(self.errors)]
        if not errors.size:
            return {"rms": None, "worst": None}
        return {"rms": float(np.sqrt(np.mean(errors**2))), "worst": float(np.abs(errors).max())}

    def to_dict(self) -> dict[str, Any]:
        """Return offset, errors, and every target with the output achieved, ready for JSON."""
        targets = [asdict(arrival) for arrival in self.arrivals]
        missed = {"missed": self.missed}
        return {"offset": self.offset, **self.summary(), **missed, "targets": targets}


class Chooser:
    """Base class of drives: converts their fields to and from JSON, for a store."""

    @classmethod
    def from_json(cls, fields: dict[str, Any], **others: Any) -> Self:
        """Return the drive that ``to_json`` described; ``others`` are the fields it left out."""
        model = build(msgspec.convert(fields["model"], AnyModel))
        return cls(**{**fields, "model": model}, **others)

    def to_json(self) -> dict[str, Any]:
        """Return the fields but ``written`` and ``covered``, ready for JSON."""
        known: dict[str, Any] = {**vars(self)}
        model = known["model"]
        known |= {"model": {"kind": kind_of(model), **plain(model)}}
        known |= {"targets": known["targets"].tolist()}
        return {name: known[name] for name in known if name not in ("written", "covered")}


@dataclass(frozen=True, eq=False)
class TargetDrive(Chooser):
    """Chooses the inputs that bring an actuator to targets.

    Raises a `ParameterError` if a parameter is out of range; a `NotInvertibleError` if the model
    has no exact inverse.
    """

    model: Any
    """Preisach, PrandtlIshlinskii, GeneralisedPrandtlIshlinskii or Polynomial. Maps settled inputs
    to settled outputs."""
    targets: FloatArray
    """Shape (n,). Target outputs, in order, in the unit of the output."""
    saturation: float
    """Input that saturates the actuator before the first target."""
    corrections: int = 0
    """Most further holds of a target, which correct its error by the sensor; 0 is open loop."""
    within: float = 0.0
    """An error up to this is not corrected, in the unit of the output."""
    absolute: bool = False
    """Whether targets count from the zero of the sensor. Otherwise they count from that of the
    model, and the offset of the sensor is subtracted from what it measures."""
    nrmse: float = 0.0
    """Error of the model, over the range of its output: a target that is off by more than three
    times this, and a twentieth of the range of the model, counts as missed."""
    written: Callable[[float], float] = field(default=float)
    """Returns the input that the source really gives for a requested one."""
    covered: str = ""
    """Readings that the conversion of the sensor covers, for a message; empty without one."""

    def __post_init__(self) -> None:
        if isinstance(self.model, RelayModel):
            raise NotInvertibleError(
                "a relay-by-relay model has no exact inverse; identify a Preisach model on the "
                "same levels"
            )
        object.__setattr__(self, "targets", np.atleast_1d(as_samples(self.targets, name="targets")))
        as_finite("saturation", self.saturation)
        if self.targets.size < 1:
            raise ParameterError("there are no targets; give one or more")
        if not 0 <= self.corrections <= 100:
            raise ParameterError(f"corrections is {self.corrections}; give 0 to 100")
        if as_finite("nrmse", self.nrmse) < 0:
            raise ParameterError(f"nrmse is {self.nrmse}; give an error >= 0")
        if not (np.isfinite(self.within) and self.within >= 0):
            raise ParameterError(f"within is {self.within}; give a finite error of at least 0")

    def plan(self, hold: float, *, input: str, **settings: Any) -> Plan:
        """Return the plan of a run: saturation for twice the hold, then holds without inputs yet.

        Raises a `ParameterError` if the hold is not a positive number, or as in `Plan`.

        ``hold``: longest hold, in seconds; ``input``: name and unit of the input; ``**settings``:
        as in `Plan`.
        """
        if not (np.isfinite(hold) and hold > 0):
            raise ParameterError(f"hold is {hold:g} s (--hold); give a positive number of seconds")
        count = self.targets.size * (1 + self.corrections)
        levels = np.r_[self.saturation, np.full(count, np.nan)]
        holds = np.r_[2 * hold, np.full(count, hold)]
        return Plan(levels, holds, input=input, **settings)

    def check(self, channel: Channel) -> None:
        """Refuse a model or targets beyond this actuator, before anything is applied.

        Raises a `ParameterError` if the limits of the actuator do not include the saturation of the
        model; an `UnreachableError` if targets are beyond what the model reaches within the limits.
        Targets from the zero of the sensor are not checked: its offset is not known yet.
        """
        if not channel.low <= self.saturation <= channel.high:
            raise ParameterError(
                f"the model is saturated at {self.saturation:g} {channel.unit}, and {channel.name} "
                f"is limited to [{channel.low:g}, {channel.high:g}]; identify a model within the "
                "limits, or give another saturation"
            )
        if self.absolute:
            return
        low, high = self.reach(channel)
        outside = np.flatnonzero((self.targets < low) | (self.targets > high))
        if outside.size:
            raise UnreachableError(self._outside(outside, low, high))

    def reach(self, channel: Channel) -> tuple[float, float]:
        """Return the least and the greatest output from saturation, within the limits."""
        memory, first = _saturated(self.model, self.saturation)
        top = max(self.saturation, min(channel.high, _highest(self.model, channel)))
        last = float(self.model.step(memory, top)[0])
        return min(first, last), max(first, last)

    def choose(self, points: Sequence[Point]) -> float | None:
        """Return the input to hold next; None when every target is done.

        Raises a `MismatchError` if the sensor does not match the model: it measured nothing in
        saturation, its offset is larger than the range of the model, or it moves by less than a
        third or more than three times what the model predicts.

        ``points``: the points so far; the same points give the same input.
        """
        if not points:
            return self.saturation
        state = self._replayed(points)
        self._check_offset(state.offset)
        self._check_gain(points, state.predicted)
        if len(state.arrivals) == self.targets.size:
            return None
        aim = self._target(len(state.arrivals), state.offset) + state.correction
        found = self.model.invert([aim], state.memory, "clip").u[0]
        return self.written(float(found))

    @property
    def _width(self) -> float:
        """Range of the outputs of the model; infinite where it has no bounds."""
        low, high = self.model.range
        return float(high - low)

    def _check_offset(self, offset: float) -> None:
        """Refuse a sensor whose offset is unknown, or larger than the range of the model."""
        if not np.isfinite(offset):
            covered = f", which covers {self.covered}" if self.covered else ""
            raise MismatchError(
                "nothing was measured in saturation; check the sensor, its range and its "
                f"conversion{covered}"
            )
        if abs(offset) > self._width:
            raise MismatchError(
                f"the sensor reads {offset:+.4g} more than the model in saturation, but the range "
                f"of the model is only {self._width:.4g}; check the unit and the conversion of the "
                "sensor, such as the geometry of a laser, and that this is the model's actuator"
            )

    def _check_gain(self, points: Sequence[Point], predicted: Sequence[float]) -> None:
        """Refuse a sensor that moves by much less or much more than the model."""
        known = np.isfinite([point.value for point in points])
        y = np.array([point.value for point in points])[known]
        x = np.array(predicted)[known]
        x, y = x - x.mean(), y - y.mean()
        noise = max((point.sd for point in points if np.isfinite(point.sd)), default=0.0)
        whole = self._width if np.isfinite(self._width) else float(np.ptp(self.targets))
        # Share of the model's range that the predicted outputs must span for that gain to count
        if np.ptp(x) <= max(0.1 * whole, _CLEAR * noise):
            return
        gain = float(x @ y / (x @ x))
        if _LEAST_GAIN <= gain <= _MOST_GAIN:
            return
        sign = ", with the opposite sign" if gain < -_LEAST_GAIN else ""
        raise MismatchError(
            f"the measured output moves by {gain:.3g} times what the model predicts{sign}; check "
            "the unit and the conversion of the sensor, such as its gain, and that "
            "this is the model's actuator"
        )

    def result(self, points: Sequence[Point]) -> DriveResult:
        """Return the results of the points so far."""
        state = self._replayed(points)
        allowed = max(ALLOWED_ERRORS * self.nrmse, LEAST_ALLOWED) * self._width
        return DriveResult(
            state.offset,
            tuple(state.arrivals),
            max(allowed, self.within),
            self.corrections,
            self._width,
        )

    def _replayed(self, points: Sequence[Point]) -> _DriveState:
        memory, predicted = _saturated(self.model, self.saturation)
        state = _DriveState(memory, [predicted])
        if points:
            state.offset = points[0].value - predicted
        for point in points[1:]:
            self._take(state, point)
        return state

    def _take(self, state: _DriveState, point: Point) -> None:
        """Count a hold: the memory that it leaves, and whether its target is done."""
        predicted, state.memory = self.model.step(state.memory, point.input)
        state.predicted.append(float(predicted))
        state.tries += 1
        target = float(self.targets[len(state.arrivals)])
        achieved = point.value - (0.0 if self.absolute else state.offset)
        error = achieved - target
        near = abs(error) <= max(self.within, _SURE * point.sd)
        if not near and self.corrections:
            if np.isfinite(error):
                state.correct(error, achieved, float(predicted))
            if state.tries <= self.corrections:
                return
        state.arrivals.append(
            Arrival(target, point.input, achieved, point.sd, state.tries, point.verdict)
        )
        state.tries, state.before = 0, None

    def _target(self, index: int, offset: float) -> float:
        """Return a target from the zero of the model."""
        shift = offset if self.absolute and np.isfinite(offset) else 0.0
        return float(self.targets[index]) - shift

    def _outside(self, outside: npt.NDArray[np.intp], low: float, high: float) -> str:
        first = int(outside[0])
        least, most = float(self.targets.min()), float(self.targets.max())
        said = (
            f"the target at index {first} is {self.targets[first]:g} and the actuator reaches "
            f"{low:g} to "
            f"{high:g} ({outside.size} of {self.targets.size} targets {are(outside.size)} out of "
            "reach); "
        )
        if most - least > high - low:
            return said + "the targets span more than that: give nearer ones"
        shift = low - least if least < low else high - most
        return said + f"adding {shift:.6g} to every target would bring them in"


@dataclass
class _DriveState:
    """State of a drive after some points."""

    memory: Any
    predicted: list[float]
    offset: float = float("nan")
    correction: float = 0.0
    tries: int = 0
    before: tuple[float, float] | None = None
    arrivals: list[Arrival] = field(default_factory=list)

    def correct(self, error: float, achieved: float, predicted: float) -> None:
        """Shift the output that is inverted, by the secant through the last two holds."""
        gain = 1.0
        if self.before is not None and predicted != self.before[1]:
            gain = (achieved - self.before[0]) / (predicted - self.before[1])
        self.before = achieved, predicted
        # Bounds of the movement of the actuator over that of the model. A smaller one would make
        # corrections explode; more than ten is not seen on reversals of a reversible actuator.
        self.correction -= error / min(max(gain, 0.5), 10.0)


def saturation_of(model: StaticModel, channel: Channel) -> float:
    """Return the input that saturates a model: its lowest level, or the actuator's lower limit."""
    levels = getattr(model, "levels", None)
    low = getattr(model, "low", channel.low) if levels is None else levels[0]
    return float(low)


def _highest(model: Any, channel: Channel) -> float:
    levels = getattr(model, "levels", None)
    return float(getattr(model, "high", channel.high) if levels is None else levels[-1])


def _saturated(model: Any, saturation: float) -> tuple[Any, float]:
    """Return the memory and the output of a model in saturation."""
    output, memory = model.step("negative", saturation)
    return memory, float(output)
