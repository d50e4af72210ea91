"""Read columns of numbers from a file; errors name the column and the row."""

import difflib
import re
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import RecordError, counted
from minorloop.files import PathLike, check_name
from minorloop.lab.bounds import LARGEST, Bounds
from minorloop.lab.sheets import Sheet, is_sheet, read_sheet
from minorloop.lab.text_tables import UNITS, Rows, TextTable, is_number, opened


class SparseColumnError(RecordError):
    """Many cells of a column are empty, as where the tables of two loggers were merged."""


Labels: TypeAlias = FloatArray | npt.NDArray[np.str_]
"""A column of labels: numbers, or texts."""
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_EPOCH_WITHOUT_ZONE = _EPOCH.replace(tzinfo=None)
_CLOCK = re.compile(r"(\d{1,3}):(\d{2}):(\d{2}(?:[.,]\d*)?)")
_DAY_FIRST = re.compile(r"(\d{1,2})\.(\d{1,2})\.(\d{4})[ T,]*(.*)")
"""Time of day, and a date as it is written in most of Europe, with or without one."""
_MERGED = 0.1
"""Share of empty cells from which a column is one of several loggers in one table."""
_FILL = "give a number in every row"
_THOUSANDS = re.compile(
    r"[-+]?\d{1,3}((,\d{3})+\.\d*|(\.\d{3})+,\d*|([,.]\d{3}){2,}"
    r"|(['\u2019 \xa0\u202f]\d{3})+([.,]\d*)?)"
)
"""Numbers such as 1,234.5 and 1'234.5."""


def read_columns(
    path: PathLike,
    names: Sequence[str],
    *,
    gaps: Collection[str] = (),
    dates: Collection[str] = (),
    progress: Callable[[str], None] | None = None,
) -> dict[str, FloatArray]:
    """Read columns of numbers from a file.

    A text file is UTF-8, UTF-16 or else Windows-1252, with one header line, before it comments
    after ``#``, ``%`` or ``//``, and after it possibly a row of units. Commas, semicolons or tabs
    separate the columns; decimals have a point, or a comma where no comma separates. A ``.mat``
    file has a vector for each column or a matrix, an ``.xlsx`` file its table on the first sheet.
    Other columns may hold anything.

    Parameters
    ----------
    path : str or path
        The file, 4 GiB at most.
    names : sequence of str
        Columns to read, by the whole header (``voltage [V]``) or the name (``voltage``).
    gaps : collection of str
        Those of ``names`` in which an empty cell or ``nan`` is allowed and gives NaN.
    dates : collection of str
        Those of ``names`` that may hold date and time, as ISO 8601 or ``01.03.2026 12:00:00.5``,
        which give seconds since 1970, or times of day, as ``12:00:00.5``, since midnight.
    progress : callable, optional
        Called with the share that has been read, as text.

    Returns
    -------
    dict of str to (rows,) array
        The columns by the given names.

    Raises
    ------
    RecordError
        If the file cannot be read, is not such a table, lacks a column, or has a cell that is not a
        finite number. The message gives the column and the row; the header is row 1.
    """
    return read_table(path, names, gaps=gaps, dates=dates, progress=progress)[0]


def read_table(
    path: PathLike,
    names: Sequence[str],
    labels: Sequence[str] = (),
    *,
    gaps: Collection[str] = (),
    dates: Collection[str] = (),
    progress: Callable[[str], None] | None = None,
) -> tuple[dict[str, FloatArray], dict[str, Labels]]:
    """Read columns of numbers, and columns of labels such as specimens, in one pass.

    Raises a `RecordError` as for `read_columns`, or if a label is empty.

    Parameters
    ----------
    path, names, gaps, dates, progress
        As for `read_columns`.
    labels : sequence of str
        Columns of labels: numbers if all are, otherwise texts.

    Returns
    -------
    dict of str to (rows,) array, dict of str to (rows,) array
        The columns of numbers and those of labels, by the given names.
    """
    if is_sheet(path):
        sheet = read_sheet(path)
        return _of_sheet(sheet, names, gaps, dates), {
            name: _labels_of_sheet(sheet, name) for name in labels
        }
    with opened(path, progress) as table:
        where = {
            name: table.headers.index(find_column(name, table.headers, source=table.file))
            for name in (*names, *labels)
        }
        pieces: dict[str, list[FloatArray]] = {name: [] for name in names}
        texts = {name: _Labels(name, table.file, table.decimal) for name in labels}
        rows = 0
        for block in table.blocks():
            rows += len(block if isinstance(block, np.ndarray) else block[0])
            for name, parts in pieces.items():
                parts.append(_column(table, block, where[name], name in gaps, name in dates))
            for name, found in texts.items():
                found.add(block, where[name])
    if not rows:
        raise RecordError(f"{table.file} has a header and no rows; there is nothing to read")
    columns = {name: np.concatenate(parts or [np.empty(0)]) for name, parts in pieces.items()}
    return columns, {name: found.joined() for name, found in texts.items()}


