"""The experiment store: one run in one file, and nothing in it that is half written.

A store is an SQLite database. It is made under another name and takes its own in one move, so
that a store that can be seen already holds the plan, the actuator, the specimen and the seed.
A settled point and its raw trace are written in one transaction, which a rollback journal and
the default of full synchronisation carry through a crash at any instant. Whoever opens a store
to write has it alone.
"""

from __future__ import annotations

import json
import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError, RecordError, StoreError
from minorloop.files import PathLike, check_writable
from minorloop.lab import _store_rows as rows
from minorloop.lab._store_rows import Point, Setup, Sitting
from minorloop.lab.plan import Plan
from minorloop.lab.records import Quantity, Record

__all__ = ["Point", "Setup", "Sitting", "Store", "is_store"]

APPLICATION = 0x6D6C6F70
"""The application id in the header of the file: 'mlop'."""
VERSION = 1
_PATIENCE = 1.0
"""Seconds to wait for another process that is just finishing."""


def is_store(path: PathLike) -> bool:
    """Whether a file begins as an SQLite database does; false where it cannot be read."""
    with suppress(OSError, ValueError), open(path, "rb") as file:
        return file.read(len(rows.MAGIC)) == rows.MAGIC
    return False


class Store:
    """A plan, what it is carried out on, and the points that have settled so far.

    Make one with ``Store.create`` or ``Store.open``; use it as a context manager.
    """

    path: Path
    plan: Plan
    setup: Setup

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path = path
        self._connection = connection
        with self._explained():
            self.plan, self.setup = self._read_header()
            self._count = self._check_points()

    @classmethod
    def create(cls, path: PathLike, plan: Plan, setup: Setup) -> Store:
        """Make a store and open it to write.

        Parameters
        ----------
        path : str or path
            Where; nothing that exists is replaced.
        plan : Plan
            What is going to be carried out.
        setup : Setup
            On what.

        Raises
        ------
        OutputError
            If the file exists already or cannot be made.
        StoreError
            If the disk is full.
        """
        target = check_writable(path)
        scratch = target.with_name(f".minorloop-{os.urandom(6).hex()}.tmp")
        try:
            _write_header(scratch, plan, setup)
            rows.take_name(scratch, target)
        except sqlite3.Error as error:
            raise StoreError(f"{target} cannot be made: {rows.reason(error)}") from None
        finally:
            for leftover in (scratch, scratch.with_name(scratch.name + "-journal")):
                with suppress(OSError):
                    leftover.unlink(missing_ok=True)
        return cls.open(target, write=True)

    @classmethod
    def open(cls, path: PathLike, *, write: bool = False) -> Store:
        """Open a store that exists, after checking all of it.

        Parameters
        ----------
        path : str or path
            The file.
        write : bool
            Whether points are going to be added. Nobody else can open the store meanwhile.

        Raises
        ------
        StoreError
            If there is no store, it is damaged, was written by a newer version, or another
            process has it open.
        """
        file = Path(path)
        if not file.is_file():
            missing = "is not a regular file" if file.exists() else "does not exist"
            raise StoreError(f"{file} {missing}; give the name of an experiment store")
        if not os.access(file, os.R_OK) or (write and not os.access(file, os.W_OK)):
            raise StoreError(f"{file} cannot be {'written' if write else 'read'}; check its rights")
        if not is_store(file):
            raise StoreError(f"{file} is not an experiment store; run makes one")
        connection = None
        try:
            uri = f"{file.absolute().as_uri()}?mode=rw"
            connection = sqlite3.connect(uri, uri=True, timeout=_PATIENCE, isolation_level=None)
            _prepare(connection, write)
            return cls(file, connection)
        except BaseException as error:
            if connection is not None:
                connection.close()
            if isinstance(error, sqlite3.Error):
                raise StoreError(f"{file} cannot be used: {rows.reason(error)}") from None
            raise

    def close(self) -> None:
        """Let go of the file."""
        self._connection.close()

    def __enter__(self) -> Store:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def __len__(self) -> int:
        return self._count

    @property
    def finished(self) -> bool:
        """Whether every level of the plan has its point."""
        return self._count == len(self.plan)

    @property
    def outputs(self) -> tuple[Quantity, Quantity]:
        """Name and unit of input and output."""
        return Quantity.parse(self.setup.input), Quantity.parse(self.setup.output)

    def check_same(self, plan: Plan, setup: Setup | None = None) -> None:
        """Refuse to go on with another plan or on another actuator than the store is about.

        Raises
        ------
        StoreError
            Naming the first difference.
        """
        difference = self.plan.difference(plan)
        if not difference and setup is not None:
            difference = self.setup.difference(setup)
        if difference:
            raise StoreError(
                f"{self.path} belongs to another run: {difference}; "
                "give the store of this run, or a new name"
            )

    def points(self) -> list[Point]:
        """The settled points, in the order in which they were taken."""
        with self._explained():
            return [rows.as_point(row) for row in self._select(rows.POINTS)]

    def last(self) -> Point | None:
        """The point that settled last."""
        with self._explained():
            found = self._select(f"{rows.POINTS} DESC LIMIT 1")
        return rows.as_point(found[0]) if found else None

    def trace(self, index: int) -> tuple[FloatArray, FloatArray]:
        """Times and outputs of the whole hold of a point, (T,) each.

        Raises
        ------
        ParameterError
            If there is no such point.
        """
        if not 0 <= index < self._count:
            raise ParameterError(
                f"there is no point {index}; {self.path} has points 0 to {self._count - 1}"
            )
        with self._explained():
            t, y = self._select("SELECT t, y FROM trace WHERE id = ?", index)[0]
        return rows.as_array(t), rows.as_array(y)

    def record(self) -> Record:
        """The settled points as a record, ready to be identified.

        Raises
        ------
        RecordError
            If no point has settled yet.
        """
        points = self.points()
        if not points:
            raise RecordError(f"{self.path} has no settled point yet; resume the run first")
        t, u, y = (np.array([getattr(p, name) for p in points]) for name in ("t", "input", "value"))
        return Record(t, u, y, *self.outputs)

    def columns(self) -> dict[str, list[Any]]:
        """One row a settled point, as columns by their headers; what ``export`` writes."""
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
        }
        return {header: [getattr(p, name) for p in points] for header, name in named.items()}

    def sittings(self) -> list[Sitting]:
        """Every time that somebody sat down to carry the plan on, and how that ended."""
        with self._explained():
            return [rows.as_sitting(row) for row in self._select(rows.SITTINGS)]

    def origin(self) -> dict[str, Any] | None:
        """The state of the actuator before the first level, where it can tell."""
        with self._explained():
            found = self._select("SELECT value FROM about WHERE name = 'origin'")
            return json.loads(found[0][0]) if found else None

    def set_origin(self, checkpoint: dict[str, Any]) -> None:
        """Keep the state of the actuator before the first level, once."""
        with self._transaction():
            self._execute(
                "INSERT OR IGNORE INTO about VALUES ('origin', ?)", json.dumps(checkpoint)
            )

    def begin_sitting(self, way: str) -> int:
        """Note that the run goes on from here, and in which way the actuator got here."""
        with self._transaction():
            cursor = self._execute(
                "INSERT INTO sitting (began, first, way) VALUES (?, ?, ?)",
                _now(),
                self._count,
                way,
            )
        return int(cursor.lastrowid or 0)

    def end_sitting(self, number: int, end: str) -> None:
        """Note how a sitting ended."""
        with self._transaction():
            self._execute("UPDATE sitting SET ended = ?, end = ? WHERE id = ?", _now(), end, number)

    def add(self, point: Point, t: FloatArray, y: FloatArray) -> None:
        """Write a settled point and its trace, both or neither, before the run goes on.

        Raises
        ------
        ParameterError
            If it is not the next point of the plan.
        StoreError
            If it cannot be written; the store is as it was.
        """
        if point.index != self._count or self.finished:
            raise ParameterError(f"point {point.index} is not the next one, {self._count}")
        trace = (rows.as_bytes(t), rows.as_bytes(y))
        with self._transaction():
            self._execute(rows.INSERT_POINT, *rows.point_row(point))
            self._execute(rows.INSERT_TRACE, point.index, *trace, rows.digest(point.index, *trace))
        self._count += 1

    def _read_header(self) -> tuple[Plan, Setup]:
        about = dict(self._select("SELECT name, value FROM about"))
        plan = Plan.from_json(about["plan"])
        if rows.digest(about["plan"], about["setup"]) != about["digest"]:
            raise ValueError("the plan was altered")
        return plan, Setup(**json.loads(about["setup"]))

    def _check_points(self) -> int:
        """Count the points, after checking that they are all there and as they were written."""
        count = 0
        for row in self._connection.execute(rows.POINTS):
            if row[0] != count or count >= len(self.plan) or row[1] != self.plan.inputs[count]:
                raise ValueError(f"point {count} is missing or is not that of the plan")
            rows.as_point(row)
            count += 1
        traces = 0
        for index, t, y, digest in self._connection.execute(rows.TRACES):
            if index != traces or rows.digest(index, t, y) != digest or len(t) != len(y):
                raise ValueError(f"the trace of point {traces} is missing or was altered")
            traces += 1
        if traces != count:
            raise ValueError(f"it has {count} points and {traces} traces")
        return count

    def _select(self, statement: str, *values: object) -> list[tuple[Any, ...]]:
        return self._connection.execute(statement, values).fetchall()

    def _execute(self, statement: str, *values: object) -> sqlite3.Cursor:
        return self._connection.execute(statement, values)

    @contextmanager
    def _explained(self) -> Iterator[None]:
        """Say of a store that cannot be read why, in one sentence."""
        try:
            yield
        except sqlite3.Error as error:
            raise StoreError(f"{self.path} cannot be read: {rows.reason(error)}") from None
        except RecordError:
            raise
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise StoreError(f"{self.path} is damaged: {error}; restore a copy of it") from None

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        try:
            self._connection.execute("BEGIN IMMEDIATE")
            yield
            self._connection.execute("COMMIT")
        except BaseException as error:
            with suppress(sqlite3.Error):
                if self._connection.in_transaction:
                    self._connection.execute("ROLLBACK")
            if isinstance(error, sqlite3.Error):
                raise StoreError(
                    f"{self.path} cannot be written: {rows.reason(error)}; the {self._count} "
                    "points in it are kept, and resume goes on from there"
                ) from None
            raise


