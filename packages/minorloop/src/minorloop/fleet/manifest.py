"""Manifest of a fleet: its specimens, and the file with the record of each."""

import csv
import errno
import hashlib
import io
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

from minorloop.errors import RecordError
from minorloop.files import PathLike, check_name, unquoted
from minorloop.fleet.summary import Outcome
from minorloop.lab.tables import MAX_BYTES

COLUMNS = ("specimen", "file", "input", "output")
OPTIONAL = ("time", "curves", "groups", "sd")
"""Further columns of a record that a manifest may name, as for `minorloop.read`."""
LARGEST = 16 * 2**20
"""Bytes of the largest manifest."""
_LONGEST_KEY = 120
"""Most bytes of the name of a file: file systems allow 255, with suffixes."""


@dataclass(frozen=True)
class Specimen:
    """One specimen of a fleet."""

    name: str
    """Unique name."""
    file: Path
    """CSV file of its record."""
    input: str
    output: str
    """``input`` and ``output``: columns of the record."""
    listed: str | None = None
    """The file as the manifest names it."""
    outside: bool = False
    """Whether the file lies outside the folder of the manifest. Messages then do not show its
    content, because the author of the manifest may not be allowed to read it."""
    time: str | None = None
    curves: str | None = None
    groups: str | None = None
    sd: str | None = None
    """``time``, ``curves``, ``groups`` and ``sd``: other columns of the record, as for
    `minorloop.read`; by default time and standard deviations are found; ``none`` omits them."""

    @property
    def columns(self) -> dict[str, Any]:
        """Named columns of the record; None for a time or deviation named ``none``."""
        named = {name: getattr(self, name) for name in ("input", "output", *OPTIONAL)}
        left_out = [name for name in ("time", "sd") if named[name] == "none"]
        known = {name: column for name, column in named.items() if column is not None}
        return known | dict.fromkeys(left_out)

    @property
    def origin(self) -> dict[str, Any]:
        """File and columns of the record, as in an `Outcome`."""
        return {"file": self.listed or str(self.file), **self.columns}

    def outcome(self, **figures: Any) -> Outcome:
        """Return a result of this specimen."""
        return Outcome(self.name, **self.origin, **figures)

    def shown_error(self, error: object) -> str:
        """Return why the record cannot be used, without content that must not be shown."""
        if not self.outside:
            return str(error)
        columns = ", ".join(repr(column) for column in self.columns.values() if column)
        return (
            f"{self.file} is not a record with the columns {columns}; it lies outside the folder "
            "of the manifest, so its content is not shown"
        )

    @property
    def key(self) -> str:
        """Part of a file name for the specimen; different names have different keys."""
        name = quote(self.name, safe="")
        if not self.name.strip("."):
            name = name.replace(".", "%2E")
        if len(name) <= _LONGEST_KEY:
            return name
        digest = hashlib.sha256(self.name.encode()).hexdigest()
        return f"{name[: _LONGEST_KEY // 2]}_{digest}"

    def read(self) -> bytes:
        """Return the bytes of its file.

        Raises an `OSError` or a `ValueError` if it cannot be read, is too large, or is not a
        regular file: a pipe may never end.
        """
        if self.file.exists() and not self.file.is_file():
            raise OSError(errno.EINVAL, "it is not a regular file")
        if self.file.exists() and self.file.stat().st_size > MAX_BYTES:
            raise ValueError(f"it has more than {MAX_BYTES} bytes; split it")
        return self.file.read_bytes()


def read_manifest(
    path: PathLike, *, input: str | None = None, output: str | None = None
) -> list[Specimen]:
    """Read the specimens that a CSV file lists.

    The columns are ``specimen`` and ``file``, optionally ``input``, ``output``, ``time``,
    ``curves``, ``groups`` and ``sd``, separated by commas, semicolons or tabs. Paths of files are
    relative to the manifest.

    Raises a `RecordError` if the manifest cannot be read, lacks a column, has no specimens, or
    names a specimen twice.

    ``path``: the manifest; ``input`` and ``output``: columns of the records, for specimens without
    these in their row.
    """
    text = _text_of(Path(path))
    delimiter = max(",;\t", key=text.partition("\n")[0].count)
    rows = csv.reader(io.StringIO(text), strict=True, delimiter=delimiter, skipinitialspace=True)
    found: dict[str, Specimen] = {}
    try:
        header = _header(path, next(rows, []))
        for line, row in enumerate(rows if header else (), 2):
            where, cells = f"line {line} of {path}", [unquoted(cell.strip()) for cell in row]
            if any(cells[len(header) :]):
                raise RecordError(f"{where} has more cells than the header")
            if not any(cells):
                continue
            one = _specimen(
                Path(path), where, dict(zip(header, cells, strict=False)), input, output
            )
            if one.name in found:
                raise RecordError(f"{where} names {one.name!r} again; give it once")
            found[one.name] = one
    except csv.Error as error:
        raise RecordError(f"{path} is not a CSV file: {error}") from None
    if not found:
        raise RecordError(
            f"{path} lists no specimens under the columns specimen and file; write a header "
            "line 'specimen,file,input,output' and a row for each"
        )
    return list(found.values())


def _text_of(path: Path) -> str:
    try:
        if path.stat().st_size > LARGEST:
            raise RecordError(f"{path} is larger than {LARGEST} bytes; a manifest is smaller")
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise RecordError(
            f"{path} does not exist; give a table with the columns specimen and file"
        ) from None
    except UnicodeDecodeError:
        raise RecordError(f"{path} cannot be read: it is not UTF-8 text") from None
    except OSError as error:
        raise RecordError(f"{path} cannot be read: {error}") from None


def _header(path: PathLike, row: Sequence[str]) -> list[str]:
    """Return the names of the columns; no names if a required column is missing."""
    header = [name.strip().lower() for name in row]
    for name in (*COLUMNS, *OPTIONAL):
        if header.count(name) > 1:
            raise RecordError(f"{path} has two columns {name}; name each column once")
    return header if {"specimen", "file"} <= set(header) else []


def _specimen(
    path: Path, where: str, cells: Mapping[str, str], input: str | None, output: str | None
) -> Specimen:
    shared = {"input": input, "output": output}
    named = {name: cells.get(name) or shared.get(name) for name in (*COLUMNS, *OPTIONAL)}
    for name, value in named.items():
        if value:
            check_name(f"{where}: the {name}", value, RecordError)
        elif name in COLUMNS:
            raise RecordError(f"{where} has no {name}; fill the column in")
    if named["input"] == named["output"]:
        raise RecordError(f"{where} has {named['input']!r} for input and output; give two columns")
    name, listed = str(named.pop("specimen")), str(named.pop("file"))
    file = path.parent / listed
    # `Path.resolve` would raise an error for a loop of links, which must fail only one specimen.
    outside = not Path(os.path.realpath(file)).is_relative_to(os.path.realpath(path.parent))
    columns: Any = {column: value or None for column, value in named.items()}
    return Specimen(name, file, **columns, listed=listed, outside=outside)