def row_number(path: PathLike, index: int) -> int:
    """Return the number in the file of a row of data, as in the messages of `read_columns`.

    Parameters
    ----------
    path : str or path
        The file.
    index : int
        Row of data, counted from 0; its values are elements ``index`` of the columns.
    """
    if is_sheet(path):
        return read_sheet(path).numbers[index]
    with opened(path) as table:
        return table.number(index)


def read_each(
    path: PathLike, bounds: Bounds = LARGEST
) -> list[tuple[str, FloatArray | RecordError]]:
    """Return headers and columns of a file, gaps allowed; in place of unusable ones, the error.

    Raises a `RecordError` if the file cannot be read, is not such a table, has no rows, or is
    larger than the bounds.

    Parameters
    ----------
    path : str or path
        The file.
    bounds : Bounds, optional
        Of the table.
    """
    if is_sheet(path):
        sheet = read_sheet(path, bounds)
        found: list[tuple[str, FloatArray | RecordError]] = []
        for header in sheet.headers:
            try:
                found.append((header, _of_sheet(sheet, [header], [header], ())[header]))
            except RecordError as error:
                found.append((header, error))
        return found
    with opened(path, bounds=bounds) as table:
        pieces: list[list[FloatArray]] = [[] for _ in table.headers]
        troubles: dict[int, RecordError] = {}
        empty = True
        for block in table.blocks():
            empty = False
            for index in range(len(table.headers)):
                if index in troubles:
                    continue
                try:
                    pieces[index].append(_column(table, block, index, True, False))
                except RecordError as error:
                    troubles[index] = error
    if empty:
        raise RecordError(f"{table.file} has a header and no rows; there is nothing to read")
    return [
        (header, troubles.get(index) or np.concatenate(pieces[index] or [np.empty(0)]))
        for index, header in enumerate(table.headers)
    ]


def read_labels(path: PathLike, name: str) -> Labels:
    """Return a column of labels, such as specimens: numbers if all are, otherwise texts.

    Raises a `RecordError` as for ``read_columns``, or if a label is empty.
    """
    return read_table(path, (), [name])[1][name]


def read_headers(path: PathLike) -> list[str]:
    """Return the column headers of a file, with their units.

    Raises a `RecordError` if the file cannot be read or does not begin with a line of headers.
    """
    if is_sheet(path):
        return list(read_sheet(path).headers)
    with opened(path) as table:
        return table.headers


def split_header(header: str) -> tuple[str, str]:
    """Return name and unit of a header such as ``voltage [V]``; an absent unit is empty.

    Round brackets count where they hold a well-known unit.
    """
    match = re.fullmatch(r"\s*(.*?)\s*\[([^\[\]]*)\]\s*", header)
    if match and match[1]:
        return match[1], match[2].strip()
    match = re.fullmatch(r"\s*(.*?)\s*\(([^()]*)\)\s*", header)
    if match and match[1] and match[2].strip() in UNITS:
        return match[1], match[2].strip()
    return header.strip(), ""


def find_column(name: str, headers: Sequence[str], *, source: object) -> str:
    """Return the one header with a name: the whole header, or its part before the unit.

    A name may have a unit, as ``distance [mm]``, where the header has none.

    Raises a `RecordError` if none or several match.
    """
    check_name("the column", name, RecordError)
    if name in headers:
        return name
    matches = [header for header in headers if name.strip() in (header, split_header(header)[0])]
    if not matches:  # the unit is given with the name, and the header has none
        matches = [header for header in headers if header == split_header(name)[0]]
    if len(matches) == 1:
        return matches[0]
    if matches:
        raise RecordError(f"column '{name}' of {source} could be any of {_listed(matches)}")
    bare = {split_header(header)[0]: header for header in headers}
    known = {text.casefold(): header for text, header in bare.items()} | {
        header.casefold(): header for header in headers
    }
    close = difflib.get_close_matches(name.casefold(), list(known), n=1)
    hint = f"; did you mean '{known[close[0]]}'?" if close else "; name one of these"
    raise RecordError(f"{source} has no column '{name}', it has {_listed(headers)}{hint}")


