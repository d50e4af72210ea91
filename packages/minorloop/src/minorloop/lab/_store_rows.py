"""Rows of an experiment store: their content, and how they are written and read."""

from __future__ import annotations

import hashlib
import json
import math
import os
import sqlite3
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import OutputError, ParameterError
from minorloop.files import first_difference

MAGIC = b"SQLite format 3\0"
IN_USE = "another process has it open; wait until that one has ended"
SCHEMA = (
    "CREATE TABLE about (name TEXT PRIMARY KEY, value TEXT NOT NULL, digest TEXT NOT NULL)",
    "CREATE TABLE sitting (id INTEGER PRIMARY KEY, began TEXT NOT NULL, ended TEXT, "
    "first INTEGER NOT NULL, way TEXT NOT NULL, end TEXT, digest TEXT NOT NULL)",
    "CREATE TABLE point (id INTEGER PRIMARY KEY, input REAL NOT NULL, value REAL, sd REAL, "
    "verdict TEXT NOT NULL, t REAL NOT NULL, held REAL NOT NULL, checkpoint TEXT, "
    "sample_interval REAL, time_uncertainty REAL, digest TEXT NOT NULL)",
    "CREATE TABLE trace (id INTEGER PRIMARY KEY REFERENCES point (id), t BLOB NOT NULL, "
    "y BLOB NOT NULL, digest TEXT NOT NULL)",
)
ABOUT = "SELECT name, value, digest FROM about"
SESSIONS = "SELECT id, began, ended, first, way, end, digest FROM sitting ORDER BY id"
_KNOWN_OF_POINT = {
    1: "id, input, value, sd, verdict, t, held, checkpoint",
    2: "id, input, value, sd, verdict, t, held, checkpoint, sample_interval, time_uncertainty",
}
"""Columns of a point, by the format of the store."""
COUNTS = (
    "SELECT (SELECT coalesce(max(id) + 1, 0) FROM point WHERE id < ?1), "
    "(SELECT coalesce(max(id) + 1, 0) FROM trace WHERE id < ?1)"
)
POINTS = {
    version: f"SELECT {columns}, digest FROM point WHERE id >= ? AND id < ? ORDER BY id"
    for version, columns in _KNOWN_OF_POINT.items()
}
_MEDIAN = (
    "(SELECT avg(x) FROM (SELECT sample_interval AS x, count(*) OVER () AS n, row_number() OVER "
    "(ORDER BY sample_interval) AS k FROM point WHERE id < ?1 AND sample_interval > 0) "
    "WHERE k IN ((n + 1) / 2, n / 2 + 1))"
)
_TOTALS = {
    "points": "count(*)",
    "settled": "count(*) FILTER (WHERE verdict = 'settled')",
    "extrapolated": "count(*) FILTER (WHERE verdict = 'extrapolated')",
    "unsettled": "count(*) FILTER (WHERE verdict = 'unsettled')",
    "held": "total(held)",
    "lowest": "min(value)",
    "highest": "max(value)",
    "median_interval": _MEDIAN,
    "longest_interval": "max(sample_interval)",
    "time_uncertainty": "max(time_uncertainty)",
}
"""Figures of all points, by name; the last three are not in a store of format 1."""
TOTAL_NAMES = tuple(_TOTALS)
TOTALS = {
    version: f"SELECT {', '.join(columns)} FROM point WHERE id < ?1"
    for version, columns in (
        (1, [*list(_TOTALS.values())[:-3], *["NULL"] * 3]),
        (2, _TOTALS.values()),
    )
}
TRACES = "SELECT id, t, y, digest FROM trace"
INSERT_ABOUT = "INSERT OR IGNORE INTO about VALUES (?, ?, ?)"
REPLACE_SESSION = "REPLACE INTO sitting VALUES (?, ?, ?, ?, ?, ?, ?)"
INSERT_POINT = {
    version: f"INSERT INTO point VALUES ({', '.join('?' * (columns.count(',') + 2))})"
    for version, columns in _KNOWN_OF_POINT.items()
}
INSERT_TRACE = "INSERT INTO trace VALUES (?, ?, ?, ?)"


