"""Read tables that are not text: MATLAB files and Excel workbooks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import MissingExtraError, RecordError
from minorloop.files import PathLike
from minorloop.lab.text_tables import MAX_COLUMNS, check_file, check_headers, with_units

MAX_ROWS = 20_000_000
"""Most rows that are read."""
_FEWEST_NUMBERS = 2
"""Numbers in the first row of data, and texts in a row of headers, at least; a title has one."""


@dataclass(frozen=True, eq=False)
class Sheet:
    """A table.

    Parameters
    ----------
    file : path
        The file.
    headers : tuple of str
        Headers, with units.
    columns : tuple of list or array
        Cells of each column; an array where all are numbers.
    numbers : sequence of int
        Numbers of the rows of data in the file; blank rows are left out.
    name : str
        Name of the sheet of a workbook.
    others : tuple of str
        Names of its other sheets, which are not read.
    """

    file: Path
    headers: tuple[str, ...]
    columns: tuple[list[Any] | FloatArray, ...]
    numbers: Sequence[int]
    name: str = ""
    others: tuple[str, ...] = ()

    @property
    def which(self) -> str:
        """Which sheet this is, in words; empty if there is no other."""
        if not self.others:
            return ""
        return (
            f"sheet '{self.name}' is read, the first with a table of numbers; the others are "
            + ", ".join(f"'{one}'" for one in self.others)
        )

    def cells(self, header: str) -> list[str] | FloatArray:
        """Return the cells of a column as numbers, or as text."""
        column = self.columns[self.headers.index(header)]
        return column if isinstance(column, np.ndarray) else [_as_text(cell) for cell in column]


def is_sheet(path: PathLike) -> bool:
    """Whether a name is that of a MATLAB file or an Excel workbook."""
    return Path(path).suffix.casefold() in (".mat", ".xlsx", ".xlsm")


def read_sheet(path: PathLike) -> Sheet:
    """Return the table of a MATLAB file (versions 4 to 7.2) or a workbook: its first with numbers.

    Raises
    ------
    RecordError
        If the file cannot be read or has no table.
    MissingExtraError
        If a workbook is given and openpyxl is not installed.
    """
    file = Path(path)
    check_file(file)
    found = _mat(file) if file.suffix.casefold() == ".mat" else _workbook(file)
    if not found.headers:
        raise RecordError(f"{file} has no table; it needs columns of numbers")
    if len(found.headers) > MAX_COLUMNS:
        raise RecordError(
            f"{file} has {len(found.headers)} columns or more; give at most {MAX_COLUMNS}"
        )
    check_headers(found.headers, file)
    return found


def _mat(file: Path) -> Sheet:
    from scipy.io import loadmat

    try:
        content = loadmat(file, squeeze_me=False)
    except NotImplementedError:
        raise RecordError(
            f"{file} has MATLAB format 7.3, which is not read; save it with the option -v7"
        ) from None
    except Exception as error:
        raise RecordError(f"{file} is not a MATLAB file: {error}") from None
    columns: dict[str, FloatArray] = {}
    for name, value in content.items():
        if name.startswith("__") or not isinstance(value, np.ndarray):
            continue
        if value.dtype.kind not in "fiub" or value.ndim != 2 or value.size < 2:
            continue
        if 1 in value.shape:
            columns[name] = value.ravel().astype(np.float64)
        else:
            tall = value if value.shape[0] >= value.shape[1] else value.T
            parts = tall.T.astype(np.float64)
            columns |= {f"{name}_{k}": part for k, part in enumerate(parts, 1)}
    if not columns:
        known = (name for name in content if not name.startswith("__"))
        shown = ", ".join(f"{name} ({_kind(content[name])})" for name in known) or "none"
        raise RecordError(
            f"{file} has no variable that is a vector or a matrix of real numbers, its variables "
            f"are {shown}; save each column as a variable, such as voltage"
        )
    longest = max(column.size for column in columns.values())
    return Sheet(file, tuple(columns), tuple(columns.values()), range(1, longest + 1))


def _kind(value: Any) -> str:
    """Return shape and type of a MATLAB variable in words."""
    if not isinstance(value, np.ndarray):
        return type(value).__name__
    if value.dtype.names:
        return "struct"
    names = {"O": "cell", "U": "text", "c": "complex"}
    return f"{'x'.join(map(str, value.shape))} {names.get(value.dtype.kind, 'numbers')}"


def _workbook(file: Path) -> Sheet:
    try:
        from openpyxl import load_workbook
    except ImportError:
        raise MissingExtraError("openpyxl", "excel") from None
    try:
        book = load_workbook(file, read_only=True, data_only=True)
        try:
            name, rows = _first_table(book)
            others = tuple(one for one in book.sheetnames if one != name)
        finally:
            book.close()
    except Exception as error:
        raise RecordError(f"{file} is not an Excel workbook: {error}") from None
    numbers = [k for k, row in enumerate(rows, 1) if any(cell is not None for cell in row)]
    rows = [rows[k - 1] for k in numbers]
    if not rows:
        return Sheet(file, (), (), ())
    first = _header_row(rows)
    rows, numbers = rows[first:], numbers[first:]
    headers = [_as_text(cell).strip() for cell in rows[0]]
    while headers and not headers[-1]:
        headers.pop()
    if all(isinstance(cell, int | float) for cell in rows[0][: len(headers)]):
        raise RecordError(f"{file} begins with numbers; it needs a row of headers")
    body, numbers = rows[1:], numbers[1:]
    if body and (units := with_units(headers, list(map(_as_text, body[0][: len(headers)])))):
        headers, body, numbers = units, body[1:], numbers[1:]
    columns = tuple([row[k] for row in body] for k in range(len(headers)))
    return Sheet(file, tuple(headers), columns, numbers, name, others)


def _first_table(book: Any) -> tuple[str, list[tuple[Any, ...]]]:
    """Return name and rows of the first sheet with a row of numbers; of the first without one."""
    found: list[tuple[str, list[tuple[Any, ...]]]] = []
    for sheet in book.worksheets:
        rows = list(islice(sheet.iter_rows(values_only=True), MAX_ROWS))
        found.append((sheet.title, rows))
        if any(sum(map(_is_number, row)) >= _FEWEST_NUMBERS for row in rows):
            return found[-1]
    return found[0]


def _header_row(rows: Sequence[Sequence[Any]]) -> int:
    """Return the last row of texts above the first row of numbers, or the row of units' above."""
    for number, row in enumerate(rows):
        if sum(map(_is_number, row)) < _FEWEST_NUMBERS:
            continue
        above = [k for k in range(number) if _is_text(rows[k])]
        if len(above) > 1 and with_units(*(list(map(_as_text, rows[k])) for k in above[-2:])):
            above.pop()
        return above[-1] if above else 0
    return 0


def _is_number(cell: Any) -> bool:
    return isinstance(cell, int | float) and not isinstance(cell, bool)


def _is_text(row: Sequence[Any]) -> bool:
    """Whether a row has several cells, and all are texts."""
    cells = [cell for cell in row if cell is not None]
    return len(cells) >= _FEWEST_NUMBERS and all(isinstance(cell, str) for cell in cells)


def _as_text(cell: Any) -> str:
    if cell is None:
        return ""
    return cell.isoformat() if hasattr(cell, "isoformat") else str(cell)
