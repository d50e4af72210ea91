"""Check of the readings of a wire: lost, stuck, implausible, against the model, or reversed.

The greatest slope of the operator and the constants of the heat bound the rate of a wire. Readings
that jump further are not trusted until they jump back or agree with the model. Readings that fall
below those of a cold wire while it is heated have the wrong sign.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, NamedTuple, TypeAlias

from minorloop.errors import ParameterError
from minorloop_head.control.controller import Loop, width, within
from minorloop_head.heated_wire import HeatedWire

Fault: TypeAlias = Literal["", "lost", "stuck", "implausible", "unconfirmed", "reversed", "late"]
ASTRAY = 10.0
"""Seconds for which a wire goes by its model while readings contradict it. Either may be wrong, the
model after plausible wrong readings. A cold wire shows which one."""
_SEEN, _SELDOM = 10, 0.1
"""Least number of changed readings of a noisy sensor, and largest share of unchanged ones."""
_DRIFT, _UNSURE = 0.5, 0.3
"""Growth of the error of the model without trusted readings, in degrees per second and as a share
of the motion: a few degrees in 10 s."""
_CHANGED = 0.1
"""Largest change of the surroundings within seconds, as a share of the range of powers."""
_ROW = 5
"""Consecutive trusted readings after which the angle is known: more than outliers in a row."""
_AGREED = 1.0
"""Seconds for which readings must agree with the model to be trusted again, and seconds without
readings after which they are compared with it alone."""
_BLIND = 4.0
"""Seconds without readings until surroundings may have changed by the whole range of powers. The
change grows as their square: water flows in within seconds, and heats or cools only then."""
_CLOSE = 0.5
"""Share of `jump` within which they count as agreeing."""
_RISE, _FALL = 3.0, 2.0
"""Rise of the wire by its current, and fall of its readings, in degrees, that show a wrong sign:
far above the noise, and before the head has turned far in the wrong direction."""


@dataclass(frozen=True, kw_only=True)
class SensorWatch:
    """Conditions under which readings of a sensor are usable.

    Raises a `ParameterError` if a number is out of its range.
    """

    noise: float = 0.05
    """Standard deviation in degrees. A noisy sensor that repeats a reading is stuck. A sensor
    without noise (0), or with steps as coarse as its noise, may repeat readings: it counts as stuck
    only when a heated wire does not move."""
    repeats: int = 15
    """Consecutive equal readings after which a noisy sensor is stuck."""
    patience: int = 5
    """Consecutive missing or implausible readings after which the sensor is at fault."""
    recovery: int = 25
    """Usable readings after which it is trusted again, without a new fault between them."""
    low: float = -45.0
    high: float = 135.0
    """Limits of plausible angles, in degrees."""
    jump: float = 1.5
    """Largest difference of readings in degrees beyond the motion of the wire: noise, and the steps
    of a coarse sensor."""
    makes_up: int = 1
    """Missing or implausible readings that a usable one cancels. With 1, a sensor that loses more
    than half of its readings is at fault; with ``patience``, only consecutive ones count."""

    def __post_init__(self) -> None:
        within("noise", self.noise, 0.0, 100.0, "degrees")
        within("repeats", self.repeats, 2, 10_000)
        for name in ("patience", "recovery", "makes_up"):
            within(name, getattr(self, name), 1, 10_000)
        within("jump", self.jump, 1e-6, 1e6, "degrees")
        if not self.low < self.high:
            raise ParameterError(f"angles from {self.low} to {self.high}; give low < high")


class ReadingState(NamedTuple):
    """State of the check of the readings of a wire."""

    value: float = math.nan
    """Usable reading in degrees, NaN if there is none now."""
    fault: Fault = ""
    """Fault of the sensor, once it is certain; `minorloop_head.control.lateness` finds ``late``."""
    last: float = math.nan
    """Last plausible reading of the sensor, NaN before the first."""
    repeats: int = 0
    """Number of equal readings since."""
    missing: int = 0
    odd: int = 0
    """Number of missing and of implausible readings, less those cancelled by good ones since."""
    good: int = 0
    """Number of usable readings since the sensor was at fault."""
    changes: int = 0
    equals: int = 0
    """Numbers of readings that differed from the one before, and that did not, without stuck runs.
    They show whether the sensor is noisy."""
    believed: bool = False
    """Whether the wire can have turned to the newest reading."""
    seen: float = math.nan
    """That reading in degrees, NaN before the first."""
    gap: int = 0
    """Steps since."""
    row: int = 0
    """Consecutive trusted readings, or untrusted ones that agree with the model."""
    error: float = 0.0
    """Last trusted reading less the model, in degrees."""
    jumped: float = 0.0
    """Degrees by which readings have jumped since."""
    slack: float = math.inf
    """Degrees by which the wire may have left the model since; infinite before any is known."""
    astray: float = 0.0
    """Seconds for which readings have not been trusted."""
    reversed: bool = False
    """Whether their sign is wrong, which remains."""
    risen: float = math.inf
    read: float = math.nan
    """Angle by the current alone, and reading, at the beginning of the comparison of signs, in
    degrees."""

    @property
    def used(self) -> bool:
        """Whether the newest reading is usable."""
        return not math.isnan(self.value)


class Expected(NamedTuple):
    """Quantities that the model predicts for a reading."""

    angle: float
    """Angle in degrees."""
    motion: float = 0.0
    """Turn of the wire in the last interval, in degrees."""
    heating: float = 0.0
    """Heating power of the wire in that interval less its losses, in A^2."""
    driven: float = 0.0
    """Angle of the wire by its current alone, in degrees. It shows the sign of readings: a model
    that readings correct agrees with a wrong sign too."""
    steps: int = 1
    """Intervals since the last reading was due."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ReadingWatch(Loop):
    """Check that trusts only readings to which a wire can have turned; parameters as of `Loop`."""

    wire: HeatedWire
    """The model."""
    sensor: SensorWatch = field(default_factory=SensorWatch)

    def step(
        self, before: ReadingState, raw: object, angle: float, expected: Expected
    ) -> ReadingState:
        """Return the state after one more reading of any kind.

        ``raw``: reading of the sensor; ``angle``: angle of the wire by that reading in degrees, NaN
        where there is none.
        """
        number = as_number(raw)
        possible = self.sensor.low <= number <= self.sensor.high
        angle = angle if possible else math.nan
        known = self._check_sign(before, angle, expected)
        known = self._believed(known, angle, expected)
        return self._count(known, number, angle, possible=possible)

    def _believed(self, before: ReadingState, reading: float, expected: Expected) -> ReadingState:
        """Return the state after checking whether the wire can have turned to a reading."""
        steps, motion, jump = expected.steps, expected.motion, self.sensor.jump
        gap = before.gap + steps
        if math.isnan(reading):
            changed = min(gap * self.interval / _BLIND, 1.0) ** 2 * self._width
            turned = self._turn(changed) * steps + _UNSURE * abs(motion)
            return before._replace(gap=gap, slack=before.slack + turned)
        error = reading - expected.angle
        away = min(abs(error - before.error), abs(error))
        heated, change = self._turn(abs(expected.heating)), self._turn(_CHANGED * self._width)
        once = heated + change
        most = jump + gap * once
        follows = abs(reading - before.seen) <= most and gap * self.interval <= _AGREED
        if gap > steps:  # Without readings between, its way is about that of the model.
            follows = follows and away <= before.slack + jump + gap * change
        jumped, row, believed = before.jumped, before.row + 1, before.believed
        if follows:
            if not believed and away > _CLOSE * jump:
                row = 0
            believed = believed or row * self.interval >= _AGREED
        else:
            row, jumped = 1, error - before.error
            if not (believed or math.isnan(before.seen)):
                jumped = before.jumped + reading - before.seen - motion * gap
            back = not believed and abs(jumped) <= most
            believed = back or away <= before.slack + jump + once * steps
        after = before._replace(believed=believed, seen=reading, gap=0, row=row)
        if not believed:
            slack = before.slack + _DRIFT * self.interval + _UNSURE * abs(motion)
            astray = before.astray + steps * self.interval
            return after._replace(jumped=jumped, slack=slack, astray=astray)
        if reading == before.seen:  # It does not show a motion.
            slack = before.slack + (heated + abs(motion)) * steps
            return after._replace(jumped=0.0, slack=slack, astray=0.0)
        slack = 0.0 if row >= _ROW else before.slack
        return after._replace(error=error, jumped=0.0, slack=slack, astray=0.0)

    def _check_sign(self, before: ReadingState, reading: float, expected: Expected) -> ReadingState:
        """Return the state after checking whether readings fall below cold ones during heating."""
        if before.reversed or math.isnan(reading):
            return before
        driven, gap = expected.driven, before.gap + expected.steps
        most = self.sensor.jump + self._turn(self.highest**2) * gap
        # After a jump, which is no motion, the comparison starts anew.
        follows = abs(reading - before.seen) <= most
        if follows and driven >= before.risen:
            fallen = reading < before.read - _FALL
            below = reading < self.wire.operator.range[0] - _FALL
            if driven >= before.risen + _RISE and fallen and below:
                return before._replace(reversed=True)
            # Readings are late: they get twice the rise for their fall.
            if driven < before.risen + 2 * _RISE:
                return before
        return before._replace(risen=driven, read=reading)

    def _count(
        self, known: ReadingState, number: float, angle: float, *, possible: bool
    ) -> ReadingState:
        """Return the usable reading, and the fault of the sensor."""
        patience = self.sensor.patience
        if math.isnan(number):
            known = known._replace(value=math.nan, missing=min(known.missing + 1, patience))
        elif not (known.believed and possible):
            known = known._replace(value=math.nan, odd=min(known.odd + 1, patience))
        else:
            known = self._usable(known, number, angle)
        if max(known.missing, known.odd) >= patience:
            known = known._replace(good=0)
        fault = self._fault(known)
        return known._replace(fault=fault, value=math.nan if fault else known.value)

    def _usable(self, known: ReadingState, number: float, angle: float) -> ReadingState:
        same = number == known.last
        repeats = known.repeats + 1 if same else 0
        before = self._repeated(known.changes, known.equals, known.repeats)
        ended = 0 if same or before else known.repeats
        changes, equals = known.changes + (not same), known.equals + ended
        return known._replace(
            value=angle,
            last=number,
            repeats=repeats,
            missing=max(known.missing - self.sensor.makes_up, 0),
            odd=max(known.odd - self.sensor.makes_up, 0),
            good=0 if self._repeated(changes, equals, repeats) else known.good + 1,
            changes=changes,
            equals=equals,
        )

    def _repeated(self, changes: int, equals: int, repeats: int) -> bool:
        noisy = changes >= _SEEN and equals <= _SELDOM * changes
        return self.sensor.noise > 0 and noisy and repeats + 1 >= self.sensor.repeats

    def _fault(self, known: ReadingState) -> Fault:
        if known.reversed:
            return "reversed"
        if known.astray > ASTRAY:
            return "unconfirmed"
        if known.missing >= self.sensor.patience:
            return "lost"
        if known.odd >= self.sensor.patience:
            return "implausible"
        if self._repeated(known.changes, known.equals, known.repeats):
            return "stuck"
        return known.fault if known.fault and known.good < self.sensor.recovery else ""

    def _turn(self, heating: float) -> float:
        """Return the most degrees by which a heating power in A^2 turns the wire in an interval."""
        return self.wire.fastest * heating * self.interval

    @cached_property
    def _width(self) -> float:
        return width(self.wire)


def as_number(value: object) -> float:
    """Return a value as a float, NaN if it is not a number."""
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return math.nan