@dataclass(frozen=True)
class Setup:
    """The actuator and specimen that a plan is carried out on."""

    address: str
    """Address of the actuator, such as ``twin:ipmc``."""
    input: str
    output: str
    """Name and unit of each channel, such as ``voltage [V]``."""
    specimen: int | None = None
    """Seed of the specimen; None for the nominal one."""
    seed: int = 0
    """Seed of the noise."""
    options: dict[str, Any] = field(default_factory=dict)
    """Further options of `connect`, such as ``noise``; ready for JSON."""
    design: dict[str, Any] | None = None
    """Parameters of what chooses the levels that the plan leaves open: of an adaptive run or, under
    ``drive``, of a drive; under ``sines``, the sines of a run. Ready for JSON."""

    def to_json(self) -> str:
        """Return the setup as JSON; equal setups give equal text."""
        try:
            return json.dumps(asdict(self), sort_keys=True)
        except (TypeError, ValueError) as error:
            raise ParameterError(f"the setup cannot be written as JSON: {error}") from None

    def difference(self, other: Setup) -> str:
        """Return the first difference from another setup, in words; empty if there is none.

        Parameters
        ----------
        other : Setup
            To compare with.
        """
        for name, mine in asdict(self).items():
            theirs = getattr(other, name)
            if isinstance(mine, dict) and isinstance(theirs, dict):
                if difference := first_difference(mine, theirs, name):
                    return difference
            elif mine != theirs:
                return f"its {name} is {mine}, not {theirs}"
        return ""


@dataclass(frozen=True)
class Point:
    """The result of one hold."""

    index: int
    """Which level of the plan, counted from 0."""
    input: float
    """The level, in the unit of the input."""
    value: float
    sd: float
    """``value`` and ``sd``: settled output and its standard deviation, in the unit of the output;
    NaN where nothing was measured."""
    verdict: str
    """``settled``, ``extrapolated`` or ``unsettled``; see ``lab.settling``."""
    t: float
    """Time at the end of the hold since the first level was applied, by the clock of the actuator,
    in seconds. It includes the time to write points between holds, but not the time between two
    sessions."""
    held: float
    """Duration of the hold in seconds, from when the input was on."""
    checkpoint: dict[str, Any] | None = None
    """The state of a twin at the end of the hold."""
    sample_interval: float = math.nan
    """Mean time between samples, in seconds; longer than that of the plan where the meter was
    slower. NaN where there is only one sample, or the store has format 1."""
    time_uncertainty: float = math.nan
    """Largest error of a time of the hold, in seconds: half the exchange that set the input and
    half the longest that read the output; 0 for a twin, NaN in a store of format 1."""


@dataclass(frozen=True)
class RunSession:
    """One process that carried out part of the plan."""

    began: str
    """When, in UTC."""
    ended: str | None
    """When it ended; None if it was killed or is still running."""
    first: int
    """The point that it began with."""
    mode: str
    """How the actuator was brought there: ``fresh``, ``restored`` to exactly the state at the last
    settled point, or ``replayed``: its recorded inputs were applied again, unmeasured."""
    end: str | None
    """How it ended: ``finished``, ``interrupted``, or what went wrong."""


def sealed(*content: object) -> tuple[Any, ...]:
    """Return a row as it is written: its content, and a digest that shows changes."""
    return (*content, _digest(content))


