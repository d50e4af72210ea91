"""Read columns of numbers from a CSV file; errors name the column and the row."""

from __future__ import annotations

import csv
import difflib
import os
import re
import stat
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import RecordError
from minorloop.files import PathLike, check_name, unquoted

MAX_BYTES = 4 * 1024**3
"""Largest file that is read: 4 GiB."""
MAX_LINE = 1024**2
"""Longest line that is read, in characters."""
MAX_COLUMNS = 10_000
"""Most columns that are read."""
CHUNK = 50_000
"""Rows that are converted to numbers at a time, if they are short."""
DELIMITERS = ",;\t"
_SLACK, _CELLS = 100, 10_000_000
"""Separators that quoted texts may add to a line; cells kept at a time."""
_LONGEST_CELL = 1000
"""Most lines of a quoted cell; more mean a missing quotation mark."""


def read_columns(
    path: PathLike,
    names: Sequence[str],
    *,
    gaps: Collection[str] = (),
    dates: Collection[str] = (),
    progress: Callable[[str], None] | None = None,
) -> dict[str, FloatArray]:
    """Read columns of numbers from a CSV file.

    The file is UTF-8 text with one header line; commas, semicolons or tabs separate the
    columns, and a point the decimals. Columns that are not asked for may hold anything.

    Parameters
    ----------
    path : str or path
        The file, 4 GiB at most.
    names : sequence of str
        Columns to read, by the whole header (``voltage [V]``) or the name (``voltage``).
    gaps : collection of str
        Those of ``names`` in which an empty cell or ``nan`` is allowed and gives NaN.

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
    with _table(path) as (file, rows, headers):
        where = {name: headers.index(find_column(name, headers, source=file)) for name in names}
        pieces: dict[str, list[FloatArray]] = {name: [] for name in names}
        first = 2
        while chunk := list(islice(rows, _at_once(headers))):
            kept, numbers = _full_rows(chunk, first, len(headers), file)
            for name, index in where.items():
                cells = [row[index] for row in kept]
                column = _Cells(f"column '{headers[index]}' of {file}", numbers, name in gaps)
                pieces[name].append(column.parse(cells))
            first += len(chunk)
    columns = {name: np.concatenate(parts or [np.empty(0)]) for name, parts in pieces.items()}
    if any(column.size == 0 for column in columns.values()):
        raise RecordError(f"{file} has a header and no rows; there is nothing to read")
    return columns


def read_each(path: PathLike) -> list[FloatArray | RecordError]:
    """Return all columns of a CSV file, gaps allowed; in place of unusable ones, the error.

    Raises
    ------
    RecordError
        If the file cannot be read, is not such a table, or has no rows.
    """
    with _table(path) as (file, rows, headers):
        pieces: list[list[FloatArray]] = [[] for _ in headers]
        troubles: dict[int, RecordError] = {}
        first = 2
        while chunk := list(islice(rows, _at_once(headers))):
            kept, numbers = _full_rows(chunk, first, len(headers), file)
            for index, header in enumerate(headers):
                if index in troubles:
                    continue
                cells = _Cells(f"column '{header}' of {file}", numbers, True)
                try:
                    pieces[index].append(cells.parse([row[index] for row in kept]))
                except RecordError as error:
                    troubles[index] = error
            first += len(chunk)
    if first == 2:
        raise RecordError(f"{file} has a header and no rows; there is nothing to read")
    return [
        troubles.get(index) or np.concatenate(parts or [np.empty(0)])
        for index, parts in enumerate(pieces)
    ]


def read_headers(path: PathLike) -> list[str]:
    """Return the column headers of a CSV file.

    Raises
    ------
    RecordError
        If the file cannot be read or does not begin with a line of headers.
    """
    with _table(path) as (_, _, headers):
        return headers


def split_header(header: str) -> tuple[str, str]:
    """Return name and unit of a header such as ``voltage [V]``; an absent unit is empty."""
    match = re.fullmatch(r"\s*(.*?)\s*\[([^\[\]]*)\]\s*", header)
    return (match[1], match[2].strip()) if match and match[1] else (header.strip(), "")


def find_column(name: str, headers: Sequence[str], *, source: object) -> str:
    """Return the one header with a name: the whole header, or its part before the unit.

    Raises
    ------
    RecordError
        If none or several match.
    """
    check_name("the column", name, RecordError)
    if name in headers:
        return name
    matches = [header for header in headers if name.strip() in (header, split_header(header)[0])]
    if len(matches) == 1:
        return matches[0]
    if matches:
        raise RecordError(f"column '{name}' of {source} could be any of {_listed(matches)}")
    bare = {split_header(header)[0]: header for header in headers}
    known = {text.casefold(): header for text, header in bare.items()} | {
        header.casefold(): header for header in headers
    }
    close = difflib.get_close_matches(name.casefold(), list(known), n=1)
    hint = f"; did you mean '{known[close[0]]}'?" if close else ""
    raise RecordError(f"{source} has no column '{name}', it has {_listed(headers)}{hint}")


def _listed(headers: Sequence[str], *, most: int = 12) -> str:
    shown = (header if len(header) <= 60 else header[:57] + "..." for header in headers[:most])
    text = ", ".join(f"'{header}'" for header in shown)
    return text + (f" and {len(headers) - most} more" if len(headers) > most else "")


@contextmanager
def _table(path: PathLike) -> Iterator[tuple[Path, Iterator[list[str]], list[str]]]:
    """Open a file; yield its path, an iterator over its rows, and its headers."""
    file = Path(path)
    _check_file(file)
    try:
        with file.open(encoding="utf-8-sig", newline="") as text:
            headers, delimiter = _read_header(text, file)
            lines = _lines(text, file, delimiter, len(headers) + _SLACK)
            yield file, csv.reader(lines, delimiter=delimiter, strict=True), headers
    except UnicodeDecodeError:
        raise RecordError(f"{file} is not UTF-8 text; save it as CSV in UTF-8") from None
    except csv.Error as error:
        raise RecordError(f"{file} is not a table: {error}") from None
    except OSError as error:
        raise RecordError(f"{file} cannot be read: {error.strerror or error}") from None


def _check_file(file: Path) -> None:
    """Refuse a file that must not be opened."""
    try:
        status = file.stat()
    except FileNotFoundError:
        raise RecordError(f"{file} does not exist") from None
    except (OSError, ValueError) as error:
        raise RecordError(f"{file} cannot be read: {error}") from None
    if stat.S_ISDIR(status.st_mode):
        raise RecordError(f"{file} is a folder; give the name of a CSV file")
    if not stat.S_ISREG(status.st_mode):
        raise RecordError(f"{file} is not a regular file; give the name of a CSV file")
    if status.st_size > MAX_BYTES:
        raise RecordError(
            f"{file} has {status.st_size} bytes, more than the {MAX_BYTES} that are read; split it"
        )
    if not os.access(file, os.R_OK):
        raise RecordError(f"{file} cannot be read: permission denied")


def _lines(text: TextIO, file: Path, delimiter: str, most: int) -> Iterator[str]:
    """Yield the lines of a table; refuse endless rows."""
    quoted, running = 0, 0
    for number, line in enumerate(iter(partial(text.readline, MAX_LINE), ""), 2):
        if len(line) > most and line.count(delimiter) > most:
            raise RecordError(f"line {number} of {file} has more than {most} cells; repair it")
        if quoted or '"' in line:
            quoted ^= line.count('"') & 1
            running = running + 1 if quoted else 0
            if running > _LONGEST_CELL:
                raise RecordError(
                    f"{file} is not a table: a quoted cell has more than {_LONGEST_CELL} lines, "
                    f"up to line {number}; close the quotation mark"
                )
        yield line


def _at_once(headers: Sequence[str]) -> int:
    """Return how many rows are converted to numbers at a time."""
    return max(1, min(CHUNK, _CELLS // (len(headers) + _SLACK)))


def _read_header(text: TextIO, file: Path) -> tuple[list[str], str]:
    line = text.readline(MAX_LINE)
    if not line.strip():
        raise RecordError(f"{file} is empty or begins with an empty line; it needs a header line")
    delimiter = max(DELIMITERS, key=line.count)
    if "\0" in line or (len(line) == MAX_LINE and line.count(delimiter) < MAX_COLUMNS):
        raise RecordError(f"{file} looks like a binary file; give a CSV file")
    if line.count(delimiter) >= MAX_COLUMNS:
        raise RecordError(
            f"{file} has {line.count(delimiter) + 1} columns or more; give at most {MAX_COLUMNS}"
        )
    cells = next(csv.reader([line], delimiter=delimiter, strict=True))
    headers = [unquoted(cell.strip()) for cell in cells]
    for number, header in enumerate(headers, 1):
        check_name(f"header {number} of {file}", header, RecordError)
    seen: set[str] = set()
    for header in headers:
        if header and header in seen:
            raise RecordError(f"{file} has two columns named '{header}'; rename one")
        seen.add(header)
    if all(_is_number(header) for header in headers):
        raise RecordError(f"{file} begins with numbers; it needs a header line to name its columns")
    return headers, delimiter


def _full_rows(
    chunk: list[list[str]], first: int, width: int, file: Path
) -> tuple[list[list[str]], Sequence[int]]:
    """Return rows that are not blank, with their row numbers in the file."""
    numbers: Sequence[int] = range(first, first + len(chunk))
    if set(map(len, chunk)) == {width}:
        return chunk, numbers
    pairs = [(row, number) for row, number in zip(chunk, numbers, strict=True) if row]
    for row, number in pairs:
        if len(row) != width:
            raise RecordError(
                f"row {number} of {file} has {len(row)} cells, the header has {width}; repair it"
            )
    return [row for row, _ in pairs], [number for _, number in pairs]


class _Cells:
    """Converts the cells of one column to numbers, or says which one is not a number."""

    def __init__(self, where: str, numbers: Sequence[int], gaps: bool) -> None:
        self.where = where
        self.numbers = numbers
        self.gaps = gaps

    def parse(self, cells: list[str]) -> FloatArray:
        try:
            values = np.fromiter(map(float, cells), np.float64, len(cells))
        except ValueError:
            values = self._one_by_one(cells)
        # float() reads 1_000 and digits of other scripts as numbers; a logger that writes them
        # means something else.
        together = "".join(cells)
        if "_" in together or not together.isascii():
            for index, cell in enumerate(cells):
                if "_" in cell or not cell.strip().isascii():
                    raise self._not_a_number(index, cell)
        usable = ~np.isinf(values) if self.gaps else np.isfinite(values)
        if not usable.all():
            index = int(np.argmin(usable))
            raise RecordError(
                f"{self.where} has {cells[index].strip()!r} in row {self.numbers[index]}; "
                "every cell must be a finite number"
            )
        return values

    def _one_by_one(self, cells: list[str]) -> FloatArray:
        values = np.empty(len(cells))
        for index, cell in enumerate(cells):
            try:
                values[index] = float(cell)
            except ValueError:
                if cell.strip() or not self.gaps:
                    raise self._not_a_number(index, cell) from None
                values[index] = np.nan
        return values

    def _not_a_number(self, index: int, cell: str) -> RecordError:
        row, text = self.numbers[index], cell.strip()
        if not text:
            return RecordError(f"{self.where} is empty in row {row}; every cell must be a number")
        shown = repr(text if len(text) <= 40 else text[:37] + "...")
        advice = "every cell must be a number"
        if re.fullmatch(r"[-+]?\d*,\d+([eE][-+]?\d+)?", text):
            advice = "write decimals with a point"
        return RecordError(f"{self.where} has the text {shown} in row {row}; {advice}")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
