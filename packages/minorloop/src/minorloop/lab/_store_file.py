"""The file of an experiment store: create, lock, open and check it."""

import hashlib
import os
import sqlite3
import stat
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from minorloop.errors import OutputError, StoreError
from minorloop.files import PathLike, check_writable, lock_path, write_atomically

_APPLICATION = 0x6D6C6F70
"""The application id in the header of the file: 'mlop'."""
VERSION = 2
LOCK_WAIT = 1.0
"""Seconds to wait for another process that is finishing."""
READ_WAIT = 30.0
"""Seconds that a writer waits, only before its first point, for other processes that read."""
MAGIC = b"SQLite format 3\0"
_IN_USE = "another process has it open; wait until that one has ended"
_TABLES = {
    "about": "name TEXT PRIMARY KEY, value TEXT NOT NULL",
    "sitting": "id INTEGER PRIMARY KEY, began TEXT NOT NULL, ended TEXT, first INTEGER NOT NULL, "
    "way TEXT NOT NULL, end TEXT",
    "point": "id INTEGER PRIMARY KEY, input REAL NOT NULL, value REAL, sd REAL, "
    "verdict TEXT NOT NULL, t REAL NOT NULL, held REAL NOT NULL, checkpoint TEXT, "
    "sample_interval REAL, time_uncertainty REAL",
    "trace": "id INTEGER PRIMARY KEY REFERENCES point (id), t BLOB NOT NULL, y BLOB NOT NULL",
}
"""Columns of the tables; the last one of each is a digest of the others."""


def is_store(path: PathLike) -> bool:
    """Whether a file begins like an SQLite database; false if it cannot be read.

    Do not use it on a store that this process has open: on most systems a process that closes a
    file loses all its locks on it.
    """
    with suppress(OSError, ValueError), open(path, "rb") as file:
        return file.read(len(MAGIC)) == MAGIC
    return False


@contextmanager
def explained(path: Path) -> Iterator[None]:
    """Raise errors of reading as one sentence."""
    try:
        yield
    except sqlite3.Error as error:
        raise StoreError(f"{path} cannot be used: {in_words(error)}") from None
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise StoreError(f"{path} is damaged: {error}; restore a copy of it") from None


def existing(path: PathLike) -> Path:
    file = Path(path)
    try:
        regular = stat.S_ISREG(file.stat().st_mode)
    except FileNotFoundError:
        raise StoreError(f"{file} does not exist; give the name of an experiment store") from None
    except (OSError, ValueError) as error:
        raise StoreError(f"{str(file)!r} cannot be opened: {error}") from None
    if not regular:
        raise StoreError(f"{file} is not a regular file; give the name of an experiment store")
    return file


def beside(file: Path) -> str:
    """Return the file that a writer to a store locks."""
    return f"{file}-lock"


def locked(file: Path) -> int:
    """Return the descriptor of the lock beside a store; raise an error if it is locked."""
    deadline = time.monotonic() + LOCK_WAIT
    while True:
        lock = lock_path(beside(file), os.O_RDWR | os.O_CREAT)
        if lock is not None:
            if os.fstat(lock).st_nlink:
                return lock
            os.close(lock)  # the previous process has just removed it
        elif time.monotonic() < deadline:
            time.sleep(0.02)  # seconds between two attempts to lock
        else:
            raise StoreError(f"{file} cannot be used: {_IN_USE}")


def unlock(file: Path, lock: int | None) -> None:
    """Remove the file of a lock, and then release the lock."""
    if lock is not None:
        with suppress(OSError):
            os.unlink(beside(file))
        os.close(lock)


def prepare(connection: sqlite3.Connection, write: bool) -> None:
    """Check the database, and make it durable if ``write``."""
    (application,) = connection.execute("PRAGMA application_id").fetchone()
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    if application != _APPLICATION:
        raise sqlite3.DatabaseError("it is a database, but not an experiment store")
    if version != VERSION:
        raise sqlite3.DatabaseError(
            f"it has format {version} and this minorloop reads {VERSION}; install one that reads it"
        )
    if not write:
        connection.execute("PRAGMA query_only = ON")
        return
    connection.execute("PRAGMA synchronous = FULL")
    (found,) = connection.execute("PRAGMA integrity_check(1)").fetchone()
    if found != "ok":
        raise sqlite3.DatabaseError(f"it is damaged ({found}); restore a copy of it")


def create_file(path: PathLike, about: Mapping[str, str]) -> Path:
    """Make a store with some rows of the table ``about``, completely or not at all.

    Raises an `OutputError` if the file exists already or cannot be written, or its name is too long
    for ``NAME-journal``, the longest name beside it.
    """
    target = check_writable(path)
    try:
        os.lstat(f"{target}-journal")
    except FileNotFoundError:
        pass
    except OSError as error:
        raise OutputError(
            f"{target} cannot be a store, because files beside it have the same name with up to 8 "
            f"more characters ({error.strerror}); give a shorter name"
        ) from None
    connection = sqlite3.connect(":memory:", isolation_level=None)
    try:
        connection.execute(f"PRAGMA application_id = {_APPLICATION}")
        connection.execute(f"PRAGMA user_version = {VERSION}")
        for name, columns in _TABLES.items():
            connection.execute(f"CREATE TABLE {name} ({columns}, digest TEXT NOT NULL)")
        rows = [(*text, digest(text)) for text in about.items()]
        connection.executemany("INSERT INTO about VALUES (?, ?, ?)", rows)
        write_atomically(target, connection.serialize(), new=True)
    finally:
        connection.close()
    return target


def in_words(error: sqlite3.Error) -> str:
    """Return an error of SQLite in words."""
    name = getattr(error, "sqlite_errorname", "")
    for begin, words in (
        ("SQLITE_FULL", "the disk is full; make room"),
        ("SQLITE_BUSY", _IN_USE),
        ("SQLITE_LOCKED", _IN_USE),
        ("SQLITE_READONLY", "it is protected against writing"),
        ("SQLITE_CORRUPT", "it is damaged; restore a copy of it"),
        ("SQLITE_NOTADB", "it is not an experiment store, or damaged; run makes a new one"),
        ("SQLITE_CANTOPEN", "it, or the journal beside it, cannot be opened"),
        ("SQLITE_IOERR", f"the disk cannot read or write it ({error})"),
    ):
        if name.startswith(begin):
            return words
    return str(error)


def digest(content: Iterable[object]) -> str:
    summary = hashlib.sha256()
    for item in content:
        data = item if isinstance(item, bytes) else repr(item).encode()
        summary.update(len(data).to_bytes(8, "little") + data)
    return summary.hexdigest()
