"""Make an actuator of a source and a meter, with limits, timing and a safe end."""

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
"""Readings from here mean that the instrument is overloaded (IEEE 488.2: 9.9E37)."""
MAX_SAMPLES = 20_000_000
"""Most samples of a hold."""
_READINGS = 3
"""Readings after which the answer time of the meter is known."""
_LATEST = 9
"""Latest readings whose median predicts how long the next one takes."""
_SLACK = 0.1
"""Share of an answer by which the last reading may end after the hold."""
_ROUNDING = 1e-9
_PAUSE, _PAUSES = 0.05, 0.5
"""Seconds between the first two attempts to make safe, and at most between any two."""


class Source(Protocol):
    """Sets the input of a plant."""

    def set(self, value: float) -> None:
        """Apply an input; return only when it is on."""

    def safe(self) -> None:
        """Go to a safe state; raise an error unless this is confirmed."""


class Meter(Protocol):
    """Reads the output of a plant."""

    def read(self) -> float:
        """Return the output now."""


class Clock(Protocol):
    """Time in seconds."""

    def now(self) -> float:
        """Return the time since some origin."""

    def sleep(self, seconds: float) -> None:
        """Wait."""


class WallClock:
    """The clock of the machine."""

    def now(self) -> float:
        """Return the time since some origin, in seconds."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait for a number of seconds."""
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

    After any error the source is made safe before the error is raised. An input beyond a limit is
    refused and nothing is applied. A change faster than the rate limit is made in steps, one for
    each tick; a hold begins when its input is reached.

    The clock determines how long a hold lasts. Each reading has the time of the middle of its
    exchange. A meter that takes longer than the sample interval is read as often as it answers.

    Parameters
    ----------
    source : Source
        Sets the input.
    meter : Meter
        Reads the output.
    input : Channel
        The input; both its limits are finite.
    output : Channel
        The output; a reading beyond its limits is an error.
    rest : float
        The input that is on when the source is safe, in its unit.
    tick : float
        How long one ``exchange`` takes, in seconds.
    clock : Clock, optional
        The clock of the machine if not given.
    description : dict, optional
        Instruments and how their readings are converted, ready for JSON; a run is not resumed on a
        bench of another description.
    safe_within : float
        How long to try to make the source safe, in seconds.
    links : sequence of Link
        Connections to the instruments, which `close` closes.
    warnings : sequence of str
        What the user of the bench must know.

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
        self._doubt = 0.0  # half the exchange that set the present input
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
        """Description of the instruments, ready for JSON; None if not given."""
        return self._description

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the user of the bench must know."""
        return self._warnings

    def apply(self, u: Value, duration: float, sample_interval: float) -> Record:
        """Hold an input, and return a record of input and output.

        Parameters
        ----------
        u : float
            The input, in its unit.
        duration : float
            How long to hold it, in seconds, from when it is reached.
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
        """Hold an input for one tick, and return the output at its end.

        Raises
        ------
        LimitError
            If the input is beyond a limit; nothing is applied then.
        ParameterError
            If the meter takes longer than a tick; nothing is applied then.
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
        """Return how long one reading takes, in seconds: the median of the latest.

        Raises
        ------
        InstrumentError
            If nothing was read yet, and the meter does not answer.
        """
        while len(self._answers) < _READINGS:
            self._read_timed()
        return self._usual()

    def written(self, u: float) -> float:
        """Return the input that the source writes for ``u``; nothing is applied.

        Parameters
        ----------
        u : float
            The input, in its unit.
        """
        written = getattr(self._source, "written", None)
        return u if written is None else float(written(u))

    def check(self) -> float:
        """Make the source safe, and read the output a few times; return the last reading.

        This also measures the answer time of the meter.

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
        """Make the source safe; try until it confirms or a deadline is over.

        No signal interrupts this.

        Raises
        ------
        SafetyError
            If it does not confirm in time.
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
        """Close the connections; make the source safe before."""
        for link in self._links:
            link.close()

    def _go(self, wanted: float, end: float) -> None:
        """Change the input towards a value, at the allowed rate, until a time."""
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
        """Set the source, and note the time."""
        asked = self._clock.now()
        self._source.set(value)
        self._set = _Span.between(asked, self._clock.now())
        self._doubt = self._set.half

    def _sample(
        self, began: float, duration: float, interval: float, count: int
    ) -> list[tuple[_Span, float]]:
        """Return readings that end at each interval and at the end of the hold.

        A slower meter is asked again as soon as it has answered. A reading that could not end in
        time is not begun, except for the first.
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
        """Return a reading, and when it was taken."""
        asked = self._clock.now()
        value = self._read()
        span = _Span.between(asked, self._clock.now())
        self._answers.append(2 * span.half)
        return span, value

    def _usual(self) -> float:
        """Return how long the latest readings took, in seconds; 0 before the first."""
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
                f"the meter reads {value:g} {channel.unit}, beyond the limits of {channel.name}, "
                f"[{channel.low:g}, {channel.high:g}]; check sensor and wiring"
            )
        return value

    def _leave(self) -> None:
        """Make the source safe after an error; a `SafetyError` mentions that error."""
        cause = sys.exception()
        try:
            self.safe()
        except SafetyError as error:
            reason = str(cause) or type(cause).__name__
            raise SafetyError(f"{error}; the error before: {reason}") from cause


def _count(duration: float, interval: float) -> int:
    """Return how many samples a hold has: at each interval, and at its end."""
    for name, value in (("duration", duration), ("sample_interval", interval)):
        if not 0 < value < math.inf:
            raise ParameterError(f"{name} is {value!r} s; give a positive time")
    count = max(1, math.ceil(duration / interval - _ROUNDING))
    if count > MAX_SAMPLES:
        raise ParameterError(f"{count} samples are more than {MAX_SAMPLES}; sample more slowly")
    return count
