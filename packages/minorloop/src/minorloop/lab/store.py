"""The experiment store: one run in one file, which is consistent after a crash at any time.

A store is an SQLite database. It is written under another name and renamed in one step, so that it
has the plan, the actuator, the specimen and the seed as soon as it exists. A settled point and its
raw trace are written in one transaction, with full synchronisation.

One process at a time can write: it locks a file beside the store. It writes points to a write-ahead
log beside the store. So any number of processes can read, and neither side waits for the other. The
log is copied into the store when the writer closes it, or after a crash when the store is next
opened.
"""

from __future__ import annotations

import json
import math
import os
import sqlite3
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, astuple, dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import MinorloopError, ParameterError, RecordError, StoreError, counted
from minorloop.files import PathLike, first_difference, lock_path
from minorloop.lab._store_file import (
    LOCK_WAIT,
    READ_WAIT,
    beside,
    create_file,
    digest,
    existing,
    explained,
    in_words,
    locked,
    prepare,
    unlock,
)
from minorloop.lab.plan import Plan
from minorloop.lab.records import Quantity, Record
from minorloop.lab.signals import Deferred

_COUNTS = (
    "SELECT (SELECT coalesce(max(id) + 1, 0) FROM point WHERE id < ?1), "
    "(SELECT coalesce(max(id) + 1, 0) FROM trace WHERE id < ?1)"
)
_TOTALS = (
    "SELECT count(*) AS points, "
    "count(*) FILTER (WHERE verdict = 'settled') AS settled, "
    "count(*) FILTER (WHERE verdict = 'extrapolated') AS extrapolated, "
    "count(*) FILTER (WHERE verdict = 'unsettled') AS unsettled, "
    "total(held) AS held, min(value) AS lowest, max(value) AS highest, "
    "max(sample_interval) AS longest_interval, max(time_uncertainty) AS time_uncertainty "
    "FROM point WHERE id < ?1"
)
_INTERVALS = "FROM point WHERE id < ?1 AND sample_interval > 0"
_MEDIAN_INTERVAL = (
    f"SELECT avg(x) FROM (SELECT sample_interval AS x {_INTERVALS} ORDER BY x "
    f"LIMIT 2 - (SELECT count(*) {_INTERVALS}) % 2 "
    f"OFFSET (SELECT (count(*) - 1) / 2 {_INTERVALS}))"
)


@dataclass(frozen=True)
class Setup:
    """The actuator and specimen on which a plan is carried out.

    Examples
    --------
    >>> ml.Setup("twin:ipmc", "voltage [V]", "curvature [1/m]").specimen is None
    True
    """

    address: str
    """Address of the actuator, such as ``twin:ipmc``."""
    input: str
    output: str
    """Name and unit of each channel, such as ``voltage [V]``."""
    specimen: int | None = None
    """Seed of the specimen; None for the nominal specimen."""
    seed: int = 0
    """Seed of the noise."""
    options: dict[str, Any] = field(default_factory=dict)
    """Further options of `connect`, such as ``noise``, for JSON."""
    design: dict[str, Any] | None = None
    """Parameters of the choice of open levels, for JSON: of an adaptive run or, under ``drive``, of
    a drive."""

    def to_json(self) -> str:
        """Return the setup as JSON; equal setups give equal text."""
        try:
            return json.dumps(asdict(self), sort_keys=True)
        except (TypeError, ValueError) as error:
            raise ParameterError(f"the setup cannot be written as JSON: {error}") from None


@dataclass(frozen=True)
class Point:
    """The result of one hold."""

    index: int
    """Number of the level in the plan, counted from 0."""
    input: float
    """The level, in the unit of the input."""
    value: float
    sd: float
    """``value`` and ``sd``: settled output and its standard deviation, in the unit of the output;
    NaN if not measured."""
    verdict: str
    """``settled``, ``extrapolated`` or ``unsettled``; see ``lab.settling``."""
    t: float
    """Time at the end of the hold since the first level was applied, by the clock of the actuator,
    in seconds. It includes the time to write points between holds, but not the time between two
    sessions."""
    held: float
    """Duration of the hold in seconds, from the time when the input was on."""
    checkpoint: dict[str, Any] | None = None
    """The state of a twin at the end of the hold."""
    sample_interval: float = math.nan
    """Mean time between samples, in seconds; longer than in the plan if the meter was slower. NaN
    for a single sample."""
    time_uncertainty: float = math.nan
    """Largest error of a time of the hold, in seconds: half the exchange that set the input plus
    half the longest exchange that read the output; 0 for a twin."""


