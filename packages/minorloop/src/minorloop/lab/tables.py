"""A table: headers with units above columns of cells, from a text, a MATLAB file or a workbook.

Columns of cells become numbers or labels; errors name the column and the row. Each reader checks a
size by `Bounds` before it allocates memory of this size.
"""

import os
import re
import stat
import sys
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import chain, islice
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import RecordError, counted
from minorloop.lab.headers import find_column

MAX_BYTES = 4 * 1024**3
"""Largest file: 4 GiB."""
NUMBER = 8
"""Bytes of a number in a column."""
Cells: TypeAlias = list[str] | FloatArray
"""Cells of a column: texts, or numbers that are finite or NaN."""
Labels: TypeAlias = FloatArray | npt.NDArray[np.str_]
"""A column of labels: numbers, or texts."""
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_CLOCK = re.compile(r"(\d{1,3}):(\d{2}):(\d{2}(?:[.,]\d*)?)")
_DAY_FIRST = re.compile(r"(\d{1,2})\.(\d{1,2})\.(\d{4})[ T,]*(.*)")
"""A date as in most of Europe, with or without a time of day."""
DECIMAL_COMMA = re.compile(r"\s*[-+]?\d*,\d+([eE][-+]?\d+)?\s*")
_THOUSANDS = re.compile(
    r"[-+]?\d{1,3}((,\d{3})+\.\d*|(\.\d{3})+,\d*|([,.]\d{3}){2,}"
    r"|(['\u2019 \xa0\u202f]\d{3})+([.,]\d*)?)"
)
"""Numbers such as 1,234.5 and 1'234.5."""


class SparseColumnError(RecordError):
    """Many cells of a column are empty, as if the tables of two loggers were merged."""

    values: FloatArray
    """The column, (T,), NaN in empty cells."""


def is_number(text: str) -> bool:
    """Whether a cell is a number, with or without a decimal point."""
    try:
        float(text)
    except ValueError:
        return False
    return True


@dataclass(frozen=True, kw_only=True)
class Bounds:
    """The largest allowed table."""

    rows: int = sys.maxsize
    columns: int = 10_000
    """``rows`` and ``columns``: most rows and columns."""
    memory: int = 256 * 1024**2
    """Bytes that the cells of a table may take, for any size of its file."""
    share: int = 8
    """Bytes that the cells may take for each byte of the file, if this is more. A text never needs
    as many: its shortest number and separator are two bytes, which become ``NUMBER``."""
    expansion: int = 50
    """Most bytes for each byte of a compressed part of more than ``small`` bytes. Sheets have 4 to
    17, even if all cells are alike, because each cell has its own entry."""
    small: int = 8 * 1024**2
    """Bytes to which a part may expand from any size."""
    advice: str = ""
    """Alternative to the advice to give fewer rows or columns."""

    def check(self, file: Path, *, rows: int = 0, columns: int = 0, held: int = 0) -> None:
        """Refuse a larger table.

        Raises a `RecordError` if a size is beyond its bound.

        ``file``: file of the table; ``rows`` and ``columns``: numbers that are known so far;
        ``held``: bytes that its cells take, or will take.
        """
        if self is not LARGEST:  # no advice on other bounds if the largest do not allow the table
            LARGEST.check(file, rows=rows, columns=columns, held=held)
        if held > self.memory:
            size = file.stat().st_size
            most = max(self.memory, self.share * size)
            if held > most:
                raise RecordError(
                    f"{file} has a table that takes {_megabytes(held)} of memory or more; a file "
                    f"of {_megabytes(size)} may take {_megabytes(most)}: split it, or save it as "
                    "CSV"
                )
        for what, count, limit in (("columns", columns, self.columns), ("rows", rows, self.rows)):
            if count > limit:
                raise RecordError(
                    f"{file} has {count} {what} or more; give at most {limit}{self.advice}"
                )

    def check_expansion(self, file: Path, packed: int, size: int) -> None:
        """Refuse a part of ``packed`` bytes that expands to ``size`` bytes, more than any table.

        Raises a `RecordError` if it does.
        """
        if size > self.small and size > self.expansion * packed:
            raise RecordError(
                f"{file} expands from {_megabytes(packed)} to {_megabytes(size)}; a table expands "
                f"at most {self.expansion} times: save it as CSV"
            )


LARGEST = Bounds()
"""The largest table that a command reads."""


