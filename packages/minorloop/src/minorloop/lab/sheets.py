"""Read tables that are not text: MATLAB files and Excel workbooks."""

from collections.abc import Sequence
from functools import partial
from math import prod
from pathlib import Path
from sys import getsizeof
from typing import IO, Any
from zipfile import ZipFile

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import MinorloopError, MissingExtraError, RecordError
from minorloop.files import PathLike
from minorloop.lab.headers import check_headers, with_units
from minorloop.lab.tables import NUMBER, Block, Bounds, Cells, OpenTable, check_file

_FEWEST_NUMBERS = 2
"""Least numbers in the first row of data, and least texts in a row of headers; a title has one."""
_MOST_ROWS = 2**20
"""Rows of a sheet; Excel has no more."""
_BLOCK, _END_OF_ROW = 2**16, b"</row>"
"""Bytes of a block of a workbook, and the end of a row in it."""
_END_OF_PREAMBLE = "***End_of_Header***"
"""Last row of each preamble that LabVIEW writes above a table."""
_SHOWN = 12
"""Most variables that a message names."""


def is_sheet(path: PathLike) -> bool:
    """Whether a name belongs to a MATLAB file or an Excel workbook."""
    return Path(path).suffix.casefold() in (".mat", ".xlsx", ".xlsm")


def read_sheet(file: Path, bounds: Bounds) -> OpenTable:
    """Return the first table with numbers of a MATLAB file (versions 4 to 7.2) or a workbook.

    Raises a `RecordError` if the file cannot be read, has no table, or has one larger than the
    bounds; a `MissingExtraError` if a workbook is given and openpyxl is not installed.

    ``file``: the file; ``bounds``: bounds of the table, checked before memory is allocated for it.
    """
    check_file(file)
    found = (_mat if file.suffix.casefold() == ".mat" else _workbook)(file, bounds)
    if not found.headers:
        raise RecordError(f"{file} has no table; it needs columns of numbers")
    check_headers(found.headers, file)
    bounds.check(file, columns=len(found.headers))
    return found


def _mat(file: Path, bounds: Bounds) -> OpenTable:
    from scipy.io import loadmat, whosmat

    try:
        known = [(name, shape, kind) for name, shape, kind in whosmat(file) if name[:2] != "__"]
        wanted = [name for name, shape, kind in known if _is_table(shape, kind)]
        sizes = {name: shape for name, shape, _ in known if name in wanted}
        held = sum(NUMBER * prod(shape) for shape in sizes.values())
        bounds.check(file, rows=max(map(max, sizes.values()), default=0), held=held)
        content = loadmat(file, variable_names=wanted) if wanted else {}
    except NotImplementedError:
        raise RecordError(
            f"{file} has MATLAB format 7.3, which is not read; save it with the option -v7"
        ) from None
    except (RecordError, MemoryError):
        raise
    except Exception as error:
        raise RecordError(f"{file} is not a MATLAB file: {error}") from None
    columns: dict[str, FloatArray] = {}
    for name in wanted:
        value = content[name]
        if value.dtype.kind == "c":
            continue
        for column, part in _split(name, value).items():
            if column in columns:
                raise RecordError(f"{file} has two columns named '{column}'; rename one")
            columns[column] = np.array(part, np.float64)
    if not columns:
        words = [f"{name} ({'x'.join(map(str, shape))} {kind})" for name, shape, kind in known]
        more = [f"and {len(words) - _SHOWN} more"] if len(words) > _SHOWN else []
        shown = ", ".join(words[:_SHOWN] + more) or "none"
        raise RecordError(
            f"{file} has no variable that is a vector or a matrix of real numbers, its variables "
            f"are {shown}; save each column as a variable, such as voltage"
        )
    longest = max(column.size for column in columns.values())
    bounds.check(file, rows=longest)
    block = Block(list(columns.values()).__getitem__, range(1, longest + 1))
    return OpenTable(file, list(columns), iter([block]))


def _is_table(shape: Sequence[int], kind: str) -> bool:
    """Whether a MATLAB variable of a shape and class is a vector or a matrix of numbers."""
    numbers = kind in ("double", "single") or kind.lstrip("u").startswith("int")
    return numbers and len(shape) == 2 and prod(shape) > 1


def _split(name: str, value: npt.NDArray[Any]) -> dict[str, npt.NDArray[Any]]:
    """Return the columns of a matrix by their names; its shorter side is the number of columns."""
    if 1 in value.shape:
        return {name: value.ravel()}
    wide = value.T if value.shape[0] >= value.shape[1] else value
    return {f"{name}_{k}": part for k, part in enumerate(wide, 1)}


