"""A source and a meter as an actuator: limits, timing, and the way to safety."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import InstrumentError, ParameterError, SafetyError
from minorloop.lab.actuator import Channel, Value, check_input
from minorloop.lab.drivers.link import Link
from minorloop.lab.records import Quantity, Record
from minorloop.lab.signals import Deferred, ended_by_signals

__all__ = ["Bench", "Clock", "Meter", "Source", "Wall"]

OVERLOAD = 9e37
"""From here on a reading is how instruments say that they are overloaded (IEEE 488.2: 9.9E37)."""
MAX_SAMPLES = 20_000_000
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


class Wall:
    """The clock of the machine."""

    def now(self) -> float:
        """Time since some beginning, in seconds."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait for so many seconds."""
        time.sleep(seconds)


class Bench:
    """An actuator made of a source and a meter.

    Whatever goes wrong, in an instrument or here, the source is made safe before the error is
    raised. An input beyond a limit is refused and nothing is applied. A change faster than the
    rate limit is made in steps, one a tick, no faster than the limit; a hold begins when its
    input is reached.

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
        self._clock = Wall() if clock is None else clock
        self._began = self._clock.now()
        self._present, self._changed = self._rest, -math.inf

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

        Returns
        -------
        Record
            Times are those at which the readings came.

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
        ends = _sample_times(duration, sample_interval)
        t, y = np.empty(ends.size), np.empty(ends.size)
        try:
            self._go(wanted, math.inf)
            began = self._clock.now()
            for k, end in enumerate(ends):
                self._wait(began + end)
                y[k], t[k] = self._read(), self._clock.now()
        except BaseException:
            self._leave()
            raise
        t -= self._began
        t = np.maximum.accumulate(t + 1e-9 * np.arange(t.size))  # a clock may stand still
        names = [Quantity(c.name, c.unit) for c in (*self._inputs, *self._outputs)]
        return Record(t, np.full(t.size, self._present), y, names[0], names[1])

    def exchange(self, u: Value) -> float:
        """Hold an input for one tick and give the output at its end.

        Raises
        ------
        LimitError
            If the input is beyond a limit; nothing is applied then.
        InstrumentError
            If an instrument fails; the source is safe then.
        """
        wanted = float(check_input(self._inputs, u)[0])
        try:
            end = self._clock.now() + self._tick
            self._go(wanted, end)
            self._wait(end)
            return self._read()
        except BaseException:
            self._leave()
            raise

    def check(self) -> float:
        """Make the source safe and read the output once, to be sure that both answer.

        Raises
        ------
        InstrumentError
            If one of them does not.
        """
        self.safe()
        return self._read()

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
            self._source.set(following)
            self._present, self._changed = following, self._clock.now()

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


def _sample_times(duration: float, interval: float) -> FloatArray:
    """Ends of the samples of a hold: every interval, and its end."""
    for name, value in (("duration", duration), ("sample_interval", interval)):
        if not 0 < value < math.inf:
            raise ParameterError(f"{name} is {value!r} s; give a positive time")
    count = max(1, math.ceil(duration / interval - 1e-9))
    if count > MAX_SAMPLES:
        raise ParameterError(f"{count} samples are more than {MAX_SAMPLES}; sample more slowly")
    return np.asarray(np.minimum(interval * np.arange(1, count + 1), duration))