@dataclass(frozen=True)
class RunSession:
    """One process that carried out part of the plan."""

    began: str
    """Time of the begin, in UTC."""
    ended: str | None
    """Time of the end, in UTC; None if it was killed or is still running."""
    first: int
    """The first point of the session."""
    mode: str
    """How the actuator was brought there: ``fresh``, ``restored`` to exactly the state at the last
    settled point, or ``replayed``: its recorded inputs were applied again, without measurement."""
    end: str | None
    """How it ended: ``finished``, ``interrupted``, or the error."""


class Store:
    """A plan, its actuator, and the points that have settled so far.

    Use ``Store.create`` or ``Store.open``, as a context manager. A store that is opened to read has
    the points that existed when it was opened.

    Parameters
    ----------
    path : Path
        The file.
    connection : sqlite3.Connection
        A connection to the file, from ``create`` or ``open``.
    lock : int, optional
        Descriptor of the locked file beside it, if the store is open to write.

    Examples
    --------
    >>> plan = ml.Plan([0.0, 0.5], longest=20.0, input="voltage [V]")
    >>> setup = ml.Setup("twin:ipmc", "voltage [V]", "curvature [1/m]")
    >>> with ml.Store.create("run.sqlite", plan, setup) as store:
    ...     len(store), store.finished
    (0, False)
    """

    path: Path
    plan: Plan
    setup: Setup

    def __init__(self, path: Path, connection: sqlite3.Connection, lock: int | None = None) -> None:
        self.path = path
        self._connection, self._lock = connection, lock
        about = dict(self._read("about"))
        self.plan = Plan.from_json(about["plan"])
        self.setup = Setup(**json.loads(about["setup"]))
        self._end = sys.maxsize
        if lock is None:
            self._end = len(self)
            self.last()
        else:
            self._check_points()
        self.sessions()

    @classmethod
    def create(cls, path: PathLike, plan: Plan, setup: Setup) -> Store:
        """Create a store, and open it to write.

        Raises an `OutputError` if the file exists already or cannot be written, or its name is too
        long.

        Parameters
        ----------
        path : str or path
            The file; an existing file is not replaced.
        plan : Plan
            The plan to carry out.
        setup : Setup
            Its actuator.
        """
        about = {"plan": plan.to_json(), "setup": setup.to_json()}
        return cls.open(create_file(path, about), write=True)

    @classmethod
    def open(cls, path: PathLike, *, write: bool = False) -> Store:
        """Open an existing store.

        The whole store is checked if it is opened to write; otherwise points and traces are checked
        when they are read.

        Raises a `StoreError` if there is no store, it is damaged or of a newer version, or another
        process writes to it and ``write`` is true.

        Parameters
        ----------
        path : str or path
            The file.
        write : bool
            Whether to add points. Other processes can then only read the store.
        """
        file = existing(path)
        if write and not (os.access(file, os.W_OK) and os.access(file.parent, os.W_OK)):
            raise StoreError(f"{file} and its folder must be writable; check their permissions")
        # Only SQLite opens the file: closing another handle on it would release the lock of another
        # connection of this process.
        uri = f"{file.absolute().as_uri()}?mode=rw"
        lock = locked(file) if write else None
        try:
            with explained(file):
                wait = READ_WAIT if write else LOCK_WAIT
                connection = sqlite3.connect(uri, uri=True, timeout=wait, isolation_level=None)
                try:
                    prepare(connection, write)
                    return cls(file, connection, lock)
                except BaseException:
                    connection.close()
                    raise
        except BaseException:
            unlock(file, lock)
            raise

    def close(self) -> None:
        """Close the file; the points in the log beside it are copied into it."""
        if self._lock is not None:
            with suppress(sqlite3.Error):  # if others read, the last of them copies the points
                self._execute("PRAGMA busy_timeout = 0")
                self._execute("PRAGMA journal_mode = DELETE")
        self._connection.close()
        unlock(self.path, self._lock)
        self._lock = None

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def __len__(self) -> int:
        with explained(self.path):
            count, traces = self._execute(_COUNTS, self._end).fetchone()
            if count != traces:
                raise ValueError(f"it has {counted(count, 'point')} and {counted(traces, 'trace')}")
        return int(count)

    @property
    def finished(self) -> bool:
        """Whether every level of the plan has its point, or no further level is chosen."""
        return self._noted("enough") is not None or len(self) == len(self.plan)

    @property
    def running(self) -> bool:
        """Whether a process has the store open to write."""
        if self._lock is not None:
            return True
        try:
            lock = lock_path(beside(self.path), shared=True)
        except FileNotFoundError:
            return False
        except OSError:  # the file of another user
            return True
        if lock is not None:
            os.close(lock)
        return lock is None

    @property
    def outputs(self) -> tuple[Quantity, Quantity]:
        """Name and unit of input and output."""
        return Quantity.parse(self.setup.input), Quantity.parse(self.setup.output)

    def check_same(self, plan: Plan, setup: Setup | None = None) -> None:
        """Refuse another plan or another actuator than that of the store.

        Raises a `StoreError` naming the first difference.

        Parameters
        ----------
        plan : Plan
            The plan to continue.
        setup : Setup, optional
            Its actuator; None is not compared.
        """
        difference = self.plan.difference(plan)
        if not difference and setup is not None:
            difference = first_difference(asdict(self.setup), asdict(setup))
        if difference:
            raise StoreError(
                f"{self.path} belongs to another run: {difference}; "
                "give the store of this run, or a new name"
            )

    def points(self, first: int = 0) -> list[Point]:
        """Return the points in the order in which they were measured.

        Parameters
        ----------
        first : int
            Index of the first point to return.
        """
        with explained(self.path):
            found = self._read("point", "WHERE id >= ? AND id < ? ORDER BY id", first, self._end)
            points = [_as_point(row) for row in found]
            for index, point in enumerate(points, first):
                if point.index != index or not self._is_level(index, point.input):
                    raise ValueError(f"point {index} is missing or is not that of the plan")
        return points

    def last(self) -> Point | None:
        """Return the last point; None if there is none."""
        count = len(self)
        return self.points(count - 1)[0] if count else None

    def totals(self) -> dict[str, Any]:
        """Return figures of all points, by name, without reading and checking each of them.

        ``points``, and the numbers of ``settled``, ``extrapolated`` and ``unsettled`` ones;
        ``held``, total seconds; ``lowest`` and ``highest`` value; ``median_interval`` and
        ``longest_interval`` between samples and the largest ``time_uncertainty``, in seconds. None
        if not known.
        """
        with explained(self.path):
            found = self._execute(_TOTALS, self._end)
            totals = dict(zip((one[0] for one in found.description), found.fetchone(), strict=True))
            (median,) = self._execute(_MEDIAN_INTERVAL, self._end).fetchone()
        return {**totals, "median_interval": median}

    def trace(self, index: int) -> tuple[FloatArray, FloatArray]:
        """Return times and outputs of the whole hold of a point, (T,) each.

        Raises a `ParameterError` if there is no such point.

        Parameters
        ----------
        index : int
            Index of the point.
        """
        with explained(self.path):
            if index in range(len(self)):
                _, *found = self._read("trace", "WHERE id = ?", index)[0]
                t, y = (np.frombuffer(x, dtype="<f8").astype(np.float64) for x in found)
                return t, y
        raise ParameterError(f"there is no point {index}; {self.path} has the first {len(self)}")

    def record(self) -> Record:
        """Return the points as a record for `identify`.

        Raises a `RecordError` if no point has settled yet.
        """
        points = self.points()
        if not points:
            raise RecordError(f"{self.path} has no settled point yet; resume the run first")
        t, u, y = (np.array([getattr(p, name) for p in points]) for name in ("t", "input", "value"))
        return Record(u, y, t, *self.outputs)

    def columns(self) -> dict[str, list[Any]]:
        """Return the columns of a table with one row for each point, by their headers."""
        points, (u, y) = self.points(), self.outputs
        measured = y if str(y) != str(u) else Quantity(f"measured {y.name}", y.unit)
        named = {
            "index": "index",
            str(u): "input",
            str(measured): "value",
            str(Quantity("sd", y.unit)): "sd",
            "verdict": "verdict",
            "time [s]": "t",
            "held [s]": "held",
            "sample interval [s]": "sample_interval",
            "time uncertainty [s]": "time_uncertainty",
        }
        return {header: [getattr(p, name) for p in points] for header, name in named.items()}

    def sessions(self) -> list[RunSession]:
        """Return every session that carried out part of the plan."""
        with explained(self.path):
            return [RunSession(*row[1:]) for row in self._read("sitting", "ORDER BY id")]

    def origin(self) -> dict[str, Any] | None:
        """Return the state of the actuator before the first level, if it was saved."""
        found: dict[str, Any] | None = self._noted("origin")
        return found

    def set_origin(self, checkpoint: dict[str, Any]) -> None:
        """Save the state of the actuator before the first level, once.

        Parameters
        ----------
        checkpoint : dict
            State of the actuator, from its ``checkpoint``.
        """
        self._note("origin", checkpoint)

    def bench(self) -> dict[str, Any] | None:
        """Return the description of the instruments, if the actuator has one."""
        found: dict[str, Any] | None = self._noted("bench")
        return found

    def check_bench(self, description: dict[str, Any]) -> None:
        """Refuse instruments other than those of the begin of the run; save their description once.

        Raises a `StoreError` naming the first difference.

        Parameters
        ----------
        description : dict
            Instruments and the conversion of their readings, for JSON.
        """
        before = self.bench()
        if before is None:
            self._note("bench", description)
        elif difference := first_difference(before, description):
            raise StoreError(
                f"{self.path} was measured on another bench: {difference}; restore the bench, or "
                "begin a new run"
            )

    def set_enough(self) -> None:
        """Note that the points are enough: the remaining levels stay open."""
        self._note("enough", True)

    @contextmanager
    def session(self, mode: str) -> Iterator[None]:
        """Context of a session that begins at the next point; its begin and its end are noted.

        Parameters
        ----------
        mode : str
            How the actuator was brought there.
        """
        number, session = len(self.sessions()) + 1, RunSession(_now(), None, len(self), mode, None)
        self._write_session(number, session)
        try:
            yield
        except BaseException as error:
            with suppress(MinorloopError):
                self._write_session(number, replace(session, ended=_now(), end=reason_of(error)))
            raise
        self._write_session(number, replace(session, ended=_now(), end="finished"))

    def add(self, point: Point, t: FloatArray, y: FloatArray) -> None:
        """Write a point and its trace, both or neither.

        Raises a `ParameterError` if it is not the next point of the plan, or times and outputs
        differ in number; a `StoreError` if it cannot be written; the store is as it was.

        Parameters
        ----------
        point : Point
            The next point of the plan.
        t : (T,) array_like
            Times of the hold, in seconds.
        y : (T,) array_like
            Outputs during it.
        """
        count = len(self)
        if point.index != count or self.finished:
            raise ParameterError(
                f"point {point.index} cannot be added; {self.path} has {count} of "
                f"{len(self.plan)} points"
            )
        if not self._is_level(count, point.input):
            level = self.plan.inputs[count]
            wanted = "open" if np.isnan(level) else level
            raise ParameterError(f"point {count} was taken at {point.input}; its level is {wanted}")
        if np.shape(t) != np.shape(y):
            raise ParameterError(f"the trace has times {np.shape(t)} and outputs {np.shape(y)}")
        trace = (np.asarray(values, dtype="<f8").tobytes() for values in (t, y))
        with self._transaction():
            self._insert("point", *_row_of(point))
            self._insert("trace", point.index, *trace)

    def _check_points(self) -> None:
        """Check that all points and traces are complete and unchanged."""
        count = len(self.points())
        traces = [row[0] for row in self._read("trace", "ORDER BY id")]
        if traces != list(range(count)):
            raise ValueError(f"it has {counted(count, 'point')}, and traces of others")

    def _is_level(self, index: int, level: float) -> bool:
        planned = self.plan.inputs[index : index + 1]
        return bool(np.isfinite(level) and (np.isnan(planned) | (planned == level)).any())

    def _noted(self, name: str) -> Any:
        """Return a note about the whole run by its name; None if there is none."""
        with explained(self.path):
            found = self._read("about", "WHERE name = ?", name)
            return json.loads(found[0][1]) if found else None

    def _note(self, name: str, content: Any) -> None:
        """Write a note, unless a note of this name exists."""
        with self._transaction():
            self._insert("about", name, json.dumps(content), how="INSERT OR IGNORE")

    def _write_session(self, number: int, session: RunSession) -> None:
        """Write a session, in place of its entry from the begin."""
        with self._transaction():
            self._insert("sitting", number, *astuple(session), how="REPLACE")

    def _insert(self, table: str, *content: Any, how: str = "INSERT") -> None:
        places = ", ".join("?" * (len(content) + 1))
        self._execute(f"{how} INTO {table} VALUES ({places})", *content, digest(content))

    def _read(self, table: str, clause: str = "", *values: object) -> list[tuple[Any, ...]]:
        """Return rows of a table without their digests.

        Raises a `ValueError` if a row was changed since it was written.
        """
        rows = []
        for *content, written in self._execute(f"SELECT * FROM {table} {clause}", *values):
            if digest(content) != written:
                raise ValueError(f"row {content[0]!r:.40} was altered")
            rows.append(tuple(content))
        return rows

    def _execute(self, statement: str, *values: object) -> sqlite3.Cursor:
        return self._connection.execute(statement, values)

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        with Deferred():
            try:
                if self._lock is not None:
                    self._execute("PRAGMA journal_mode = WAL")
                self._execute("BEGIN IMMEDIATE")
                yield
                self._execute("COMMIT")
            except BaseException as error:
                with suppress(sqlite3.Error):
                    if self._connection.in_transaction:
                        self._execute("ROLLBACK")
                if isinstance(error, sqlite3.Error):
                    raise StoreError(
                        f"{self.path} cannot be written: {in_words(error)}; "
                        "its points are kept, and the run can be continued from there"
                    ) from None
                raise


