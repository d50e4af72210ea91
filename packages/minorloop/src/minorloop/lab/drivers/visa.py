"""Instruments through PyVISA: SCPI and similar commands in lines of text.

On a bench with several channels, a device of the driver ``visa`` has ``resource``, ``library``,
``timeout`` and ``baud``; its sources have the commands of ``source`` below (``set``, ``safe``
and so on), its sensors ``read``. A digital line has the commands ``on`` and ``off``, and may have
a question, ``ask``, with the answers ``is_on`` and ``is_off``.

A bench with one channel may be described shortly, also in JSON::

    {"library": "@py",
     "source": {"resource": "GPIB0::5::INSTR", "set": "VOLT {:.9g}", "on": ["OUTP ON"],
                "safe": ["VOLT 0", "OUTP OFF"], "confirm": "VOLT?"},
     "meter": {"resource": "GPIB0::7::INSTR", "read": "READ?", "scale": 0.001},
     "input": {"name": "voltage", "unit": "V", "low": -1.2, "high": 1.2, "rate": 10},
     "output": {"name": "displacement", "unit": "m", "low": 0, "high": 0.03},
     "rest": 0, "tick": 0.05, "timeout": 2, "safe_within": 10}

After each input the source is asked ``confirm`` and ``errors``. If neither is given, it is asked
``done``, to which any answer is right. After ``safe`` it is asked the same, but the answer to
``confirm`` must be ``rest``. ``safe_query``, whose answer must be ``safe_answer``, then takes the
place of ``confirm``. ``"done": null`` is for a source that answers nothing.

Instead of source and meter there may be ``"board": {"resource": "ASRL/dev/ttyACM0::INSTR",
"baud": 115200}``, a board with the protocol of `minorloop.lab.drivers.serial_line`.
"""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import InstrumentError, ParameterError
from minorloop.files import PathLike
from minorloop.lab.actuator import Channel
from minorloop.lab.drivers.bench import Bench, Clock
from minorloop.lab.drivers.description import UNRELATED, Section, parsed, read_description
from minorloop.lab.drivers.device import DevicePlan, all_done
from minorloop.lab.drivers.link import Link, VisaLink
from minorloop.lab.drivers.scpi import ScpiMeter, ScpiSource
from minorloop.lab.drivers.serial_line import Board

__all__ = ["NEEDS", "ScpiDevice", "found", "open_bench", "open_device", "open_single"]

NEEDS = "pyvisa", "instruments"
"""Library of the driver, and the extra that installs it."""

UNANSWERED = (
    "{} answers nothing, so it cannot confirm that it is safe; check it at the end of the run, or "
    "give confirm, errors, safe_query or done"
)


class _Commands(Section, kw_only=True):
    safe: list[str]
    set: str = "VOLT {:.9g}"
    on: list[str] = msgspec.field(default_factory=list)
    confirm: str | None = None
    tolerance: float = 1e-3
    errors: str | None = None
    safe_query: str | None = None
    safe_answer: str | None = None
    done: str | None = "*OPC?"


class _Source(_Commands, kw_only=True):
    resource: str
    baud: int | None = None


class _Query(Section, kw_only=True):
    read: str = "READ?"


class _Meter(_Query, kw_only=True):
    resource: str
    scale: float = 1.0
    zero: float = 0.0
    baud: int | None = None


class _LineCommands(Section, kw_only=True):
    on: str
    off: str
    ask: str | None = None
    is_on: str = "1"
    is_off: str = "0"


class _VisaSettings(Section, kw_only=True):
    resource: str
    library: str = "@py"
    timeout: float = 2.0
    baud: int | None = None


class _Board(Section, kw_only=True):
    resource: str
    baud: int | None = None


class _Input(Section, kw_only=True):
    name: str
    low: float
    high: float
    unit: str = ""
    rate: float = float("inf")


class _Output(Section, kw_only=True):
    name: str
    unit: str = ""
    low: float = float("-inf")
    high: float = float("inf")


class _Bench(Section, kw_only=True):
    input: _Input
    output: _Output
    source: _Source | None = None
    meter: _Meter | None = None
    board: _Board | None = None
    library: str = "@py"
    rest: float = 0.0
    tick: float = 0.05
    timeout: float = 2.0
    safe_within: float = 10.0


def open_bench(path: PathLike, *, clock: Clock | None = None) -> Bench:
    """Return the actuator of one channel that a file describes; make it safe and read it first.

    Parameters
    ----------
    path : str or path
        The file.
    clock : Clock, optional
        The clock of the machine if not given.

    Raises
    ------
    ParameterError
        If the file cannot be read, or does not describe such a bench.
    MissingExtraError
        If PyVISA is not installed.
    InstrumentError
        If an instrument does not answer; a `SafetyError` if the source does not confirm that it is
        safe.
    """
    return open_single(read_description(Path(path)), Path(path), clock)


def open_single(content: Mapping[str, Any], path: Path, clock: Clock | None = None) -> Bench:
    """Return the actuator of one channel for the content of a file, as `open_bench` does."""
    described = parsed(_Bench, content, path)
    if described.board is not None and (described.source or described.meter):
        raise ParameterError(f"{path} has a board and a source or a meter; give one or the other")
    if described.board is None and (described.source is None or described.meter is None):
        raise ParameterError(f"{path} needs a source and a meter, or a board")
    links: dict[str, VisaLink] = {}
    try:
        bench = _built(described, links, path, clock)
        bench.check()
    except BaseException:
        for link in links.values():
            link.close()
        raise
    return bench