class Block(NamedTuple):
    """Some rows of a table."""

    cells: Callable[[int], Cells]
    """Returns the cells of a column, by its place among the headers."""
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
    """Rows below the headers."""
    decimal: str = "."
    """Decimal separator of its texts: a point or a comma."""
    notes: tuple[str, ...] = ()
    """Notes on unexpected content of the file, one sentence each."""
    above: int = 0
    """Lines above the headers of a text."""

    def find(self, name: str) -> str:
        """Return the header with a name, as `find_column`; errors also contain the notes."""
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

        Raises a `RecordError` if the file lacks a column, or has a cell that is not a finite number
        or an empty label. The message gives the column and the row; the header is row 1.

        Parameters
        ----------
        names, labels : sequence of str
            Columns of numbers, and of labels such as specimens: numbers if all labels are numbers,
            otherwise texts. By the whole header (``voltage [V]``) or the name (``voltage``).
        gaps : collection of str
            Columns of ``names`` in which an empty cell or ``nan`` is allowed and gives NaN.
        dates : collection of str
            Columns of ``names`` that may hold date and time, as ISO 8601 or ``01.03.2026
            12:00:00.5``, which give seconds since 1970, or times of day, as ``12:00:00.5``, since
            midnight.
        tried : collection of str
            Columns of ``names`` that may be unusable; their error then replaces them.

        Returns
        -------
        dict
            The columns by the given names: (T,) arrays, or errors in place of ``tried`` columns.

        """
        errors, rows = dict[str, RecordError](), list[Sequence[int]]()
        places = {name: self.headers.index(self.find(name)) for name in (*names, *labels)}
        where = {name: f"column '{self.headers[k]}' of {self.file}" for name, k in places.items()}
        parts: dict[str, list[Any]] = {name: [] for name in places}
        for block in self.blocks:
            rows.append(block.numbers)
            for name in [name for name in places if name not in errors]:
                column = _Column(where[name], self.decimal, name in gaps, name in dates)
                cells = block.cells(places[name])
                try:
                    part = cells if name in labels else column.numbers(cells, block.numbers)
                    parts[name].append(part)
                except RecordError as error:
                    if name not in tried:
                        raise
                    errors[name] = error
        if not any(map(len, rows)):
            raise RecordError(f"{self.file} has a header and no rows; there is nothing to read")
        found: dict[str, Any] = {}
        for name, some in parts.items():
            column = _Column(where[name], self.decimal, name in gaps)
            try:
                if name in labels:
                    found[name] = column.labels(some, rows, self.file)
                else:
                    found[name] = errors.get(name) or column.joined(some, rows)
            except RecordError as error:
                if name not in tried:
                    raise
                found[name] = error
        return found


@dataclass(frozen=True)
class _Column:
    """Conversion of the cells of a column."""

    where: str
    """The column, for messages."""
    decimal: str
    """Decimal separator of texts."""
    gaps: bool = False
    """Whether empty cells and ``nan`` are allowed, and give NaN."""
    dates: bool = False
    """Whether the cells may be dates or times of day."""

    def numbers(self, cells: Cells, rows: Sequence[int]) -> FloatArray:
        """Return the numbers in cells, NaN if empty; ``rows`` are row numbers in the file.

        Raises a `RecordError` if a cell is not a finite number.
        """
        if isinstance(cells, np.ndarray):
            values = cells
        elif self.dates and cells and not is_number(cells[0].replace(",", ".")):
            values = self._moments(cells, rows)
        else:
            values = self._parsed(cells, rows)
        bad = np.isinf(values) if self.gaps else ~np.isfinite(values)
        for index in np.flatnonzero(bad).tolist():
            if isinstance(cells, np.ndarray) or cells[index].strip():
                raise RecordError(
                    f"{self.where} has {_shown(str(cells[index]))} in row {rows[index]}; every "
                    "cell must be a finite number"
                )
        return values

    def joined(self, parts: Sequence[FloatArray], rows: Sequence[Sequence[int]]) -> FloatArray:
        """Return the column, (T,), from its `numbers` in parts of the rows.

        Raises a `RecordError` if a cell is empty that must not be, a `SparseColumnError` if many
        cells are.
        """
        values = np.concatenate(parts)
        empty = np.flatnonzero(np.isnan(values))
        if self.gaps or not empty.size:
            return values
        more = f" and in {counted(empty.size - 1, 'other row')}" if empty.size > 1 else ""
        first = f"{self.where} is empty in row {_at(rows, empty[0])}"
        said = f"{first}{more}; give a number in every row"
        # Share of empty cells from which the table contains several loggers
        if empty.size < 0.1 * values.size:
            raise RecordError(said)
        sparse = SparseColumnError(said)
        sparse.values = values
        raise sparse

    def labels(self, parts: Sequence[Cells], rows: Sequence[Sequence[int]], file: Path) -> Labels:
        """Return the column, (T,): numbers if all labels are numbers, otherwise texts.

        Raises a `RecordError` if a label is empty, or the texts are beyond the bounds of the file.
        """
        with suppress(RecordError):
            return self.joined(list(map(self.numbers, parts, rows)), rows)
        texts = [
            list(map(repr, cells.tolist())) if isinstance(cells, np.ndarray) else cells
            for cells in parts
        ]
        longest = max(max(map(len, cells), default=0) for cells in texts)
        LARGEST.check(file, held=np.dtype(f"U{longest}").itemsize * sum(map(len, texts)))
        labels = np.array([cell.strip() for cells in texts for cell in cells])
        empty = np.isin(labels, ("", "nan", "NaN"))
        if empty.any():
            row = _at(rows, int(np.argmax(empty)))
            raise RecordError(f"{self.where} is empty in row {row}; give every row a label")
        return labels

    def _parsed(self, cells: list[str], rows: Sequence[int]) -> FloatArray:
        if self.decimal == ",":
            cells = [cell.replace(",", ".") if cell.count(",") == 1 else cell for cell in cells]
        try:
            values = np.fromiter(map(float, cells), np.float64, len(cells))
        except ValueError:
            values = np.empty(len(cells))
            for index, cell in enumerate(cells):
                if cell.strip() and not is_number(cell):
                    raise self._not_a_number(rows[index], cell) from None
                values[index] = float(cell) if cell.strip() else np.nan
        # float() reads 1_000 and digits of other scripts as numbers; in the file of a logger they
        # have another meaning.
        for index, cell in enumerate(cells):
            if "_" in cell or not (cell.isascii() or cell.strip().isascii()):
                raise self._not_a_number(rows[index], cell)
        return values

    def _moments(self, cells: list[str], rows: Sequence[int]) -> FloatArray:
        values = np.empty(len(cells))
        for index, cell in enumerate(cells):
            try:
                values[index] = _seconds(cell)
            except ValueError:
                raise RecordError(
                    f"{self.where} has the text {_shown(cell)} in row {rows[index]}; "
                    "give time as numbers, or as 2026-03-01T12:00:00.5, 01.03.2026 12:00:00.5 or "
                    "12:00:00.5"
                ) from None
        return values

    def _not_a_number(self, row: int, cell: str) -> RecordError:
        text = cell.strip()
        advice = "every cell must be a number"
        if _THOUSANDS.fullmatch(text):
            advice = "write numbers without separators of thousands"
        elif DECIMAL_COMMA.fullmatch(text):
            advice = "write decimals with a point"
        return RecordError(f"{self.where} has the text {_shown(text)} in row {row}; {advice}")


def _at(rows: Sequence[Sequence[int]], index: int) -> int:
    """Return the number in the file of a row, counted over all parts."""
    return next(islice(chain.from_iterable(rows), index, None))


def _seconds(text: str) -> float:
    """Return seconds since 1970 of a date and time, or since midnight of a time of day.

    They are as ISO 8601, ``01.03.2026 12:00:00.5`` or ``12:00:00.5``; without a zone they are UTC.
    Raises a `ValueError` if the text is none of these.
    """
    cell = text.strip()
    if clock := _CLOCK.fullmatch(cell):
        hours, minutes, seconds = (float(part.replace(",", ".")) for part in clock.groups())
        if minutes >= 60 or seconds >= 61:  # a leap second
            raise ValueError
        return 3600 * hours + 60 * minutes + seconds
    if moment := _DAY_FIRST.fullmatch(cell):
        day, month, year, rest = moment.groups()
        date = datetime(int(year), int(month), int(day), tzinfo=UTC)
        return (date - _EPOCH).total_seconds() + (_seconds(rest) if rest else 0.0)
    found = datetime.fromisoformat(cell)
    return (found if found.tzinfo else found.replace(tzinfo=UTC)).timestamp()


def _shown(cell: str) -> str:
    """Return the begin of a cell for a message."""
    text = cell.strip()
    return repr(text if len(text) <= 40 else text[:37] + "...")


def check_file(file: Path) -> None:
    """Refuse a file that must not be opened.

    Raises a `RecordError` if the file does not exist, is not regular, is too long, or not readable.
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


def _megabytes(size: int) -> str:
    return f"{size / 1e6:.3g} MB" if size < 1e9 else f"{size / 1e6:.0f} MB"