def summary(store: Store) -> dict[str, Any]:
    """Return the actuator, the specimen and the progress of a store, by name."""
    totals = store.totals()
    return {
        "store": str(store.path),
        "actuator": store.setup.address,
        "specimen": store.setup.specimen,
        "seed": store.setup.seed,
        **store.setup.options,
        "input": store.setup.input,
        "output": store.setup.output,
        "levels": len(store.plan),
        "points": totals["points"],
        "finished": store.finished,
        **{name: totals[name] for name in ("settled", "extrapolated", "unsettled")},
        "held_s": totals["held"],
        "sample_interval_s": store.plan.sample_interval,
        "median_interval_s": totals["median_interval"],
        "longest_interval_s": totals["longest_interval"],
        "time_uncertainty_s": totals["time_uncertainty"],
    }


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def reason_of(error: BaseException) -> str:
    """Return how a session ended, in words."""
    if isinstance(error, KeyboardInterrupt):
        return "interrupted"
    return str(error) or type(error).__name__


def _row_of(point: Point) -> list[Any]:
    """Return a point as a row: SQLite keeps neither NaN nor negative zeros."""
    state = None if point.checkpoint is None else json.dumps(point.checkpoint)
    known = {**vars(point), "checkpoint": state}
    return [_or_none(each) if isinstance(each, float) else each for each in known.values()]


def _as_point(row: tuple[Any, ...]) -> Point:
    """Return the point of a row."""
    index, input, value, sd, verdict, t, held, state, *times = row
    checkpoint = None if state is None else json.loads(state)
    value, sd, *times = (math.nan if x is None else x for x in (value, sd, *times))
    return Point(index, input, value, sd, verdict, t, held, checkpoint, *times)


def _or_none(value: float) -> float | None:
    # SQLite does not keep negative zeros, and the digest must match the numbers that are read back.
    return float(value) + 0.0 if math.isfinite(value) else None
