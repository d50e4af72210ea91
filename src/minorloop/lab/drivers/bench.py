"""A source and a meter as an actuator: limits, timing, and the way to safety."""

from __future__ import annotations

import math
import sys
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any, Protocol

import numpy as np

from minorloop.errors import InstrumentError, ParameterError, SafetyError
from minorloop.lab.actuator import Channel, Value, check_input, rounded_up
from minorloop.lab.drivers.link import Link
from minorloop.lab.records import Quantity, Record, Timing
from minorloop.lab.signals import Deferred, ended_by_signals

__all__ = ["Bench", "Clock", "Meter", "Source", "WallClock"]

OVERLOAD = 9e37
"""From here on a reading is how instruments say that they are overloaded (IEEE 488.2: 9.9E37)."""
MAX_SAMPLES = 20_000_000
_READINGS = 3
"""Readings from which it is known how long the meter takes."""
_LATEST = 9
"""Readings from which it is taken how long the next one is going to take."""
_SLACK = 0.1
"""Share of an answer by which the last reading may end after the hold."""
_ROUNDING = 1e-9
_PAUSE, _PAUSES = 0.05, 0.5
"""Seconds between the first two attempts to make safe, and at most between any two."""


class Source(Protocol):
    """What sets the input of a plant."""

    def set(self, value: float) -> None:
        """Put an input on, and be sure that it is on."""

    def safe(self) -> None:
        """Go to what can be left on unattended, and be sure of it; raise otherwise."""


class Meter(Protocol):
    """What reads the output of a plant."""

    def read(self) -> float:
        """The output now."""


class Clock(Protocol):
    """Time in seconds."""

    def now(self) -> float:
        """Time since some beginning."""

    def sleep(self, seconds: float) -> None:
        """Wait."""


class WallClock:
    """The clock of the machine."""

    def now(self) -> float:
        """Time since some beginning, in seconds."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait for so many seconds."""
        time.sleep(seconds)


@dataclass(frozen=True)
class _Span:
    """The middle of an exchange and half its length, in seconds on the clock of the bench."""

    middle: float
    half: float

    @classmethod
    def between(cls, asked: float, answered: float) -> _Span:
        return cls((asked + answered) / 2, max(answered - asked, 0.0) / 2)


