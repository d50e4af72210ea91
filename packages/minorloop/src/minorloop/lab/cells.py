"""Convert the cells of a column to numbers or labels; errors name the column and the row."""

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import RecordError, counted
from minorloop.lab.bounds import LARGEST

__all__ = ["Cells", "LabelCells", "Labels", "NumberCells", "SparseColumnError", "is_number"]

Cells: TypeAlias = list[str] | FloatArray
"""Cells of a column: texts, or numbers that are finite or NaN."""
Labels: TypeAlias = FloatArray | npt.NDArray[np.str_]
"""A column of labels: numbers, or texts."""
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_CLOCK = re.compile(r"(\d{1,3}):(\d{2}):(\d{2}(?:[.,]\d*)?)")
_DAY_FIRST = re.compile(r"(\d{1,2})\.(\d{1,2})\.(\d{4})[ T,]*(.*)")
"""Time of day, and a date as it is written in most of Europe, with or without one."""
_MERGED = 0.1
"""Share of empty cells from which a column is one of several loggers in one table."""
DECIMAL_COMMA = re.compile(r"\s*[-+]?\d*,\d+([eE][-+]?\d+)?\s*")
_THOUSANDS = re.compile(
    r"[-+]?\d{1,3}((,\d{3})+\.\d*|(\.\d{3})+,\d*|([,.]\d{3}){2,}"
    r"|(['\u2019 \xa0\u202f]\d{3})+([.,]\d*)?)"
)
"""Numbers such as 1,234.5 and 1'234.5."""


class SparseColumnError(RecordError):
    """Many cells of a column are empty, as where the tables of two loggers were merged."""

    values: FloatArray
    """The column, (T,), NaN where it is empty."""


def is_number(text: str) -> bool:
    """Whether a cell is a number with a point, or none."""
    try:
        float(text)
    except ValueError:
        return False
    return True


class NumberCells:
    """Collects a column of numbers.

    Parameters
    ----------
    where : str
        The column, for messages.
    decimal : str
        Decimal separator of texts.
    gaps : bool
        Whether empty cells and ``nan`` are allowed, and give NaN.
    dates : bool
        Whether the cells may be dates or times of day.
    """

    def __init__(self, where: str, decimal: str, gaps: bool = False, dates: bool = False) -> None:
        self._where, self._decimal, self._gaps, self._dates = where, decimal, gaps, dates
        self._parts: list[FloatArray] = []
        self._empty: list[int] = []

    def add(self, cells: Cells, numbers: Sequence[int]) -> None:
        """Add cells of rows with these numbers in the file.

        Raises a `RecordError` if one is no finite number.
        """
        if isinstance(cells, np.ndarray):
            values = cells
        elif self._dates and cells and not is_number(cells[0].replace(",", ".")):
            values = self._moments(cells, numbers)
        else:
            values = self._numbers(cells, numbers)
        bad = np.isinf(values) if self._gaps else ~np.isfinite(values)
        for index in np.flatnonzero(bad).tolist():
            if not isinstance(cells, np.ndarray) and not cells[index].strip():
                self._empty.append(numbers[index])
                continue
            raise RecordError(
                f"{self._where} has {_shown(str(cells[index]))} in row {numbers[index]}; every "
                "cell must be a finite number"
            )
        self._parts.append(values)

    def joined(self) -> FloatArray:
        """Return the column, (T,).

        Raises a `RecordError` if a cell is empty that must not be, a `SparseColumnError` if many
        are.
        """
        values = np.concatenate(self._parts or [np.empty(0)])
        if not self._empty:
            return values
        more = len(self._empty) - 1
        others = f" and in {counted(more, 'other row')}" if more else ""
        said = f"{self._where} is empty in row {self._empty[0]}{others}; give a number in every row"
        if more + 1 < _MERGED * values.size:
            raise RecordError(said)
        sparse = SparseColumnError(said)
        sparse.values = values
        raise sparse

    def _numbers(self, cells: list[str], numbers: Sequence[int]) -> FloatArray:
        if self._decimal == ",":
            cells = [cell.replace(",", ".") if cell.count(",") == 1 else cell for cell in cells]
        try:
            values = np.fromiter(map(float, cells), np.float64, len(cells))
        except ValueError:
            values = np.empty(len(cells))
            for index, cell in enumerate(cells):
                if cell.strip() and not is_number(cell):
                    raise self._not_a_number(numbers[index], cell) from None
                values[index] = float(cell) if cell.strip() else np.nan
        # float() reads 1_000 and digits of other scripts as numbers; a logger that writes them
        # means something else.
        for index, cell in enumerate(cells):
            if "_" in cell or not (cell.isascii() or cell.strip().isascii()):
                raise self._not_a_number(numbers[index], cell)
        return values

    def _moments(self, cells: list[str], numbers: Sequence[int]) -> FloatArray:
        values = np.empty(len(cells))
        for index, cell in enumerate(cells):
            try:
                values[index] = _seconds(cell)
            except ValueError:
                raise RecordError(
                    f"{self._where} has the text {_shown(cell)} in row {numbers[index]}; "
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
        return RecordError(f"{self._where} has the text {_shown(text)} in row {row}; {advice}")


class LabelCells:
    """Collects a column of labels: numbers if all are, otherwise texts.

    Parameters
    ----------
    where, decimal
        As of `NumberCells`.
    file : Path
        The file, whose bounds a column of texts must keep.
    """

    def __init__(self, where: str, decimal: str, file: Path) -> None:
        self._where, self._decimal, self._file = where, decimal, file
        self._parts: list[tuple[Cells, Sequence[int]]] = []

    def add(self, cells: Cells, numbers: Sequence[int]) -> None:
        """Add cells of rows with these numbers in the file."""
        self._parts.append((cells, numbers))

    def joined(self) -> Labels:
        """Return the column, (T,).

        Raises a `RecordError` if a label is empty, or the texts are beyond the bounds of the file.
        """
        found = NumberCells(self._where, self._decimal)
        try:
            for part in self._parts:
                found.add(*part)
            return found.joined()
        except RecordError:
            pass
        texts = [
            list(map(repr, cells.tolist())) if isinstance(cells, np.ndarray) else cells
            for cells, _ in self._parts
        ]
        longest = max(max(map(len, cells), default=0) for cells in texts)
        LARGEST.check(self._file, held=np.dtype(f"U{longest}").itemsize * sum(map(len, texts)))
        labels = np.array([cell.strip() for cells in texts for cell in cells])
        empty = np.isin(labels, ("", "nan", "NaN"))
        if empty.any():
            rows = [number for _, numbers in self._parts for number in numbers]
            row = rows[int(np.argmax(empty))]
            raise RecordError(f"{self._where} is empty in row {row}; give every row a label")
        return labels


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