def _workbook(file: Path, bounds: Bounds) -> OpenTable:
    try:
        from openpyxl import load_workbook
    except ImportError:
        raise MissingExtraError("openpyxl", "excel") from None
    try:
        with ZipFile(file) as parts:
            for part in parts.infolist():
                bounds.check_expansion(file, part.compress_size, part.file_size)
                with parts.open(part) as content:
                    _check_width(file, content, bounds)
        book = load_workbook(file, read_only=True, data_only=True)
        try:
            name, numbers, rows = _first_table(book, file, bounds)
            others = [f"'{one}'" for one in book.sheetnames if one != name]
        finally:
            book.close()
    except (MinorloopError, MemoryError):
        raise
    except Exception as error:
        raise RecordError(f"{file} is not an Excel workbook: {error}") from None
    if not rows:
        return OpenTable(file, [], iter([]))
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
    said = f"sheet '{name}' is read, the first with a table of numbers; the others are "
    notes = (said + ", ".join(others),) if others else ()
    return OpenTable(file, headers, iter([Block(partial(_column, body), numbers)]), notes=notes)


def _check_width(file: Path, part: IO[bytes], bounds: Bounds) -> None:
    """Refuse a part of a workbook with a row of more cells than columns are allowed.

    Only rows that are longer than a block are checked; openpyxl, which reads each row as a whole,
    reads other rows in little time.
    """
    cells, rest = 0, b""
    while block := part.read(_BLOCK):
        text, mark, rest = (rest + block).rpartition(b"<")
        rest = (mark + rest)[: len(_END_OF_ROW)]  # a tag at the end of a block stays whole
        _, ended, row = text.rpartition(_END_OF_ROW)
        begun = sum(map(row.count, (b"<c ", b"<c>", b"<c/")))
        cells = begun if ended else cells + begun
        bounds.check(file, columns=cells)


def _column(rows: Sequence[Sequence[Any]], index: int) -> Cells:
    cells = [row[index] if index < len(row) else None for row in rows]
    numbers = cells and all(map(_is_number, cells))
    return np.array(cells, np.float64) if numbers else list(map(_as_text, cells))


def _first_table(
    book: Any, file: Path, bounds: Bounds
) -> tuple[str, list[int], list[tuple[Any, ...]]]:
    """Return name, row numbers and rows of the first sheet with a row of numbers.

    If no sheet has numbers, it is the first sheet. No row is longer than the longest row up to the
    first row of numbers; these rows include the headers. The kept cells are counted, because the
    size that a sheet states may be wrong.
    """
    found: list[tuple[str, list[int], list[tuple[Any, ...]]]] = []
    held = 0
    for sheet in book.worksheets:
        sheet.reset_dimensions()
        numbers: list[int] = []
        rows: list[tuple[Any, ...]] = []
        width, begun = 0, False
        for number, row in enumerate(sheet.iter_rows(values_only=True), 1):
            if number > _MOST_ROWS:
                raise ValueError(f"a sheet has a row beyond {_MOST_ROWS}")
            used = max((k for k, cell in enumerate(row, 1) if cell is not None), default=0)
            if not used:
                continue
            if row[0] == _END_OF_PREAMBLE:  # a preamble may have rows of numbers: Samples 100 100
                numbers, rows, width, begun = [], [], 0, False
                continue
            if not begun:
                width, begun = max(width, used), _has_numbers(row)
            numbers.append(number)
            rows.append(row[: min(used, width)])
            held += getsizeof(rows[-1]) + sum(map(getsizeof, rows[-1]))
            bounds.check(file, rows=len(rows), columns=used, held=held)
        found.append((sheet.title, numbers, rows))
        if begun:
            return found[-1]
    return found[0]


def _header_row(rows: Sequence[Sequence[Any]]) -> int:
    """Return the last row of texts above the first row of numbers, or the row above its units."""
    for number, row in enumerate(rows):
        if not _has_numbers(row):
            continue
        above = [k for k in range(number) if _is_text(rows[k])]
        if len(above) > 1 and with_units(*(list(map(_as_text, rows[k])) for k in above[-2:])):
            above.pop()
        return above[-1] if above else 0
    return 0


def _has_numbers(row: Sequence[Any]) -> bool:
    return sum(map(_is_number, row)) >= _FEWEST_NUMBERS


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