class Bench:
    """An actuator made of a source and a meter.

    Whatever goes wrong, in an instrument or here, the source is made safe before the error is
    raised. An input beyond a limit is refused and nothing is applied. A change faster than the
    rate limit is made in steps, one a tick, no faster than the limit; a hold begins when its
    input is reached.

    A hold lasts as long as it is asked to by the clock. Each reading has the time of the middle of
    its exchange. A meter that takes longer than the sample interval is read as often as it answers.

    Parameters
    ----------
    source : Source
        What sets the input.
    meter : Meter
        What reads the output.
    input : Channel
        The input, with the limits that must be kept; both finite.
    output : Channel
        The output; a reading beyond its limits is an error.
    rest : float
        The input that is on when the source is safe, in its unit.
    tick : float
        How long one ``exchange`` takes, in seconds.
    clock : Clock, optional
        Another clock than that of the machine.
    description : dict, optional
        What all this is, ready for JSON; a run is not resumed on a bench of another description.
    safe_within : float
        How long to try to make the source safe, in seconds.
    links : sequence of Link
        Lines to the instruments, which `close` lets go of.
    warnings : sequence of str
        What whoever uses it has to know.

    Raises
    ------
    ParameterError
        If the input has no limits, rest is beyond them, or a time is not positive.
    """

    def __init__(
        self,
        source: Source,
        meter: Meter,
        input: Channel,
        output: Channel,
        *,
        rest: float = 0.0,
        tick: float = 0.05,
        clock: Clock | None = None,
        description: dict[str, Any] | None = None,
        safe_within: float = 10.0,
        links: Sequence[Link] = (),
        warnings: Sequence[str] = (),
    ) -> None:
        if not (math.isfinite(input.low) and math.isfinite(input.high)):
            raise ParameterError(f"{input} has no limits; give the least and greatest input")
        if not input.low <= rest <= input.high:
            raise ParameterError(
                f"rest {rest:g} is beyond the limits [{input.low:g}, {input.high:g}] of {input}"
            )
        if not 0 < tick < math.inf:
            raise ParameterError(f"tick is {tick!r} s; give a positive time")
        if not 0 < safe_within <= 3600:
            raise ParameterError(f"safe_within is {safe_within!r} s; give a time of up to an hour")
        self._source, self._meter = source, meter
        self._inputs, self._outputs = (input,), (output,)
        self._rest, self._tick = float(rest), float(tick)
        self._description, self._links = description, tuple(links)
        self._safe_within, self._warnings = float(safe_within), tuple(warnings)
        self._clock = WallClock() if clock is None else clock
        self._began = self._clock.now()
        self._present, self._changed = self._rest, -math.inf
        self._set: _Span | None = None
        self._doubt = 0.0  # half the exchange that set what is on
        self._answers: deque[float] = deque(maxlen=_LATEST)
        self._found = 0.0

    @property
    def inputs(self) -> tuple[Channel, ...]:
        """The input."""
        return self._inputs

    @property
    def outputs(self) -> tuple[Channel, ...]:
        """The output."""
        return self._outputs

    @property
    def tick(self) -> float:
        """How long one ``exchange`` takes, in seconds."""
        return self._tick

    @property
    def description(self) -> dict[str, Any] | None:
        """What it is, ready for JSON; None where that was not said."""
        return self._description

    @property
    def warnings(self) -> tuple[str, ...]:
        """What whoever uses it has to know."""
        return self._warnings

    def apply(self, u: Value, duration: float, sample_interval: float) -> Record:
        """Hold an input and record it and the output.

        Parameters
        ----------
        u : float
            The input, in its unit.
        duration : float
            How long to hold it, in seconds, from when it is reached at the rate allowed.
        sample_interval : float
            Time between samples, in seconds; the last sample is taken at the end of the hold.
            Where a reading takes longer, there are fewer samples.

        Returns
        -------
        Record
            Times are the middles of the exchanges; ``timing`` says when the hold began and ended.

        Raises
        ------
        LimitError
            If the input is beyond a limit; nothing is applied then.
        ParameterError
            If a time is not positive, or there would be more than twenty million samples.
        InstrumentError
            If an instrument fails; the source is safe then.
        """
        wanted = float(check_input(self._inputs, u)[0])
        count = _count(duration, sample_interval)
        try:
            self._set = None
            self._go(wanted, math.inf)
            on = self._set or _Span(self._clock.now(), 0.0)
            readings = self._sample(on.middle, duration, sample_interval, count)
            self._wait(on.middle + duration)
            ended = self._clock.now()
        except BaseException:
            self._leave()
            raise
        t = np.maximum.accumulate([span.middle for span, _ in readings]) - self._began
        timing = Timing(
            began=on.middle - self._began,
            ended=ended - self._began,
            uncertainty=self._doubt + max(span.half for span, _ in readings),
        )
        names = [Quantity(c.name, c.unit) for c in (*self._inputs, *self._outputs)]
        u_held, y = np.full(t.size, self._present), [value for _, value in readings]
        return Record(t, u_held, y, names[0], names[1], timing=timing)

    def exchange(self, u: Value) -> float:
        """Hold an input for one tick and give the output at its end.

        Raises
        ------
        LimitError
            If the input is beyond a limit; nothing is applied then.
        ParameterError
            If the meter takes longer than a tick, as ``check`` found; nothing is applied then.
        InstrumentError
            If an instrument fails; the source is safe then.
        """
        wanted = float(check_input(self._inputs, u)[0])
        if self._found > self._tick:
            raise ParameterError(
                f"the meter takes {self._found:.3g} s for an answer, and a tick is {self._tick:g} "
                f"s; give a tick of at least {rounded_up(self._found):g} s, or a faster meter"
            )
        try:
            end = self._clock.now() + self._tick
            self._go(wanted, end)
            self._wait(end - self._usual())
            _, value = self._read_timed()
            self._wait(end)
        except BaseException:
            self._leave()
            raise
        return value

    def answer_time(self) -> float:
        """How long one reading takes, in seconds: the median of the latest.

        Raises
        ------
        InstrumentError
            If nothing was read yet, and the meter does not answer.
        """
        while len(self._answers) < _READINGS:
            self._read_timed()
        return self._usual()

    def check(self) -> float:
        """Make the source safe and read the output a few times, to be sure that both answer.

        How long the meter takes is known then.

        Raises
        ------
        InstrumentError
            If one of them does not.
        """
        self.safe()
        for _ in range(_READINGS):
            _, value = self._read_timed()
        self._found = self._usual()
        return value

    def safe(self) -> None:
        """Make the source safe; try until it says that it is, or until a deadline.

        No signal interrupts this.

        Raises
        ------
        SafetyError
            If it does not say so in time.
        """
        with ended_by_signals(), Deferred():
            end, waited, pause = self._clock.now() + self._safe_within, 0.0, _PAUSE
            while True:
                try:
                    self._source.safe()
                except Exception as error:
                    last = error
                else:
                    self._present = self._rest
                    return
                if waited >= self._safe_within or self._clock.now() >= end:
                    break
                self._clock.sleep(pause)
                waited, pause = waited + pause, min(2 * pause, _PAUSES)
        raise SafetyError(
            f"the source may still be on, switch it off by hand: in {self._safe_within:g} s it "
            f"did not say that it is safe: {last}"
        ) from last

    def close(self) -> None:
        """Let go of the instruments; make the source safe before."""
        for link in self._links:
            link.close()

    def _go(self, wanted: float, end: float) -> None:
        """Go towards an input, at the rate allowed, until a time."""
        most = self._inputs[0].rate * self._tick
        while self._present != wanted:
            ready = self._changed + self._tick if math.isfinite(most) else -math.inf
            if ready > end:
                break
            self._wait(ready)
            following = min(max(wanted, self._present - most), self._present + most)
            self._put(following)
            self._present, self._changed = following, self._clock.now()

    def _put(self, value: float) -> None:
        """Set the source, and note when."""
        asked = self._clock.now()
        self._source.set(value)
        self._set = _Span.between(asked, self._clock.now())
        self._doubt = self._set.half

    def _sample(
        self, began: float, duration: float, interval: float, count: int
    ) -> list[tuple[_Span, float]]:
        """Readings that end every interval and at the end of the hold.

        Where the meter is slower, it is asked again as soon as it has answered. A reading that
        could not end in time is not begun, except for the first.
        """
        readings: list[tuple[_Span, float]] = []
        k = -1
        while k < count - 1:
            answer, gone = self._usual(), self._clock.now() - began
            k = min(max(k + 1, math.floor(gone / interval + _ROUNDING)), count - 1)
            start = max(gone, min(interval * (k + 1), duration) - answer)
            if k < count - 1 and start + (2 - _SLACK) * answer > duration:
                k, start = count - 1, max(gone, duration - answer)
            if readings and start + (1 - _SLACK) * answer > duration:
                break
            self._wait(began + start)
            readings.append(self._read_timed())
        return readings

    def _read_timed(self) -> tuple[_Span, float]:
        """A reading, and when it was taken."""
        asked = self._clock.now()
        value = self._read()
        span = _Span.between(asked, self._clock.now())
        self._answers.append(2 * span.half)
        return span, value

    def _usual(self) -> float:
        """How long the latest readings took, in seconds; 0 before the first."""
        return median(self._answers) if self._answers else 0.0

    def _wait(self, end: float) -> None:
        left = end - self._clock.now()
        if left > 0:
            self._clock.sleep(left)

    def _read(self) -> float:
        value = float(self._meter.read())
        channel = self._outputs[0]
        if not math.isfinite(value) or abs(value) >= OVERLOAD:
            raise InstrumentError(f"the meter reads {value}: overloaded, or not connected")
        if not channel.low <= value <= channel.high:
            raise InstrumentError(
                f"the meter reads {value:g} {channel.unit}, beyond what {channel.name} can be, "
                f"[{channel.low:g}, {channel.high:g}]; check sensor and wiring"
            )
        return value

    def _leave(self) -> None:
        """Make the source safe on the way out; what is on its way out stands behind the error."""
        cause = sys.exception()
        try:
            self.safe()
        except SafetyError as error:
            said = str(cause) or type(cause).__name__
            raise SafetyError(f"{error}; what came before: {said}") from cause


def _count(duration: float, interval: float) -> int:
    """How many samples a hold has: every interval, and at its end."""
    for name, value in (("duration", duration), ("sample_interval", interval)):
        if not 0 < value < math.inf:
            raise ParameterError(f"{name} is {value!r} s; give a positive time")
    count = max(1, math.ceil(duration / interval - _ROUNDING))
    if count > MAX_SAMPLES:
        raise ParameterError(f"{count} samples are more than {MAX_SAMPLES}; sample more slowly")
    return count
