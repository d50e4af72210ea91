"""A pulser and a digitiser with commands in lines of text, as an `EchoSource` of any head.

::

    [digitiser]
    resource = "TCPIP0::192.168.0.7::4000::SOCKET"
    on = ["DAT:ENC ASCI", "ACQ:STOPA SEQ"]     # once, at the start
    arm = "ACQ:STATE RUN"                      # before each pulse
    read = "DAT:STAR {first};:DAT:STOP {last};:CURV?"
    samples = 2048
    interval = "WFMO:XIN?"                     # a number of seconds, or a question
    full_scale = 128.0                         # the number that counts as 1

    [pulser]                                   # without it the digitiser fires
    resource = "ASRL/dev/ttyUSB0::INSTR"
    on = ["OUTP ON"]
    fire = "*TRG"
    safe = ["OUTP OFF"]

Samples are read in parts, since an answer has 4096 characters at most. ``library``, ``timeout`` and
``baud`` of a connection are those of the driver ``visa``.
"""

from __future__ import annotations

import time
import tomllib
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import InstrumentError, ParameterError, all_done
from minorloop.files import PathLike
from minorloop.lab.drivers.device import parsed
from minorloop.lab.drivers.link import Link, LinkSettings, number, opened
from minorloop_head.sources import Shot

_PART = 256
"""Number of samples in one reading."""
_MOST = 1_000_000


class PulserSettings(LinkSettings, kw_only=True):
    """Commands of a pulser; ``done`` is queried after ``on`` and ``safe``."""

    fire: str
    on: list[str] = msgspec.field(default_factory=list)
    safe: list[str] = msgspec.field(default_factory=list)
    done: str = "*OPC?"


class DigitiserSettings(LinkSettings, kw_only=True):
    """Commands of a digitiser; see the module."""

    read: str
    samples: int
    interval: float | str
    on: list[str] = msgspec.field(default_factory=list)
    arm: str | None = None
    done: str = "*OPC?"
    """Query after the pulse, which is answered once the trace is there."""
    full_scale: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 2 <= self.samples <= _MOST:
            raise ValueError(f"samples is {self.samples}; give 2 to {_MOST}")
        if not self.full_scale > 0:
            raise ValueError(f"full_scale is {self.full_scale}; give a positive number")
        if "{first}" not in self.read or "{last}" not in self.read:
            raise ValueError(f"read is {self.read!r}, which has no {{first}} and {{last}}")


class Digitiser:
    """An `EchoSource` of instruments.

    Raises an `InstrumentError` if an instrument does not answer.

    ``link``: to the digitiser; ``pulser``: without it, arming the digitiser fires; ``clock``: gives
    the time of a shot, in seconds.
    """

    def __init__(
        self,
        settings: DigitiserSettings,
        link: Link,
        pulser: tuple[PulserSettings, Link] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._settings, self._link, self._pulser, self._clock = settings, link, pulser, clock
        try:
            for line in settings.on:
                link.send(line)
            asked = settings.interval
            found = number(link.ask(asked), link.name) if isinstance(asked, str) else asked
            if not 0 < found < np.inf:
                raise InstrumentError(f"{link.name} says {found} s between samples")
            self.interval = found
            if pulser is not None:
                _carry_out(pulser[0].on, pulser[0].done, pulser[1])
        except BaseException:
            self.close()
            raise

    def shot(self) -> Shot:
        """Fire one pulse, and return the received trace.

        Raises an `InstrumentError` if an instrument does not answer, or a sample is missing.
        """
        how, link = self._settings, self._link
        if how.arm is not None:
            link.send(how.arm)
        fired = self._clock()
        if self._pulser is not None:
            self._pulser[1].send(self._pulser[0].fire)
        link.ask(how.done)
        parts = [self._part(n) for n in range(1, how.samples + 1, _PART)]
        return Shot(fired, np.concatenate(parts) / how.full_scale, self.interval)

    def shots(self, count: int) -> list[Shot]:
        """Fire pulses, one after the other."""
        return [self.shot() for _ in range(count)]

    def _part(self, first: int) -> FloatArray:
        last = min(first + _PART - 1, self._settings.samples)
        line = self._settings.read.replace("{first}", str(first)).replace("{last}", str(last))
        answer = self._link.ask(line).split(",")
        if len(answer) != last - first + 1:
            raise InstrumentError(
                f"{self._link.name} answers {len(answer)} numbers to {line!r}, and "
                f"{last - first + 1} are asked for; check samples"
            )
        return np.array([number(each.strip(), self._link.name) for each in answer])

    def safe(self) -> None:
        """Switch the pulser off; raise an error unless it answers."""
        if self._pulser is not None:
            _carry_out(self._pulser[0].safe, self._pulser[0].done, self._pulser[1])

    def close(self) -> None:
        """Make the pulser safe, and close the connections."""
        links = [self._link] if self._pulser is None else [self._link, self._pulser[1]]
        all_done([self.safe, *(link.close for link in links)])


def _carry_out(lines: list[str], done: str, link: Link) -> None:
    for line in lines:
        link.send(line)
    link.ask(done)


def open_digitiser(path: PathLike) -> Digitiser:
    """Open the pulser and the digitiser in a TOML file.

    Raises a `ParameterError` if the file is not valid; an `InstrumentError` if an instrument is
    missing, or does not answer.
    """
    place = Path(path)
    try:
        content = tomllib.loads(place.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ParameterError(f"{place} cannot be read as TOML: {error}") from None
    if "digitiser" not in content or not set(content) <= {"digitiser", "pulser"}:
        raise ParameterError(f"{place} has {', '.join(content)}; give [digitiser] and [pulser]")
    how = parsed(DigitiserSettings, content["digitiser"], f"digitiser of {place}", "probe")
    pulses = content.get("pulser")
    settings = pulses and parsed(PulserSettings, pulses, f"pulser of {place}", "probe")
    link = opened(how, place.parent)
    try:
        pulser = (settings, opened(settings, place.parent)) if settings else None
    except BaseException:
        link.close()
        raise
    return Digitiser(how, link, pulser)