def deviation_column(headers: Sequence[str], output: str) -> str | None:
    """Return the column ``sd`` in the unit of an output, as `reduce` writes it; None without one.

    Parameters
    ----------
    headers : sequence of str
        Headers of the columns.
    output : str
        Name and unit of the output, such as ``curvature [1/m]``.
    """
    wanted = ("sd", split_header(output)[1])
    return next((header for header in headers if split_header(header) == wanted), None)


def with_unit(name: str, header: str) -> str:
    """Return a header with its unit; if it has none, with that of the name it was found by."""
    return name.strip() if header == split_header(name)[0] else header


def _listed(headers: Sequence[str], *, most: int = 12) -> str:
    shown = (header if len(header) <= 60 else header[:57] + "..." for header in headers[:most])
    text = ", ".join(f"'{header}'" for header in shown)
    return text + (f" and {len(headers) - most} more" if len(headers) > most else "")


def _column(
    table: TextTable, block: FloatArray | Rows, index: int, gaps: bool, dates: bool
) -> FloatArray:
    """Return the numbers of one column of a block."""
    if isinstance(block, np.ndarray):
        return np.ascontiguousarray(block[:, index])
    rows, numbers = block
    where = f"column '{table.headers[index]}' of {table.file}"
    return _Cells(where, numbers, gaps, dates, table.decimal).parse([row[index] for row in rows])


def _of_sheet(
    sheet: Sheet, names: Sequence[str], gaps: Collection[str], dates: Collection[str]
) -> dict[str, FloatArray]:
    columns = {}
    for name in names:
        header = find_column(name, sheet.headers, source=sheet.file)
        cells = sheet.cells(header)
        where = f"column '{header}' of {sheet.file}"
        column = _Cells(where, sheet.numbers, name in gaps, name in dates)
        if isinstance(cells, np.ndarray):
            columns[name] = column.checked(cells, cells)
        else:
            columns[name] = column.parse(cells)
        if not columns[name].size:
            raise RecordError(f"{sheet.file} has a header and no rows; there is nothing to read")
    return columns


def _labels_of_sheet(sheet: Sheet, name: str) -> Labels:
    found = _Labels(name, sheet.file)
    cells = [
        [str(cell)] for cell in sheet.cells(find_column(name, sheet.headers, source=sheet.file))
    ]
    found.add((cells, sheet.numbers), 0)
    return found.joined()


