"""Open a table that is text: its encoding, comments, headers, units, decimals, and its rows.

Files of spreadsheets and instruments differ: UTF-8, UTF-16 or Windows-1252; commas, semicolons or
tabs between the columns; a point or a comma in decimals; lines of comments before the header; a row
of units after it. Blocks of plain numbers are converted together, the rest cell by cell.
"""

import codecs
import csv
import io
import itertools
import re
import shlex
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TextIO

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import RecordError, counted
from minorloop.files import kind_of_file, unquoted
from minorloop.lab.headers import check_headers, with_units
from minorloop.lab.tables import (
    DECIMAL_COMMA,
    LARGEST,
    Block,
    Bounds,
    OpenTable,
    check_file,
    is_number,
)

_MAX_LINE = 1024**2
"""Longest line, in characters."""
_CHUNK, BLOCK = 50_000, 8 * 1024**2
"""Number of rows and characters that are converted to numbers together."""
_LATIN = "cp1252"
"""Encoding of a file that is not UTF-8: that of Windows, which contains Latin-1."""
_DELIMITERS = ",;\t"
_COMMENTS = ("#", "%", "//")
_SLACK = 100
"""Separators that quoted texts may add to a line."""
_LONGEST_CELL = 1000
"""Most lines of a quoted cell; more lines mean a missing quotation mark."""
_MOST_COMMENTS = 1000
_BEGIN, _ZEROS = 1024, 0.9
"""Number of first bytes that show UTF-16, and their share of zeros at every second place."""
_SQLITE = b"SQLite format 3\0"
"""Begin of an experiment store."""
_LOOKED_AT, _FEWEST_NUMBERS = 50, 2
"""Number of rows that show decimal separator and header, and of numbers in a row below it."""
_DIVIDED = re.compile(r"\s*[-+]?\d{1,3},\d{3}(\.\d*)?\s*")
"""A number that its separator of thousands divides into two cells."""
_UNDIVIDED = (
    "write numbers with a decimal point and without separators of thousands, or separate the "
    "columns by semicolons"
)


@contextmanager
def opened_text(file: Path, progress: Callable[[str], None], bounds: Bounds) -> Iterator[OpenTable]:
    """Open a table; errors of reading become a `RecordError`.

    ``file``: the file; ``progress``: called with the share that has been read, as text; ``bounds``:
    largest table.
    """
    check_file(file)
    try:
        encoding = _encoding_of(file)
        with file.open(encoding=encoding, newline="") as text:
            table = _begin(text, file, bounds, progress)
            if encoding == _LATIN:
                said = f"{file} is not UTF-8 and was read as Windows-1252"
                table.notes += (f"{said}; check units such as µm and °C",)
            yield table
    except UnicodeError:
        raise RecordError(
            f"{file} is neither UTF-8 nor Windows-1252 text; save it as CSV in UTF-8"
        ) from None
    except csv.Error as error:
        raise RecordError(f"{file} is not a table: {error}") from None
    except OSError as error:
        raise RecordError(f"{file} cannot be read: {error.strerror or error}") from None


def _encoding_of(file: Path) -> str:
    """Return the encoding of a text file: UTF-16, UTF-8, otherwise Windows-1252.

    Refuses an experiment store, and files of JSON and TOML.
    """
    decoder = codecs.getincrementaldecoder("utf-8")()
    with file.open("rb") as raw:
        begin = raw.read(_BEGIN)
        if begin.startswith(_SQLITE):
            raise RecordError(
                f"{file} is an experiment store, not a table; minorloop runs export --store "
                f"{shlex.quote(str(file))} --save points.csv writes its points as one"
            )
        kind = kind_of_file(file, begin)
        if kind not in ("", "a table"):
            raise RecordError(f"{file} is {kind}, not a table; give a CSV, .mat or .xlsx file")
        if begin.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            return "utf-16"
        # UTF-16 without its mark has zeros at every second place of plain letters and digits.
        zeros = [np.mean(np.frombuffer(begin[k::2], np.uint8) == 0) for k in (0, 1) if begin[k:]]
        for name, more, fewer in (("utf-16-be", 0, 1), ("utf-16-le", 1, 0)):
            if len(zeros) == 2 and zeros[more] > _ZEROS and zeros[fewer] == 0:
                return name
        raw.seek(0)
        try:
            while chunk := raw.read(BLOCK):
                decoder.decode(chunk)
            decoder.decode(b"", final=True)
        except UnicodeDecodeError:
            return _LATIN
    return "utf-8-sig"


