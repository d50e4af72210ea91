"""What a fleet consists of: specimens, each with the file of its record."""

from __future__ import annotations

import csv
import errno
import hashlib
import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import quote

from minorloop.errors import RecordError
from minorloop.files import PathLike

__all__ = ["Specimen", "read_manifest"]

COLUMNS = ("specimen", "file", "input", "output")
_LONGEST_KEY = 120


@dataclass(frozen=True)
class Specimen:
    """One specimen of a fleet.

    Parameters
    ----------
    name : str
        What to call it; no two are called the same.
    file : Path
        CSV file of its record.
    input, output : str
        Columns of the record.
    listed : str, optional
        The file as the manifest names it.
    """

    name: str
    file: Path
    input: str
    output: str
    listed: str | None = None

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
        """Its file, to be read.

        Raises
        ------
        OSError, ValueError
            If it cannot be opened, or is no regular file: a pipe may never end.
        """
        if self.file.exists() and not self.file.is_file():
            raise OSError(errno.EINVAL, "it is no regular file")
        return self.file.open("rb")

    def read(self) -> bytes:
        """What its file holds.

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
    """Specimens that a CSV file lists.

    It has the columns ``specimen`` and ``file``, and may have ``input`` and ``output``, separated
    by commas, semicolons or tabs. Files are named relative to the manifest.

    Parameters
    ----------
    path : str or path
        The manifest.
    input, output : str, optional
        Columns of the records, for specimens whose row names none.

    Raises
    ------
    RecordError
        If the manifest cannot be read, lacks a column, lists nothing, or names a specimen twice.
    """
    try:
        text = Path(path).read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        raise RecordError(f"{path} cannot be read: {error}") from None
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


def _rows(path: PathLike, text: str) -> list[dict[str | None, Any]]:
    """Rows by their headers, which may be capitals."""
    header = text.partition("\n")[0]
    delimiter = max(",;\t", key=header.count)
    reader: Any = csv.DictReader(
        io.StringIO(text), strict=True, restval="", delimiter=delimiter, skipinitialspace=True
    )
    reader.fieldnames = [name.strip().lower() for name in reader.fieldnames or ()]
    for name in COLUMNS:
        if reader.fieldnames.count(name) > 1:
            raise RecordError(f"{path} has two columns {name}; name each column once")
    return list(reader)


def _cells(row: Mapping[str | None, Any]) -> list[str]:
    """Texts of a row, those beyond the header too."""
    beyond = row.get(None) or []
    return [str(cell).strip() for cell in [*(v for k, v in row.items() if k), *beyond]]


def _specimen(
    path: Path, line: int, row: Mapping[str | None, Any], input: str | None, output: str | None
) -> Specimen:
    cells = {name: str(row.get(name) or "").strip() for name in COLUMNS}
    columns = cells["input"] or input, cells["output"] or output
    for what, value in zip(COLUMNS, (cells["specimen"], cells["file"], *columns), strict=True):
        if not value:
            raise RecordError(f"line {line} of {path} has no {what}; fill the column in")
        if any(letter < " " or letter == "\x7f" for letter in value):
            raise RecordError(
                f"line {line} of {path} has the {what} {value[:60]!r}; leave out what cannot be "
                "printed"
            )
    if any(cell.strip() for cell in row.get(None) or ()):
        raise RecordError(f"line {line} of {path} has more cells than the header")
    if columns[0] == columns[1]:
        raise RecordError(
            f"line {line} of {path} has {columns[0]!r} for input and output; give two columns"
        )
    file = path.parent / cells["file"]
    return Specimen(cells["specimen"], file, str(columns[0]), str(columns[1]), cells["file"])