def _seconds(text: str) -> float:
    """Return seconds since 1970 of a date and time, or since midnight of a time of day.

    They are as ISO 8601, ``01.03.2026 12:00:00.5`` or ``12:00:00.5``; without a zone they are UTC.
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
    return (found - (_EPOCH if found.tzinfo else _EPOCH_WITHOUT_ZONE)).total_seconds()


def _shown(cell: str) -> str:
    """Return the begin of a cell for a message."""
    text = cell.strip()
    return repr(text if len(text) <= 40 else text[:37] + "...")


class _Labels:
    """Collects the labels of one column."""

    def __init__(self, name: str, file: Path, decimal: str = ".") -> None:
        self.where = f"column '{name}' of {file}"
        self.file = file
        self.decimal = decimal
        self.parts: list[tuple[list[str] | FloatArray, Sequence[int]]] = []

    def add(self, block: FloatArray | Rows, index: int) -> None:
        if isinstance(block, np.ndarray):
            self.parts.append((block[:, index].copy(), ()))
        else:
            self.parts.append(([row[index] for row in block[0]], block[1]))

    def joined(self) -> Labels:
        with suppress(RecordError):
            return np.concatenate([self._numbers(*part) for part in self.parts])
        count = sum(len(cells) for cells, _ in self.parts)
        texts = (cells for cells, _ in self.parts if isinstance(cells, list))
        longest = max(max(map(len, cells), default=0) for cells in texts)
        LARGEST.check(self.file, held=np.dtype(f"U{longest}").itemsize * count)
        return np.concatenate([self._texts(*part) for part in self.parts])

    def _numbers(self, cells: list[str] | FloatArray, numbers: Sequence[int]) -> FloatArray:
        if isinstance(cells, np.ndarray):
            return cells
        return _Cells(self.where, numbers, False, decimal=self.decimal).parse(cells)

    def _texts(self, cells: list[str] | FloatArray, numbers: Sequence[int]) -> npt.NDArray[np.str_]:
        if isinstance(cells, np.ndarray):
            return np.array(list(map(repr, cells.tolist())))
        texts = np.array([cell.strip() for cell in cells])
        empty = np.isin(texts, ("", "nan", "NaN"))
        if empty.any():
            row = numbers[int(np.argmax(empty))]
            raise RecordError(f"{self.where} is empty in row {row}; give every row a label")
        return texts


class _Cells:
    """Converts the cells of one column to numbers, or says which one is not a number."""

    def __init__(
        self,
        where: str,
        numbers: Sequence[int],
        gaps: bool,
        dates: bool = False,
        decimal: str = ".",
    ) -> None:
        self.where = where
        self.numbers = numbers
        self.gaps = gaps
        self.dates = dates
        self.decimal = decimal

    def parse(self, cells: list[str]) -> FloatArray:
        if self.dates and cells and not is_number(cells[0].replace(",", ".")):
            return self._moments(cells)
        if self.decimal == ",":
            cells = [cell.replace(",", ".") if cell.count(",") == 1 else cell for cell in cells]
        try:
            values = np.fromiter(map(float, cells), np.float64, len(cells))
        except ValueError:
            values = self._one_by_one(cells)
        # float() reads 1_000 and digits of other scripts as numbers; a logger that writes them
        # means something else.
        for index, cell in enumerate(cells):
            if "_" in cell or not (cell.isascii() or cell.strip().isascii()):
                raise self._not_a_number(index, cell)
        return self.checked(values, cells)

    def checked(self, values: FloatArray, cells: Sequence[object] | FloatArray) -> FloatArray:
        """Return the values if all are finite, or gaps where gaps are allowed."""
        usable = ~np.isinf(values) if self.gaps else np.isfinite(values)
        if not usable.all():
            index = int(np.argmin(usable))
            raise RecordError(
                f"{self.where} has {_shown(str(cells[index]))} in row {self.numbers[index]}; "
                "every cell must be a finite number"
            )
        return values

    def _one_by_one(self, cells: list[str]) -> FloatArray:
        values = np.empty(len(cells))
        for index, cell in enumerate(cells):
            try:
                values[index] = float(cell)
            except ValueError:
                if not cell.strip() and not self.gaps:
                    raise self._empty(index, cells) from None
                if cell.strip():
                    raise self._not_a_number(index, cell) from None
                values[index] = np.nan
        return values

    def _moments(self, cells: list[str]) -> FloatArray:
        values = np.empty(len(cells))
        for index, cell in enumerate(cells):
            try:
                values[index] = _seconds(cell)
            except ValueError:
                raise RecordError(
                    f"{self.where} has the text {_shown(cell)} in row {self.numbers[index]}; "
                    "give time as numbers, or as 2026-03-01T12:00:00.5, 01.03.2026 12:00:00.5 or "
                    "12:00:00.5"
                ) from None
        return values

    def _empty(self, index: int, cells: list[str]) -> RecordError:
        count = sum(not cell.strip() for cell in cells)
        others = f" and in {counted(count - 1, 'other row')}" if count > 1 else ""
        kind = RecordError if count < _MERGED * len(cells) else SparseColumnError
        return kind(f"{self.where} is empty in row {self.numbers[index]}{others}; {_FILL}")

    def _not_a_number(self, index: int, cell: str) -> RecordError:
        row, text = self.numbers[index], cell.strip()
        if not text:
            return RecordError(f"{self.where} is empty in row {row}; {_FILL}")
        advice = "every cell must be a number"
        if _THOUSANDS.fullmatch(text):
            advice = "write numbers without separators of thousands"
        elif re.fullmatch(r"[-+]?\d*,\d+([eE][-+]?\d+)?", text):
            advice = "write decimals with a point"
        return RecordError(f"{self.where} has the text {_shown(text)} in row {row}; {advice}")