def _begin(text: TextIO, file: Path, bounds: Bounds, progress: Callable[[str], None]) -> OpenTable:
    """Read up to the first row of data."""
    comment, number, place = "", 1, text.tell()
    line = text.readline(_MAX_LINE)
    while line.lstrip().startswith(_COMMENTS) or (comment and line and not line.strip()):
        if number > _MOST_COMMENTS:
            raise RecordError(f"{file} begins with {number - 1} comments; remove them")
        comment = line if line.strip() else comment
        number, place = number + 1, text.tell()
        line = text.readline(_MAX_LINE)
    if not line.strip():
        raise RecordError(f"{file} is empty or begins with an empty line; it needs a header line")
    text.seek(place)
    lines, places = list[str](), list[int]()
    for _ in range(2 * _LOOKED_AT):
        places.append(text.tell())
        lines.append(text.readline(_MAX_LINE))
    above = _above_header(lines[:_LOOKED_AT])
    line, data = lines[above], above + 1
    delimiter = max(_DELIMITERS, key=line.count)
    if "\0" in line or (len(line) == _MAX_LINE and line.count(delimiter) < LARGEST.columns):
        raise RecordError(f"{file} looks like a binary file; give a CSV file")
    bounds.check(file, columns=line.count(delimiter) + 1)
    headers = _cells(line, delimiter)
    if all(_is_any_number(header) for header in headers):
        headers, data = _cells(comment.lstrip().lstrip("#%/"), delimiter), above
        if len(headers) != len(_cells(line, delimiter)) or any(map(_is_any_number, headers)):
            raise RecordError(
                f"{file} begins with numbers; it needs a header line to name its columns"
            )
    check_headers(headers, file)
    following, units = lines[data : data + _LOOKED_AT], None
    if following[0].strip() and '"' not in following[0]:
        units = with_units(headers, _cells(following[0], delimiter))
    if units:
        headers, data = units, data + 1
        check_headers(headers, file)
    text.seek(places[data])
    decimal = _decimal(following, delimiter)
    rows = _TextRows(file, len(headers), delimiter, decimal)
    notes = (f"the first {counted(above, 'line')} of {file} are above its table",) if above else ()
    blocks = rows.blocks(text, number + data, bounds, progress)
    return OpenTable(file, headers, blocks, decimal, notes, above)


def _above_header(lines: Sequence[str]) -> int:
    """Return the number of lines above the header; they have other columns than the table.

    Below the header, or below a row of units, is a row of as many cells, at least two of them
    numbers.
    """
    for above, line in enumerate(lines):
        delimiter = max(_DELIMITERS, key=line.count)
        width = line.count(delimiter) + 1
        if width == 1 or (above and lines[0].count(delimiter) + 1 == width):
            continue
        named = not any(map(_is_any_number, line.split(delimiter)))
        below = [row.split(delimiter) for row in lines[above + 1 : above + 3]]
        if named and any(
            len(row) == width and sum(map(_is_any_number, row)) >= _FEWEST_NUMBERS for row in below
        ):
            return above
    return 0


def _cells(line: str, delimiter: str) -> list[str]:
    cells = next(csv.reader([line], delimiter=delimiter, strict=True), [])
    return [unquoted(cell.strip()) for cell in cells]


def _decimal(lines: Sequence[str], delimiter: str) -> str:
    """Return the decimal separator: a comma if some numbers have one and none has a point."""
    if delimiter == ",":
        return "."
    cells = [cell for line in lines for cell in line.strip().split(delimiter)]
    comma = any(DECIMAL_COMMA.fullmatch(cell) for cell in cells)
    point = any("." in cell and is_number(cell) for cell in cells)
    return "," if comma and not point else "."


def _is_any_number(text: str) -> bool:
    return is_number(text) or bool(DECIMAL_COMMA.fullmatch(text))