def _prepare(connection: sqlite3.Connection, write: bool) -> None:
    """Take the store, alone where it is going to be written, and check the database."""
    if write:
        # In this mode the lock that the first transaction takes is held until the end.
        connection.execute("PRAGMA locking_mode = EXCLUSIVE")
        connection.execute("BEGIN EXCLUSIVE")
        connection.execute("COMMIT")
    (application,) = connection.execute("PRAGMA application_id").fetchone()
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    if application != APPLICATION:
        raise sqlite3.DatabaseError("it is a database, but not an experiment store")
    if version != VERSION:
        raise sqlite3.DatabaseError(
            f"it has format {version} and this version of minorloop reads {VERSION}"
        )
    (found,) = connection.execute("PRAGMA integrity_check(1)").fetchone()
    if found != "ok":
        raise sqlite3.DatabaseError(f"it is damaged ({found}); restore a copy of it")
    connection.execute("PRAGMA synchronous = FULL")


def _write_header(scratch: Path, plan: Plan, setup: Setup) -> None:
    texts = {"plan": plan.to_json(), "setup": setup.to_json(), "made": _now()}
    texts["digest"] = rows.digest(texts["plan"], texts["setup"])
    connection = sqlite3.connect(scratch, isolation_level=None)
    try:
        connection.execute(f"PRAGMA application_id = {APPLICATION}")
        connection.execute(f"PRAGMA user_version = {VERSION}")
        connection.execute("PRAGMA synchronous = FULL")
        connection.execute("BEGIN")
        for statement in rows.SCHEMA:
            connection.execute(statement)
        connection.executemany("INSERT INTO about VALUES (?, ?)", texts.items())
        connection.execute("COMMIT")
    finally:
        connection.close()


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
