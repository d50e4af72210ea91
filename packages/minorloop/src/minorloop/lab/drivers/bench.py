"""Make an actuator of sources and sensors, with limits, timing and a safe end."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from statistics import median
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import InstrumentError, MinorloopError, ParameterError, SafetyError
from minorloop.lab.actuator import Channel, Value, check_input, one_or_all, rounded_up
from minorloop.lab.drivers.device import Closable, Lines, Meter, Source
from minorloop.lab.records import Quantity, Record, Timing
from minorloop.lab.signals import Deferred, ended_by_signals

_MAX_SAMPLES = 20_000_000
"""Most samples of a hold."""
_READINGS = 3
"""Number of readings after which the answer time of the meter is known."""
_SLACK = 0.1
"""Share of an answer time by which the last reading may end after the hold."""
_ROUNDING = 1e-9
_PAUSE, _PAUSES = 0.05, 0.5
"""Seconds between the first two attempts to make safe, and most seconds between two attempts."""


@dataclass(frozen=True)
class _Span:
    """The middle of an exchange and half its length, in seconds on the clock of the bench."""

    middle: float
    half: float

    @classmethod
    def between(cls, asked: float, answered: float) -> _Span:
        return cls((asked + answered) / 2, max(answered - asked, 0.0) / 2)


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


class LimitedSource:
    """A source that refuses inputs beyond limits, changes that are too fast, NaN and infinity.

    A command changes an input by at most its rate limit times the time since the last command, and
    this time counts as at most a tick. After a failed command, nothing is set until `safe` has
    succeeded.

    ``source``: sets all inputs together: a number for one, an array for several; ``channels``: the
    inputs; ``rest`` (channels,): inputs of the safe source; ``tick``: in seconds.
    """

    def __init__(
        self,
        source: Source,
        channels: tuple[Channel, ...],
        rest: FloatArray,
        tick: float,
        clock: Clock,
    ) -> None:
        self.source, self._channels, self._clock = source, channels, clock
        self._rates = np.array([channel.rate for channel in channels])
        self.rest, self.present, self.tick = rest, rest.copy(), tick
        self._changed, self._known = -math.inf, True

    @property
    def due(self) -> float:
        """Time on the clock from which a change may be as large as the rate allows in a tick."""
        return self._changed + self.tick if np.isfinite(self._rates).any() else -math.inf

    def nearest(self, wanted: npt.ArrayLike) -> FloatArray:
        """Return the allowed inputs (channels,) that are nearest to ``wanted`` now."""
        unlimited = np.isinf(self._rates)
        most = np.where(unlimited, np.inf, np.where(unlimited, 0.0, self._rates) * self._gone())
        return np.asarray(np.clip(wanted, self.present - most, self.present + most))

    def set(self, value: Value) -> None:
        """Apply inputs.

        Raises a `LimitError` if a number is not finite, or beyond a limit or a rate limit, and
        nothing is sent then; an `InstrumentError` if the source fails, or has failed and was not
        made safe since.
        """
        values = check_input(self._channels, value, before=self.present, interval=self._gone())
        if not self._known:
            raise InstrumentError("the last command failed; make the source safe first")
        self._known = False
        self.source.set(one_or_all(values))
        self.present, self._changed, self._known = values, self._clock.now(), True

    def safe(self) -> None:
        """Go to the safe inputs at once, at any distance; raise an error unless confirmed."""
        self.source.safe()
        self.present, self._known = self.rest.copy(), True

    def _gone(self) -> float:
        """Return the time that counts for a change now, at most a tick."""
        now = self._clock.now()
        return self.tick if now >= self._changed + self.tick else now - self._changed


class Bench:
    """An actuator made of sources and sensors.

    After any error the sources are made safe before the error is raised. An input beyond a limit is
    refused and nothing is applied. A change faster than the rate limit is made in steps, one for
    each tick; a hold begins when its input is reached. Every command passes a `LimitedSource`,
    which refuses inputs beyond the limits from any sender.

    The clock determines the duration of a hold. Each reading has the time of the middle of its
    exchange. Sensors that take longer than the sample interval are read as often as they answer.

    Raises a `ParameterError` if an input has no limits, rest is beyond them, or a time is not
    positive.

    Parameters
    ----------
    source : Source
        Sets the inputs.
    meter : Meter
        Reads the outputs.
    input : Channel, or sequence of them
        The inputs; their limits are finite.
    output : Channel, or sequence of them
        The outputs; a reading beyond their limits is an error.
    rest : float or (inputs,) array
        The inputs of the safe source, in their units.
    tick : float
        Duration of one ``exchange``, in seconds.
    clock : Clock, optional
        The clock of the machine by default.
    description : dict, optional
        Instruments and the conversion of their readings, for JSON; a run is not resumed on a bench
        of another description.
    safe_within : float
        Time of attempts to make the source safe, in seconds.
    links : sequence of Closable
        Connections to the instruments, which `close` closes.
    warnings : sequence of str
        Sentences that the user of the bench must know.
    measures : sequence of int, optional
        For each output the input that it belongs to; by default the input of the same number.
    lines : Lines, optional
        Digital lines; the source switches them as needed when it is made safe.
    serial : str, optional
        Serial number of the plant.
    """

    def __init__(
        self,
        source: Source,
        meter: Meter,
        input: Channel | Sequence[Channel],
        output: Channel | Sequence[Channel],
        *,
        rest: Value = 0.0,
        tick: float = 0.05,
        clock: Clock | None = None,
        description: dict[str, Any] | None = None,
        safe_within: float = 10.0,
        links: Sequence[Closable] = (),
        warnings: Sequence[str] = (),
        measures: Sequence[int] | None = None,
        lines: Lines | None = None,
        serial: str | None = None,
    ) -> None:
        self.inputs, self.outputs = _channels(input), _channels(output)
        resting = np.broadcast_to(np.asarray(rest, dtype=np.float64), len(self.inputs)).copy()
        check_rest(self.inputs, resting)
        if not 0 < tick < math.inf:
            raise ParameterError(f"tick is {tick!r} s; give a positive time")
        if not 0 < safe_within <= 3600:
            raise ParameterError(f"safe_within is {safe_within!r} s; give a time of up to an hour")
        self.tick, self.safe_within, self.serial = float(tick), float(safe_within), serial
        self.description, self.warnings = description, tuple(warnings)
        self.measures = tuple(range(len(self.outputs)) if measures is None else measures)
        self._clock = WallClock() if clock is None else clock
        self._source = LimitedSource(source, self.inputs, resting, self.tick, self._clock)
        self._meter, self._lines, self._links = meter, lines, tuple(links)
        self._began = self._clock.now()
        self._set: _Span | None = None
        self._doubt = 0.0  # half the exchange that set the present input
        # Latest readings, whose median predicts the duration of the next
        self._answers: deque[float] = deque(maxlen=9)
        self._found = 0.0

    @property
    def rest(self) -> FloatArray:
        """(inputs,) inputs of the safe source."""
        return self._source.rest.copy()

    @property
    def lines(self) -> tuple[str, ...]:
        """Names of the digital lines."""
        return () if self._lines is None else self._lines.names

    def apply(self, u: Value, duration: float, sample_interval: float) -> Record:
        """Hold inputs from the time when they are reached, and return a record: `Actuator.apply`.

        Times are the middles of the exchanges; ``timing`` contains begin and end of the hold.

        Raises a `ParameterError` if a time is not positive, or there would be more than twenty
        million samples; an `InstrumentError` if an instrument fails, and the source is safe then.
        """
        wanted = check_input(self.inputs, u)
        count = _count(duration, sample_interval)
        with self._safe_after_errors():
            self._set = None
            self._go(wanted, math.inf)
            on = self._set or _Span(self._clock.now(), 0.0)
            readings = self._sample(on.middle, duration, sample_interval, count)
            self._wait(on.middle + duration)
            ended = self._clock.now()
        t = np.maximum.accumulate([span.middle for span, _ in readings]) - self._began
        timing = Timing(
            began=on.middle - self._began,
            ended=ended - self._began,
            uncertainty=self._doubt + max(span.half for span, _ in readings),
        )
        held = np.repeat(self._source.present[:, None], t.size, axis=1)
        y = np.array([values for _, values in readings]).T
        return Record(
            held if len(held) > 1 else held[0],
            y if len(y) > 1 else y[0],
            t,
            [Quantity(c.name, c.unit) for c in self.inputs],
            [Quantity(c.name, c.unit) for c in self.outputs],
            timing=timing,
        )

    def exchange(self, u: Value) -> Value:
        """Hold inputs for one tick, and return the outputs at its end.

        Raises a `ParameterError` if the meter takes longer than a tick, and nothing is applied
        then; an `InstrumentError` if an instrument fails, and the source is safe then.
        """
        wanted = check_input(self.inputs, u)
        if self._found > self.tick:
            raise ParameterError(
                f"the meter takes {self._found:.3g} s for an answer, and a tick is {self.tick:g} "
                f"s; give a tick of at least {rounded_up(self._found):g} s, or a faster meter"
            )
        with self._safe_after_errors():
            end = self._clock.now() + self.tick
            self._go(wanted, end)
            self._wait(end - self._usual())
            _, values = self._read_timed()
            self._wait(end)
        return one_or_all(values)

    def at_once(self, u: Value) -> Value:
        """Apply inputs, and return the outputs at once, for a loop that keeps its own time.

        The inputs change as far as their rate limits allow since the last call.

        Raises a `LimitError` if an input is beyond a limit, and nothing is applied then; an
        `InstrumentError` if an instrument fails, and the source is safe then.
        """
        wanted = check_input(self.inputs, u)
        with self._safe_after_errors():
            self._put(self._source.nearest(wanted))
            _, values = self._read_timed()
        return one_or_all(values)

    def switch(self, values: Mapping[str, bool]) -> None:
        """Switch digital lines on or off.

        ``values``: the lines by their names; other lines do not change. Raises a `ParameterError`
        if there is no such line; an `InstrumentError` if the instrument fails, and the source is
        safe then.
        """
        for name in values:
            if name not in self.lines:
                known = ", ".join(self.lines) or "none"
                raise ParameterError(f"there is no line {name!r}; there is {known}")
        if self._lines is None or not values:
            return
        with self._safe_after_errors():
            self._lines.switch(values)

    def answer_time(self) -> float:
        """Return the time of one reading, in seconds: the median of the latest readings.

        Raises an `InstrumentError` if there is no reading yet, and the meter does not answer.
        """
        while len(self._answers) < _READINGS:
            self._read_timed()
        return self._usual()

    def written(self, u: float) -> float:
        """Return the input that the source writes for ``u``; nothing is applied.

        ``u``: the input, in its unit.
        """
        written = getattr(self._source.source, "written", None)
        with _driver_errors():
            return u if written is None else float(written(u))

    def check(self) -> Value:
        """Make the source safe, and read the outputs a few times; return the last readings.

        This also measures the answer time of the meter.

        Raises an `InstrumentError` if source or meter fails.
        """
        self.safe()
        for _ in range(_READINGS):
            _, values = self._read_timed()
        self._found = self._usual()
        return one_or_all(values)

    def safe(self) -> None:
        """Make the source safe; try until it confirms or a deadline is over.

        Signals do not interrupt this.

        Raises a `SafetyError` if it does not confirm in time.
        """
        with ended_by_signals(), Deferred():
            end, waited, pause = self._clock.now() + self.safe_within, 0.0, _PAUSE
            while True:
                try:
                    self._source.safe()
                except Exception as error:
                    last = error
                else:
                    return
                if waited >= self.safe_within or self._clock.now() >= end:
                    break
                self._clock.sleep(pause)
                waited, pause = waited + pause, min(2 * pause, _PAUSES)
        raise SafetyError(
            f"the source may still be on, switch it off by hand: in {self.safe_within:g} s it "
            f"did not confirm that it is safe: {last}"
        ) from last

    def close(self) -> None:
        """Make the source safe, and close the connections."""
        for link in self._links:
            with _driver_errors():
                link.close()

    def _go(self, wanted: FloatArray, end: float) -> None:
        """Change the inputs towards values, at the allowed rates, until a time."""
        while (self._source.present != wanted).any():
            if self._source.due > end:
                break
            self._wait(self._source.due)
            self._put(self._source.nearest(wanted))

    def _put(self, values: FloatArray) -> None:
        """Set the source, and note the time."""
        asked = self._clock.now()
        self._source.set(values)
        self._set = _Span.between(asked, self._clock.now())
        self._doubt = self._set.half

    def _sample(
        self, began: float, duration: float, interval: float, count: int
    ) -> list[tuple[_Span, FloatArray]]:
        """Return readings that end at each interval and at the end of the hold.

        A slower meter is read again as soon as it has answered. A reading that could not end in
        time is not begun, except for the first.
        """
        readings: list[tuple[_Span, FloatArray]] = []
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

    def _read_timed(self) -> tuple[_Span, FloatArray]:
        """Return a reading of each output, and the time of the readings."""
        asked = self._clock.now()
        values = self._read()
        span = _Span.between(asked, self._clock.now())
        self._answers.append(2 * span.half)
        return span, values

    def _usual(self) -> float:
        """Return the duration of the latest readings, in seconds; 0 before the first."""
        return median(self._answers) if self._answers else 0.0

    def _wait(self, end: float) -> None:
        left = end - self._clock.now()
        if left > 0:
            self._clock.sleep(left)

    def _read(self) -> FloatArray:
        with _driver_errors():
            values = np.atleast_1d(np.asarray(self._meter.read(), dtype=np.float64))
        if values.shape != (len(self.outputs),):
            raise InstrumentError(
                f"the meter gives {values.size} readings for {len(self.outputs)} outputs"
            )
        for channel, value in zip(self.outputs, values.tolist(), strict=True):
            _check_reading(channel, value)
        return values

    @contextmanager
    def _safe_after_errors(self) -> Iterator[None]:
        """Make the source safe after an error; a `SafetyError` mentions that error."""
        try:
            with _driver_errors():
                yield
        except BaseException as error:
            try:
                self.safe()
            except SafetyError as unsafe:
                reason = str(error) or type(error).__name__
                raise SafetyError(f"{unsafe}; the error before: {reason}") from error
            raise


@contextmanager
def _driver_errors() -> Iterator[None]:
    """Convert any error of a third-party driver to an `InstrumentError`."""
    try:
        yield
    except MinorloopError:
        raise
    except Exception as error:
        said = f"{type(error).__name__}: {error}"
        raise InstrumentError(f"the driver failed: {said}") from error


def _channels(given: Channel | Sequence[Channel]) -> tuple[Channel, ...]:
    return (given,) if isinstance(given, Channel) else tuple(given)


def check_rest(inputs: Sequence[Channel], rest: FloatArray) -> None:
    """Raise a `ParameterError` for inputs without limits, or rest (inputs,) beyond them."""
    for input, value in zip(inputs, rest.tolist(), strict=True):
        if not (math.isfinite(input.low) and math.isfinite(input.high)):
            raise ParameterError(f"{input} has no limits; give the least and greatest input")
        if not input.low <= value <= input.high:
            raise ParameterError(
                f"rest {value:g} is beyond the limits [{input.low:g}, {input.high:g}] of {input}"
            )


def _check_reading(channel: Channel, value: float) -> None:
    """Refuse an impossible reading."""
    # Readings of at least 9e37 mean that the instrument is overloaded (IEEE 488.2: 9.9E37)
    if not math.isfinite(value) or abs(value) >= 9e37:
        raise InstrumentError(
            f"the meter reads {value} for {channel.name}: overloaded, or not connected"
        )
    if not channel.low <= value <= channel.high:
        raise InstrumentError(
            f"the meter reads {value:g} {channel.unit}, beyond the limits of {channel.name}, "
            f"[{channel.low:g}, {channel.high:g}]; check sensor and wiring"
        )


def _count(duration: float, interval: float) -> int:
    """Return the number of samples of a hold: at each interval, and at its end."""
    for name, value in (("duration", duration), ("sample_interval", interval)):
        if not 0 < value < math.inf:
            raise ParameterError(f"{name} is {value!r} s; give a positive time")
    count = max(1, math.ceil(duration / interval - _ROUNDING))
    if count > _MAX_SAMPLES:
        raise ParameterError(f"{count} samples are more than {_MAX_SAMPLES}; sample more slowly")
    return count