def _column(numbers: FloatArray, index: int) -> FloatArray:
    return np.ascontiguousarray(numbers[:, index])


@dataclass(frozen=True)
class _TextRows:
    """Format of the rows of a table."""

    file: Path
    width: int
    """Number of columns."""
    delimiter: str
    decimal: str

    def blocks(
        self, text: TextIO, row: int, bounds: Bounds, progress: Callable[[str], None]
    ) -> Iterator[Block]:
        """Yield the rest of a file as blocks of numbers, or of cells; ``row`` is its first line."""
        count, read, size = 0, 0, max(self.file.stat().st_size, 1)
        while True:
            place = text.tell()
            part = text.read(BLOCK)
            part += text.readline(_MAX_LINE) if part and not part.endswith("\n") else ""
            if not part:
                return
            numbers = self._numbers(part)
            quoted = '"' in part or (len(part) > _MAX_LINE and not part.endswith("\n"))
            if numbers is not None:
                rows = range(row, row + numbers.shape[0])
                found = iter([Block(partial(_column, numbers), rows)])
            elif quoted:  # its last cell may continue in the next part
                text.seek(place)
                found = self._texts(text, row)
            else:
                found = self._texts(io.StringIO(part, newline=""), row)
            for block in found:
                count += len(block.numbers)
                bounds.check(self.file, rows=count)
                yield block
            row += part.count("\n")
            read += len(part)
            progress(f"{min(read / size, 1):.0%}")

    def _numbers(self, part: str) -> FloatArray | None:
        """Return a part of plain numbers, (rows, columns); None if it has other content."""
        if not part.strip() or (self.decimal == "," and "." in part):
            return None
        if self.decimal == ",":
            part = part.replace(",", ".")
        try:
            lines = io.StringIO(part, newline=None)
            values = np.loadtxt(lines, delimiter=self.delimiter, comments=None, ndmin=2)
        except ValueError:
            return None
        # Blank lines are left out; then the numbers of rows are not consecutive.
        whole = values.shape == (part.count("\n") + (not part.endswith("\n")), self.width)
        return values if whole and np.isfinite(values).all() else None

    def _texts(self, text: TextIO, first: int) -> Iterator[Block]:
        chunk: list[list[str]] = []
        size = 0
        for row in csv.reader(self._lines(text, first), delimiter=self.delimiter, strict=True):
            chunk.append(row)
            size += len(row) + sum(map(len, row))
            if size >= BLOCK or len(chunk) == _CHUNK:
                yield self._full(chunk, first)
                first, chunk, size = first + len(chunk), [], 0
        if chunk:
            yield self._full(chunk, first)

    def _lines(self, text: TextIO, first: int) -> Iterator[str]:
        """Yield the lines of a table; refuse endless rows."""
        quoted, running, most = 0, 0, self.width + _SLACK
        for number, line in enumerate(iter(partial(text.readline, _MAX_LINE), ""), first):
            if len(line) > most and line.count(self.delimiter) > most:
                raise RecordError(
                    f"line {number} of {self.file} has more than {most} cells; repair it"
                )
            if quoted or '"' in line:
                quoted ^= line.count('"') & 1
                running = running + 1 if quoted else 0
                if running > _LONGEST_CELL:
                    raise RecordError(
                        f"{self.file} is not a table: a quoted cell has more than {_LONGEST_CELL} "
                        f"lines, up to line {number}; close the quotation mark"
                    )
            yield line

    def _full(self, chunk: list[list[str]], first: int) -> Block:
        """Return the rows that are neither blank nor comments, with their numbers in the file."""
        rows, numbers = [], []
        for number, row in enumerate(chunk, first):
            if not row or row[0].lstrip().startswith(_COMMENTS):
                continue
            if len(row) != self.width:
                split = any(map(_DIVIDED.fullmatch, map(",".join, itertools.pairwise(row))))
                split |= self.delimiter == "," and len(row) == 2 * self.width
                advice = _UNDIVIDED if split else "repair it"
                raise RecordError(
                    f"row {number} of {self.file} has {counted(len(row), 'cell')}, the header has "
                    f"{self.width}; {advice}"
                )
            rows.append(row)
            numbers.append(number)
        return Block(lambda k: [row[k] for row in rows], numbers)