def unsealed(row: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the content of a row.

    Raises a `ValueError` if it was changed since it was written.
    """
    *content, written = row
    if _digest(content) != written:
        raise ValueError(f"row {row[0]!r:.40} was altered")
    return tuple(content)


def point_row(point: Point, version: int) -> tuple[Any, ...]:
    """Return the row of a point, in a format of the store."""
    output = _or_none(point.value), _or_none(point.sd)
    times = _or_none(point.t), _or_none(point.held)
    state = None if point.checkpoint is None else json.dumps(point.checkpoint)
    known = _or_none(point.sample_interval), _or_none(point.time_uncertainty)
    content = (point.index, _or_none(point.input), *output, point.verdict, *times, state, *known)
    return sealed(*content[: _KNOWN_OF_POINT[version].count(",") + 1])


def as_point(row: tuple[Any, ...]) -> Point:
    """Return the point of a row; raise ``ValueError`` if the row was changed."""
    index, input, value, sd, verdict, t, held, state, *known = unsealed(row)
    checkpoint = None if state is None else json.loads(state)
    times = [_or_nan(item) for item in known]
    return Point(index, input, _or_nan(value), _or_nan(sd), verdict, t, held, checkpoint, *times)


def trace_row(index: int, t: FloatArray, y: FloatArray) -> tuple[Any, ...]:
    """Return the row of a trace: little-endian float64."""
    return sealed(index, *(np.asarray(values, dtype="<f8").tobytes() for values in (t, y)))


def as_trace(row: tuple[Any, ...]) -> tuple[FloatArray, FloatArray]:
    """Return the trace of a row; raise ``ValueError`` if the row was changed."""
    t, y = (np.frombuffer(item, dtype="<f8").astype(np.float64) for item in unsealed(row)[1:])
    return t, y


def as_session(row: tuple[Any, ...]) -> RunSession:
    """Return the session of a row; raise ``ValueError`` if the row was changed."""
    return RunSession(*unsealed(row)[1:])


def with_room_beside(target: Path) -> Path:
    """Return the name of a new store; refuse one that leaves no room for those beside it.

    Raises an `OutputError` if ``NAME-journal``, the longest of them, is too long for the file
    system.
    """
    try:
        os.lstat(f"{target}-journal")
    except FileNotFoundError:
        pass
    except OSError as error:
        raise OutputError(
            f"{target} cannot be a store, because files beside it have the same name with up to 8 "
            f"more characters ({error.strerror}); give a shorter name"
        ) from None
    return target


def reason(error: sqlite3.Error) -> str:
    """Return the error of SQLite in words."""
    name = getattr(error, "sqlite_errorname", "")
    for begin, words in (
        ("SQLITE_FULL", "the disk is full; make room"),
        ("SQLITE_BUSY", IN_USE),
        ("SQLITE_LOCKED", IN_USE),
        ("SQLITE_READONLY", "it is protected against writing"),
        ("SQLITE_CORRUPT", "it is damaged; restore a copy of it"),
        ("SQLITE_NOTADB", "it is not an experiment store, or damaged; run makes a new one"),
        ("SQLITE_CANTOPEN", "it, or the journal beside it, cannot be opened"),
        ("SQLITE_IOERR", f"the disk cannot read or write it ({error})"),
    ):
        if name.startswith(begin):
            return words
    return str(error)


def take_name(scratch: Path, target: Path) -> None:
    """Rename a finished file in one step; never replace an existing one.

    Raises an `OutputError` if the name exists, or the folder cannot be written.
    """
    try:
        try:
            os.link(scratch, target)  # unlike a rename, never replaces a file
        except FileExistsError:
            raise
        except OSError:  # a file system without links
            if target.exists():
                raise FileExistsError from None
            os.rename(scratch, target)
    except FileExistsError:
        raise OutputError(f"{target} exists already; give another name") from None
    except OSError as error:
        raise OutputError(f"{target} cannot be written: {error.strerror or error}") from None
    _sync_folder(target.parent)


def _sync_folder(folder: Path) -> None:
    """Make the new name survive a power cut, where the system can guarantee it."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        return
    try:
        os.fsync(handle)
    except OSError:
        pass
    finally:
        os.close(handle)


def _digest(content: Iterable[object]) -> str:
    summary = hashlib.sha256()
    for item in content:
        data = item if isinstance(item, bytes) else repr(item).encode()
        summary.update(len(data).to_bytes(8, "little") + data)
    return summary.hexdigest()


def _or_none(value: float) -> float | None:
    # SQLite keeps no negative zero, and the digest is of what is read back.
    return float(value) + 0.0 if math.isfinite(value) else None


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value
