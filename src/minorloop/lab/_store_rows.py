"""What is in the rows of an experiment store, and how it gets in and out."""

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
SITTINGS = "SELECT id, began, ended, first, way, end, digest FROM sitting ORDER BY id"
_KNOWN_OF_POINT = {
    1: "id, input, value, sd, verdict, t, held, checkpoint",
    2: "id, input, value, sd, verdict, t, held, checkpoint, sample_interval, time_uncertainty",
}
"""Columns of a point, by the format of the store."""
POINTS = {
    version: f"SELECT {columns}, digest FROM point ORDER BY id"
    for version, columns in _KNOWN_OF_POINT.items()
}
TRACES = "SELECT id, t, y, digest FROM trace ORDER BY id"
INSERT_ABOUT = "INSERT OR IGNORE INTO about VALUES (?, ?, ?)"
REPLACE_SITTING = "REPLACE INTO sitting VALUES (?, ?, ?, ?, ?, ?, ?)"
INSERT_POINT = {
    version: f"INSERT INTO point VALUES ({', '.join('?' * (columns.count(',') + 2))})"
    for version, columns in _KNOWN_OF_POINT.items()
}
INSERT_TRACE = "INSERT INTO trace VALUES (?, ?, ?, ?)"


@dataclass(frozen=True)
class Setup:
    """What a plan is carried out on.

    Parameters
    ----------
    address : str
        Where the actuator is, such as ``twin:ipmc``.
    input, output : str
        Name and unit of its channels, such as ``voltage [V]``.
    specimen : int, optional
        Seed of the specimen; None for the nominal one.
    seed : int
        Seed of the noise.
    options : dict
        What else it takes to connect to it, such as ``noise``; ready for JSON.
    design : dict, optional
        What chooses the levels that the plan leaves open; ready for JSON.
    """

    address: str
    input: str
    output: str
    specimen: int | None = None
    seed: int = 0
    options: dict[str, Any] = field(default_factory=dict)
    design: dict[str, Any] | None = None

    def to_json(self) -> str:
        """The setup as JSON; equal setups give equal text."""
        try:
            return json.dumps(asdict(self), sort_keys=True)
        except (TypeError, ValueError) as error:
            raise ParameterError(f"the setup cannot be written as JSON: {error}") from None

    def difference(self, other: Setup) -> str:
        """The first thing in which another setup differs, in words; empty if it is the same.

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
    """A level that was held to its end.

    Parameters
    ----------
    index : int
        Which level of the plan, counted from 0.
    input : float
        The level, in the unit of the input.
    value, sd : float
        Settled output and its standard deviation, in the unit of the output; NaN where
        nothing was measured.
    verdict : str
        ``settled``, ``extrapolated`` or ``unsettled``; see ``lab.settling``.
    t : float
        Time at the end of the hold since the first level was applied, by the clock of the actuator,
        in seconds. What a store took to write a point between two holds is in it; the time between
        two sittings is not.
    held : float
        How long it was held, in seconds: from when the input was on to the end of the hold.
    checkpoint : dict, optional
        The state of a twin at the end of the hold.
    sample_interval : float
        Time between samples on average, in seconds; longer than that of the plan where the meter
        was slower. NaN where there is one sample only, or the store is older than that.
    time_uncertainty : float
        No time of the hold is further from the true one, in seconds: half the exchange that set the
        input and half the longest that read the output; 0 for a twin, NaN in an older store.
    """

    index: int
    input: float
    value: float
    sd: float
    verdict: str
    t: float
    held: float
    checkpoint: dict[str, Any] | None = None
    sample_interval: float = math.nan
    time_uncertainty: float = math.nan


@dataclass(frozen=True)
class Sitting:
    """One process that carried the plan on.

    Parameters
    ----------
    began : str
        When, in UTC.
    ended : str, optional
        When it ended; None where it was killed, or is still at work.
    first : int
        The point that it began with.
    way : str
        How the actuator got there: ``fresh``, ``restored`` to exactly the state at the last
        settled point, or ``replayed``: taken through its recorded inputs again, unmeasured.
    end : str, optional
        How it ended: ``finished``, ``interrupted``, or what went wrong.
    """

    began: str
    ended: str | None
    first: int
    way: str
    end: str | None


def sealed(*content: object) -> tuple[Any, ...]:
    """A row as it is written: its content, and a digest that tells whether it was altered."""
    return (*content, _digest(content))


def unsealed(row: tuple[Any, ...]) -> tuple[Any, ...]:
    """The content of a row as it was written.

    Raises
    ------
    ValueError
        If it was altered since.
    """
    *content, written = row
    if _digest(content) != written:
        raise ValueError(f"row {row[0]!r:.40} was altered")
    return tuple(content)


def point_row(point: Point, version: int) -> tuple[Any, ...]:
    """A point as a store of some format keeps it."""
    output = _or_none(point.value), _or_none(point.sd)
    times = _or_none(point.t), _or_none(point.held)
    state = None if point.checkpoint is None else json.dumps(point.checkpoint)
    known = _or_none(point.sample_interval), _or_none(point.time_uncertainty)
    content = (point.index, _or_none(point.input), *output, point.verdict, *times, state, *known)
    return sealed(*content[: _KNOWN_OF_POINT[version].count(",") + 1])


def as_point(row: tuple[Any, ...]) -> Point:
    """A point as it was written; raises ``ValueError`` if it was altered since."""
    index, input, value, sd, verdict, t, held, state, *known = unsealed(row)
    checkpoint = None if state is None else json.loads(state)
    times = [_or_nan(item) for item in known]
    return Point(index, input, _or_nan(value), _or_nan(sd), verdict, t, held, checkpoint, *times)


def trace_row(index: int, t: FloatArray, y: FloatArray) -> tuple[Any, ...]:
    """A trace as it is written: little-endian float64."""
    return sealed(index, *(np.asarray(values, dtype="<f8").tobytes() for values in (t, y)))


def as_trace(row: tuple[Any, ...]) -> tuple[FloatArray, FloatArray]:
    """A trace as it was written; raises ``ValueError`` if it was altered since."""
    t, y = (np.frombuffer(item, dtype="<f8").astype(np.float64) for item in unsealed(row)[1:])
    return t, y


def as_sitting(row: tuple[Any, ...]) -> Sitting:
    """A sitting as it was written; raises ``ValueError`` if it was altered since."""
    return Sitting(*unsealed(row)[1:])


def reason(error: sqlite3.Error) -> str:
    """What SQLite says, for people."""
    name = getattr(error, "sqlite_errorname", "")
    for begin, words in (
        ("SQLITE_FULL", "the disk is full; make room"),
        ("SQLITE_BUSY", "another process has it open; wait until that one has ended"),
        ("SQLITE_LOCKED", "another process has it open; wait until that one has ended"),
        ("SQLITE_READONLY", "it is protected against writing"),
        ("SQLITE_CORRUPT", "it is damaged; restore a copy of it"),
        ("SQLITE_NOTADB", "it is not an experiment store, or damaged; run makes a new one"),
        ("SQLITE_CANTOPEN", "it, or the journal beside it, cannot be opened"),
        ("SQLITE_IOERR", f"the disk does not take or give it ({error})"),
    ):
        if name.startswith(begin):
            return words
    return str(error)


def take_name(scratch: Path, target: Path) -> None:
    """Give a finished file its name in one move, unless something has that name.

    Raises
    ------
    OutputError
        If something has it, or the folder does not allow it.
    """
    try:
        try:
            os.link(scratch, target)  # unlike a rename, never replaces what is there
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
    _settle_folder(target.parent)


def _settle_folder(folder: Path) -> None:
    """Have the new name survive a loss of power, where the system can promise that."""
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
    # SQLite keeps no negative zero, and what is read has to be what was sealed.
    return float(value) + 0.0 if math.isfinite(value) else None


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value
