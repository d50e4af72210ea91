"""Open an actuator from a file that describes a bench: ``visa:bench.json``.

::

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

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import msgspec

from minorloop.errors import MinorloopError, ParameterError
from minorloop.files import PathLike
from minorloop.lab.actuator import Channel
from minorloop.lab.drivers.bench import Bench, Clock
from minorloop.lab.drivers.link import VisaLink
from minorloop.lab.drivers.scpi import ScpiMeter, ScpiSource
from minorloop.lab.drivers.serial_line import Board

__all__ = ["open_bench"]

LARGEST = 1_000_000
"""Bytes of the largest file."""
_UNRELATED = "timeout", "baud", "safe_within", "safe_query", "safe_answer", "done"
"""Keys on which no reading depends; they may change before a run is resumed."""
_UNANSWERED = (
    "{} answers nothing, so it cannot confirm that it is safe; check it at the end of the run, or "
    "give confirm, errors, safe_query or done"
)


class _Section(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Part of the file; unknown keys are refused."""


class _Source(_Section):
    resource: str
    safe: list[str]
    set: str = "VOLT {:.9g}"
    on: list[str] = []
    confirm: str | None = None
    tolerance: float = 1e-3
    errors: str | None = None
    safe_query: str | None = None
    safe_answer: str | None = None
    done: str | None = "*OPC?"
    baud: int | None = None


class _Meter(_Section):
    resource: str
    read: str = "READ?"
    scale: float = 1.0
    zero: float = 0.0
    baud: int | None = None


class _Board(_Section):
    resource: str
    baud: int | None = None


class _Input(_Section):
    name: str
    low: float
    high: float
    unit: str = ""
    rate: float = float("inf")


class _Output(_Section):
    name: str
    unit: str = ""
    low: float = float("-inf")
    high: float = float("inf")


class _Bench(_Section):
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
    """Return the actuator that a file describes; make it safe and read it first.

    Parameters
    ----------
    path : str or path
        The file.
    clock : Clock, optional
        The clock of the machine if not given.

    Returns
    -------
    Bench

    Raises
    ------
    ParameterError
        If the file cannot be read, or does not describe a bench.
    MissingExtraError
        If PyVISA is not installed.
    InstrumentError
        If an instrument does not answer; a `SafetyError` if the source does not confirm that it is
        safe.
    """
    described = _read(Path(path))
    links: dict[str, VisaLink] = {}
    try:
        bench = _built(described, links, Path(path), clock)
        bench.check()
    except BaseException:
        for link in links.values():
            link.close()
        raise
    return bench


def _read(path: Path) -> _Bench:
    try:
        if path.stat().st_size > LARGEST:
            raise ParameterError(f"{path} is larger than {LARGEST} bytes; give a bench file")
        described = msgspec.json.decode(path.read_bytes(), type=_Bench)
    except MinorloopError:
        raise
    except OSError as error:
        raise ParameterError(f"{path} cannot be read: {error.strerror or error}") from None
    except (ValueError, RecursionError) as error:
        raise ParameterError(
            f"{path} does not describe a bench: {error}{_allowed(error)}"
        ) from None
    if described.board is not None and (described.source or described.meter):
        raise ParameterError(f"{path} has a board and a source or a meter; give one or the other")
    if described.board is None and (described.source is None or described.meter is None):
        raise ParameterError(f"{path} needs a source and a meter, or a board")
    return described


def _allowed(error: Exception) -> str:
    """Say which fields there are, where one is not known."""
    found = re.search(r"unknown field `.*?`(?: - at `\$\.(\w+)`)?", str(error))
    if not found:
        return ""
    sections: dict[str, Any] = {"source": _Source, "meter": _Meter, "board": _Board}
    sections |= {"input": _Input, "output": _Output}
    fields = msgspec.structs.fields(sections.get(found[1] or "", _Bench))
    return f"; the fields there are {', '.join(field.name for field in fields)}"


def _built(described: _Bench, links: dict[str, VisaLink], path: Path, clock: Clock | None) -> Bench:
    def link(part: Any) -> VisaLink:
        if part.resource not in links:  # a source-meter has both
            links[part.resource] = VisaLink(
                part.resource,
                library=_beside(described.library, path),
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
        options["warnings"] = [_UNANSWERED.format(described.source.resource)]
    return Bench(source, meter, channel, output, links=tuple(links.values()), **options)


def _description(described: msgspec.Struct) -> dict[str, Any]:
    """Return all on which a reading depends; timeouts are not part of it."""
    return {
        field.name: _description(value) if isinstance(value, msgspec.Struct) else value
        for field in msgspec.structs.fields(described)
        if (value := getattr(described, field.name)) != field.default
        and field.name not in _UNRELATED
    }


def _beside(library: str, path: Path) -> str:
    """Return the library; the file of a simulation is relative to the file that names it."""
    name, at, kind = library.rpartition("@")
    if not name or Path(name).is_absolute():
        return library
    return f"{path.parent / name}{at}{kind}"