class ScpiDevice:
    """An instrument with several channels, each with commands of its own.

    Parameters
    ----------
    link : Link
    sources : sequence of ScpiSource
    meters : sequence of ScpiMeter
    lines : sequence
        Commands of digital lines.
    rest : mapping of int to bool
        Lines when the device is safe.
    """

    def __init__(
        self,
        link: Link,
        sources: tuple[ScpiSource, ...],
        meters: tuple[ScpiMeter, ...],
        lines: tuple[_LineCommands, ...],
        rest: Mapping[int, bool],
    ) -> None:
        self._link, self._sources, self._meters = link, sources, meters
        self._lines, self._rest = lines, dict(rest)

    def set(self, values: FloatArray) -> None:
        """Set all sources, one after the other."""
        for source, value in zip(self._sources, values.tolist(), strict=True):
            source.set(value)

    def read(self) -> FloatArray:
        """Return the readings of all meters."""
        return np.array([meter.read() for meter in self._meters])

    def switch(self, values: Mapping[int, bool]) -> None:
        """Switch lines on or off."""
        for number, on in values.items():
            line = self._lines[number]
            self._link.send(line.on if on else line.off)
            wanted = line.is_on if on else line.is_off
            if line.ask is not None and (answer := self._link.ask(line.ask)) != wanted:
                raise InstrumentError(
                    f"{self._link.name} answers {answer[:80]!r} to {line.ask!r}, not {wanted!r}"
                )

    def safe(self) -> None:
        """Make all sources safe, and set the lines to rest."""
        all_done([*(source.safe for source in self._sources), lambda: self.switch(self._rest)])

    def close(self) -> None:
        """Close the connection."""
        self._link.close()


def open_device(plan: DevicePlan) -> ScpiDevice:
    """Return an instrument with several channels.

    Raises
    ------
    ParameterError
        If a key is missing, unknown, or of another type.
    MissingExtraError, InstrumentError
        As `open_bench`.
    """
    how = parsed(_VisaSettings, plan.keys, f"device {plan.name!r}", "device")
    lines = tuple(wire.parsed(_LineCommands) for wire in plan.lines)
    commands = [wire.parsed(_Commands) for wire in plan.sources]
    queries = [wire.parsed(_Query) for wire in plan.sensors]
    link = VisaLink(
        how.resource,
        library=_beside(how.library, plan.folder),
        timeout=how.timeout,
        baud=how.baud,
    )
    try:
        sources = tuple(
            ScpiSource(link, span=wire.high - wire.low, rest=wire.rest, **_fields(each))
            for wire, each in zip(plan.sources, commands, strict=True)
        )
        meters = tuple(ScpiMeter(link, read=each.read) for each in queries)
        link.last_lines = tuple(line for each in commands for line in each.safe)
        return ScpiDevice(link, sources, meters, lines, plan.resting_lines)
    except BaseException:
        link.close()
        raise


def found() -> list[str]:
    """Return the resources that PyVISA-py sees, but serial ports: USB, GPIB and network."""
    try:
        import pyvisa

        with warnings.catch_warnings():  # of libraries for a kind of connection that are missing
            warnings.simplefilter("ignore")
            found = pyvisa.ResourceManager("@py").list_resources()
    except Exception:  # each backend has its own errors
        return []
    return [str(each) for each in found if not str(each).startswith("ASRL")]


def _fields(commands: _Commands) -> dict[str, Any]:
    return msgspec.structs.asdict(commands)


def _built(described: _Bench, links: dict[str, VisaLink], path: Path, clock: Clock | None) -> Bench:
    def link(part: Any) -> VisaLink:
        if part.resource not in links:  # a source-meter has both
            links[part.resource] = VisaLink(
                part.resource,
                library=_beside(described.library, path.parent),
                timeout=described.timeout,
                baud=part.baud,
            )
        return links[part.resource]

    wanted, seen = described.input, described.output
    channel = Channel(wanted.name, wanted.unit, wanted.low, wanted.high, wanted.rate)
    output = Channel(seen.name, seen.unit, seen.low, seen.high)
    options: dict[str, Any] = {
        **{name: getattr(described, name) for name in ("rest", "tick", "safe_within")},
        "clock": clock,
        "description": _description(described),
    }
    if described.board is not None:
        board = Board(link(described.board))
        if not board.low <= channel.low < channel.high <= board.high:
            raise ParameterError(
                f"{path} allows [{channel.low:g}, {channel.high:g}] and the board "
                f"[{board.low:g}, {board.high:g}]; give limits inside those of the board"
            )
        board.keep_alive()
        return Bench(board, board, channel, output, links=tuple(links.values()), **options)
    assert described.source is not None
    assert described.meter is not None
    fields = msgspec.structs.asdict(described.source)
    source = ScpiSource(
        link(described.source),
        span=channel.high - channel.low,
        rest=described.rest,
        **{k: v for k, v in fields.items() if k not in ("resource", "baud")},
    )
    meter = ScpiMeter(
        link(described.meter),
        read=described.meter.read,
        scale=described.meter.scale,
        zero=described.meter.zero,
    )
    link(described.source).last_lines = tuple(described.source.safe)
    if not source.answers:
        options["warnings"] = [UNANSWERED.format(described.source.resource)]
    return Bench(source, meter, channel, output, links=tuple(links.values()), **options)


def _description(described: msgspec.Struct) -> dict[str, Any]:
    """Return all on which a reading depends; timeouts are not part of it."""
    return {
        field.name: _description(value) if isinstance(value, msgspec.Struct) else value
        for field in msgspec.structs.fields(described)
        if (value := getattr(described, field.name)) != field.default
        and field.name not in UNRELATED
    }


def _beside(library: str, folder: Path) -> str:
    """Return the library; the file of a simulation is relative to a folder."""
    name, at, kind = library.rpartition("@")
    if not name or Path(name).is_absolute():
        return library
    return f"{folder / name}{at}{kind}"
