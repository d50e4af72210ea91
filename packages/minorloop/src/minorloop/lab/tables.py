"""A table: headers with units above columns of cells, from a text, a MATLAB file or a workbook."""

import os
import stat
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from minorloop.errors import RecordError
from minorloop.lab.cells import Cells, LabelCells, NumberCells
from minorloop.lab.headers import find_column

__all__ = ["Block", "OpenTable", "check_file"]

MAX_BYTES = 4 * 1024**3
"""Largest file that is read: 4 GiB."""


class Block(NamedTuple):
    """Some rows of a table."""

    cells: Callable[[int], Cells]
    """Gives the cells of a column, by its place among the headers."""
    numbers: Sequence[int]
    """Numbers of the rows in the file."""


@dataclass
class OpenTable:
    """An open table, whose rows can be read once."""

    file: Path
    """The file."""
    headers: list[str]
    """Headers, with units."""
    blocks: Iterator[Block]
    """Its rows below the headers."""
    decimal: str = "."
    """Decimal separator of its texts: a point or a comma."""
    notes: tuple[str, ...] = ()
    """What was found in the file and may surprise, one sentence each."""

    def find(self, name: str) -> str:
        """Return the one header with a name, as `find_column`; errors have the notes too."""
        try:
            return find_column(name, self.headers, source=self.file)
        except RecordError as error:
            raise RecordError("; ".join([str(error), *self.notes])) from None

    def read(
        self,
        names: Sequence[str],
        labels: Sequence[str] = (),
        *,
        gaps: Collection[str] = (),
        dates: Collection[str] = (),
        tried: Collection[str] = (),
    ) -> dict[str, Any]:
        """Read columns in one pass, once.

        Parameters
        ----------
        names, labels : sequence of str
            Columns of numbers, and of labels such as specimens: numbers if all are, otherwise
            texts. All by the whole header (``voltage [V]``) or the name (``voltage``).
        gaps : collection of str
            Those of ``names`` in which an empty cell or ``nan`` is allowed and gives NaN.
        dates : collection of str
            Those of ``names`` that may hold date and time, as ISO 8601 or ``01.03.2026
            12:00:00.5``, which give seconds since 1970, or times of day, as ``12:00:00.5``, since
            midnight.
        tried : collection of str
            Those of ``names`` that may be unusable; in their place is the error.

        Returns
        -------
        dict
            The columns by the given names: (T,) arrays, or errors in place of those tried.

        Raises
        ------
        RecordError
            If the file lacks a column, or has a cell that is not a finite number or an empty label.
            The message gives the column and the row; the header is row 1.
        """
        errors, rows = dict[str, RecordError](), 0
        places = {name: self.headers.index(self.find(name)) for name in (*names, *labels)}
        where = {name: f"column '{self.headers[k]}' of {self.file}" for name, k in places.items()}
        readers: dict[str, NumberCells | LabelCells] = {
            name: NumberCells(where[name], self.decimal, name in gaps, name in dates)
            for name in names
        }
        readers |= {name: LabelCells(where[name], self.decimal, self.file) for name in labels}
        for block in self.blocks:
            rows += len(block.numbers)
            for name, reader in readers.items():
                if name not in errors:
                    try:
                        reader.add(block.cells(places[name]), block.numbers)
                    except RecordError as error:
                        if name not in tried:
                            raise
                        errors[name] = error
        if not rows:
            raise RecordError(f"{self.file} has a header and no rows; there is nothing to read")
        found: dict[str, Any] = {}
        for name, reader in readers.items():
            try:
                found[name] = errors.get(name) or reader.joined()
            except RecordError as error:
                if name not in tried:
                    raise
                found[name] = error
        return found


def check_file(file: Path) -> None:
    """Refuse a file that must not be opened.

    Raises a `RecordError` if there is none, it is no regular file, too long, or not to be read.
    """
    try:
        status = file.stat()
    except FileNotFoundError:
        raise RecordError(f"{file} does not exist") from None
    except (OSError, ValueError) as error:
        raise RecordError(f"{file} cannot be read: {error}") from None
    if not stat.S_ISREG(status.st_mode):
        kind = "a folder" if stat.S_ISDIR(status.st_mode) else "not a regular file"
        raise RecordError(f"{file} is {kind}; give the name of a CSV file")
    if status.st_size > MAX_BYTES:
        raise RecordError(
            f"{file} has {status.st_size} bytes, more than the {MAX_BYTES} that are read; split it"
        )
    if not os.access(file, os.R_OK):
        raise RecordError(f"{file} cannot be read: permission denied")
