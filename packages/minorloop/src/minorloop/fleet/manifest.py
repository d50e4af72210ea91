"""Manifest of a fleet: its specimens, and the file with the record of each."""

import csv
import errno
import hashlib
import io
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import quote

from minorloop.errors import RecordError
from minorloop.files import PathLike, check_name, unquoted
from minorloop.lab.text_tables import MAX_BYTES

__all__ = ["Specimen", "read_manifest"]

COLUMNS = ("specimen", "file", "input", "output")
OPTIONAL = ("time", "curves", "groups", "sd")
"""Columns of a record, as `minorloop.read` takes them, that a manifest may name too."""
LARGEST = 64 * 2**20
"""Bytes of the largest manifest."""
_MOST_COLUMNS, _MOST_LINES = 1000, 1_000_000
"""Largest table of a manifest, far beyond real fleets."""
_LONGEST_KEY = 120
"""Bytes of the name of a file: file systems allow 255, with suffixes."""


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
    """``time``, ``curves``, ``groups`` and ``sd``: other columns of it, as for `minorloop.read`;
    time and standard deviations are found if they are not given, and left out if they are ``none``.
    """

    @property
    def columns(self) -> dict[str, Any]:
        """Columns of the record that are named; None for a time or deviation named ``none``."""
        named = {name: getattr(self, name) for name in ("input", "output", *OPTIONAL)}
        left_out = [name for name in ("time", "sd") if named[name] == "none"]
        known = {name: column for name, column in named.items() if column is not None}
        return known | dict.fromkeys(left_out)

    def shown_error(self, error: object) -> str:
        """Return why its record cannot be used, without content that must not be shown."""
        if not self.outside:
            return str(error)
        columns = ", ".join(repr(column) for column in self.columns.values() if column)
        return (
            f"{self.file} is not a record with the columns {columns}; it lies outside the folder "
            "of the manifest, so that its content is not shown"
        )

    @property
    def key(self) -> str:
        """The name as part of a file name; different names have different keys."""
        name = quote(self.name, safe="")
        if not self.name.strip("."):
            name = name.replace(".", "%2E")
        if len(name) <= _LONGEST_KEY:
            return name
        digest = hashlib.sha256(self.name.encode()).hexdigest()
        return f"{name[: _LONGEST_KEY // 2]}_{digest}"

    def open(self) -> BinaryIO:
        """Open its file for reading.

        Raises
        ------
        OSError, ValueError
            If it cannot be opened, is too large, or is not a regular file: a pipe may never end.
        """
        if self.file.exists() and not self.file.is_file():
            raise OSError(errno.EINVAL, "it is not a regular file")
        if self.file.exists() and self.file.stat().st_size > MAX_BYTES:
            raise ValueError(f"it has more than {MAX_BYTES} bytes; split it")
        return self.file.open("rb")

    def read(self) -> bytes:
        """Return the bytes of its file.

        Raises
        ------
        OSError, ValueError
            If it cannot be read.
        """
        with self.open() as file:
            return file.read()


def read_manifest(
    path: PathLike, *, input: str | None = None, output: str | None = None
) -> list[Specimen]:
    """Read the specimens that a CSV file lists.

    The columns are ``specimen`` and ``file``, optionally ``input``, ``output``, ``time``,
    ``curves``, ``groups`` and ``sd``, separated by commas, semicolons or tabs. Paths of files are
    relative to the manifest.

    Raises a `RecordError` if the manifest cannot be read, lacks a column, lists nothing, or names a
    specimen twice.

    Parameters
    ----------
    path : str or path
        The manifest.
    input, output : str, optional
        Columns of the records, for specimens whose row names none.
    """
    text = _text_of(Path(path))
    try:
        rows = _rows(path, text)
    except csv.Error as error:
        raise RecordError(f"{path} is not a CSV file: {error}") from None
    missing = {"specimen", "file"} - set(rows[0] if rows else ())
    if missing:
        raise RecordError(
            f"{path} lists no specimens under the columns specimen and file; write a header "
            "line 'specimen,file,input,output' and a row for each"
        )
    found: dict[str, Specimen] = {}
    for line, row in enumerate(rows, 2):
        if not any(_cells(row)):
            continue
        one = _specimen(Path(path), line, row, input, output)
        if one.name in found:
            raise RecordError(f"line {line} of {path} names {one.name!r} again; give it once")
        found[one.name] = one
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
    except (UnicodeDecodeError, OSError, ValueError) as error:
        if isinstance(error, RecordError):
            raise
        why = "it is not UTF-8 text" if isinstance(error, UnicodeDecodeError) else error
        raise RecordError(f"{path} cannot be read: {why}") from None


def _rows(path: PathLike, text: str) -> list[dict[str | None, Any]]:
    """Rows as mappings from lower-case headers."""
    lines = text.split("\n")
    delimiter = max(",;\t", key=lines[0].count)
    if len(lines) > _MOST_LINES:
        raise RecordError(f"{path} has {len(lines)} lines; give at most {_MOST_LINES}")
    widest = max(lines, key=lambda line: line.count(delimiter))
    if widest.count(delimiter) >= _MOST_COLUMNS:
        raise RecordError(
            f"{path} has a line of {widest.count(delimiter) + 1} cells; give at most "
            f"{_MOST_COLUMNS}"
        )
    reader: Any = csv.DictReader(
        io.StringIO(text), strict=True, restval="", delimiter=delimiter, skipinitialspace=True
    )
    reader.fieldnames = [name.strip().lower() for name in reader.fieldnames or ()]
    for name in (*COLUMNS, *OPTIONAL):
        if reader.fieldnames.count(name) > 1:
            raise RecordError(f"{path} has two columns {name}; name each column once")
    return list(reader)


def _cells(row: Mapping[str | None, Any]) -> list[str]:
    """Texts of a row, including those beyond the header."""
    beyond = row.get(None) or []
    return [str(cell).strip() for cell in [*(v for k, v in row.items() if k), *beyond]]


def _specimen(
    path: Path, line: int, row: Mapping[str | None, Any], input: str | None, output: str | None
) -> Specimen:
    names = (*COLUMNS, *OPTIONAL)
    cells = {name: unquoted(str(row.get(name) or "").strip()) for name in names}
    columns = cells["input"] or input, cells["output"] or output
    for what, value in zip(COLUMNS, (cells["specimen"], cells["file"], *columns), strict=True):
        if not value:
            raise RecordError(f"line {line} of {path} has no {what}; fill the column in")
        check_name(f"line {line} of {path}: the {what}", value, RecordError)
    if any(cell.strip() for cell in row.get(None) or ()):
        raise RecordError(f"line {line} of {path} has more cells than the header")
    if columns[0] == columns[1]:
        raise RecordError(
            f"line {line} of {path} has {columns[0]!r} for input and output; give two columns"
        )
    file = path.parent / cells["file"]
    # `Path.resolve` raises an error for a loop of links, which is the failure of one specimen.
    outside = not Path(os.path.realpath(file)).is_relative_to(os.path.realpath(path.parent))
    others = {
        name: check_name(f"line {line} of {path}: the {name}", cells[name], RecordError)
        for name in OPTIONAL
        if cells[name]
    }
    return Specimen(
        cells["specimen"],
        file,
        str(columns[0]),
        str(columns[1]),
        cells["file"],
        outside,
        **others,
    )
