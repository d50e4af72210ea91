"""Open a table that is text: its encoding, comments, headers, units, decimals, and its rows.

Files of spreadsheets and instruments differ: UTF-8, UTF-16 or Windows-1252; commas, semicolons or
tabs between the columns; a point or a comma in decimals; lines of comments before the header; a row
of units after it. Blocks of plain numbers are converted at once, the rest cell by cell.
"""

import codecs
import csv
import io
import itertools
import os
import re
import shlex
import stat
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TextIO

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import RecordError, counted
from minorloop.files import PathLike, check_name, kind_of_file, unquoted
from minorloop.lab.bounds import LARGEST, Bounds

MAX_BYTES = 4 * 1024**3
"""Largest file that is read: 4 GiB."""
MAX_LINE = 1024**2
"""Longest line that is read, in characters."""
CHUNK, BLOCK = 50_000, 8 * 1024**2
"""Rows and characters that are converted to numbers at once."""
LATIN = "cp1252"
"""Encoding of a file that is not UTF-8: that of Windows, which contains Latin-1."""
DELIMITERS = ",;\t"
COMMENTS = ("#", "%", "//")
_UNITS = """
s ms us µs μs ns min h d V mV uV µV kV A mA uA µA nA m cm mm um µm nm 1/m Hz kHz MHz N mN uN µN kN
Pa kPa MPa bar mbar T mT uT µT G Oe kOe A/m kA/m emu Am2 K mK C °C degC F deg ° rad mrad W mW
J mJ Ohm ohm Ω kg g mg % ppm dB a.u. arb. counts
"""
UNITS = frozenset(_UNITS.split())
"""Units that are recognised in a row of their own, and in round brackets."""
_SLACK = 100
"""Separators that quoted texts may add to a line."""
_LONGEST_CELL = 1000
"""Most lines of a quoted cell; more mean a missing quotation mark."""
_MOST_COMMENTS = 1000
_BEGIN, _ZEROS = 1024, 0.9
"""Bytes at the begin of a file that tell UTF-16, and their share of zeros at one of two places."""
_SQLITE = b"SQLite format 3\0"
"""Begin of an experiment store."""
_LOOKED_AT = 50
"""Rows from which the decimal separator is recognised."""
_DECIMAL_COMMA = re.compile(r"\s*[-+]?\d*,\d+([eE][-+]?\d+)?\s*")

_THOUSANDS = re.compile(r"\s*[-+]?\d{1,3},\d{3}(\.\d*)?\s*")
"""A number that its separator of thousands divides into two cells."""

Rows = tuple[list[list[str]], Sequence[int]]
"""Rows of cells, and their numbers in the file."""


@dataclass
class TextTable:
    """An open table."""

    file: Path
    """The file."""
    text: TextIO
    """It, at its first row of data."""
    headers: list[str]
    """Headers, with units."""
    delimiter: str
    """Between columns."""
    decimal: str
    """Of numbers: a point or a comma."""
    first: int
    """Line of the first row of data, counted from 1."""
    bounds: Bounds = LARGEST
    """Of the table."""
    progress: Callable[[str], None] = field(default=lambda share: None)
    """Called with the share that has been read, as text."""

    def blocks(self) -> Iterator[FloatArray | Rows]:
        """Yield blocks: arrays (rows, columns) of numbers, or rows of cells."""
        rows = 0
        for block in self._blocks():
            rows += len(block if isinstance(block, np.ndarray) else block[0])
            self.bounds.check(self.file, rows=rows)
            yield block

    def _blocks(self) -> Iterator[FloatArray | Rows]:
        row, read, size = self.first, 0, max(self.file.stat().st_size, 1)
        while True:
            place = self.text.tell()
            block = self.text.read(BLOCK)
            block += self.text.readline(MAX_LINE) if block and not block.endswith("\n") else ""
            if not block:
                return
            numbers = self._numbers(block)
            if numbers is not None:
                row += numbers.shape[0]
                yield numbers
            elif '"' in block or (len(block) > MAX_LINE and not block.endswith("\n")):
                self.text.seek(place)
                yield from self._rows(self.text, row)
                return
            else:
                yield from self._rows(io.StringIO(block, newline=""), row)
                row += block.count("\n")
            read += len(block)
            self.progress(f"{min(read / size, 1):.0%}")

    def number(self, index: int) -> int:
        """Return the number in the file of a row of data, of those that are not read yet."""
        for rows, numbers in self._rows(self.text, self.first):
            if index < len(rows):
                return numbers[index]
            index -= len(rows)
        raise IndexError(f"row {index} of {self.file}")

    def _numbers(self, block: str) -> FloatArray | None:
        """Return a block of plain numbers, (rows, columns); None if it is anything else."""
        try:
            plain = block.encode("ascii").replace(b"\r\n", b"\n")
        except UnicodeEncodeError:
            return None
        delimiter = self.delimiter.encode()
        if plain.translate(None, b"0123456789+-.,eE \n" + delimiter):
            return None
        if self.decimal == ",":
            if b"." in plain:
                return None
            plain = plain.replace(b",", b".")
        if not plain.endswith(b"\n"):
            plain += b"\n"
        codes = np.frombuffer(plain, np.uint8)
        breaks = codes[(codes == delimiter[0]) | (codes == 10)] == 10
        width = len(self.headers)
        if breaks.size % width:
            return None
        lines = breaks.reshape(-1, width)
        if not lines[:, -1].all() or lines[:, :-1].any():
            return None
        separated = plain[:-1].replace(b"\n", delimiter)
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)
            try:
                values = np.fromstring(separated, sep=self.delimiter)
            except (DeprecationWarning, ValueError):
                return None
        if values.size != breaks.size or not np.isfinite(values).all():
            return None
        return values.reshape(-1, width)

    def _rows(self, text: TextIO, first: int) -> Iterator[Rows]:
        lines = _lines(text, self.file, self.delimiter, len(self.headers) + _SLACK, first)
        chunk: list[list[str]] = []
        size = 0
        for row in csv.reader(lines, delimiter=self.delimiter, strict=True):
            chunk.append(row)
            size += len(row) + sum(map(len, row))
            if size >= BLOCK or len(chunk) == CHUNK:
                yield _full_rows(chunk, first, len(self.headers), self.file)
                first, chunk, size = first + len(chunk), [], 0
        if chunk:
            yield _full_rows(chunk, first, len(self.headers), self.file)


@contextmanager
def opened(
    path: PathLike,
    progress: Callable[[str], None] | None = None,
    bounds: Bounds = LARGEST,
) -> Iterator[TextTable]:
    """Open a table; errors of reading it become a ``RecordError``."""
    file = Path(path)
    check_file(file)
    try:
        _check_begin(file)
        with file.open(encoding=encoding_of(file), newline="") as text:
            yield _begin(text, file, bounds, progress or (lambda share: None))
    except UnicodeError:
        raise RecordError(
            f"{file} is neither UTF-8 nor Windows-1252 text; save it as CSV in UTF-8"
        ) from None
    except csv.Error as error:
        raise RecordError(f"{file} is not a table: {error}") from None
    except OSError as error:
        raise RecordError(f"{file} cannot be read: {error.strerror or error}") from None


def check_file(file: Path) -> None:
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


def _check_begin(file: Path) -> None:
    """Refuse an experiment store, and files of JSON and TOML."""
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


def check_headers(headers: Sequence[str], file: Path) -> None:
    """Refuse headers that cannot be printed, or are there twice."""
    seen: set[str] = set()
    for number, header in enumerate(headers, 1):
        check_name(f"header {number} of {file}", header, RecordError)
        if header and header in seen:
            raise RecordError(f"{file} has two columns named '{header}'; rename one")
        seen.add(header)


def with_units(headers: Sequence[str], cells: Sequence[str]) -> list[str] | None:
    """Return headers with units from a row of units; None if the row has no units."""
    units = [cell.strip().strip("[]()").strip() for cell in cells]
    known = [unit in UNITS for unit in units]
    if len(units) != len(headers) or not any(known):
        return None
    if not all(yes or unit in ("", "-", "1") for yes, unit in zip(known, units, strict=True)):
        return None
    return [
        f"{header} [{unit}]" if yes and not header.endswith(("]", ")")) else header
        for header, unit, yes in zip(headers, units, known, strict=True)
    ]


def is_number(text: str) -> bool:
    """Whether a cell is a number with a point, or none."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def encoding_of(path: PathLike) -> str:
    """Return the encoding of a text file: UTF-16, UTF-8, otherwise Windows-1252.

    Raises an `OSError` if the file cannot be read.
    """
    decoder = codecs.getincrementaldecoder("utf-8")()
    with Path(path).open("rb") as raw:
        begin = raw.read(_BEGIN)
        if begin.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            return "utf-16"
        # Without its mark, UTF-16 has zeros at every second place of plain letters and digits.
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
            return LATIN
    return "utf-8-sig"


def _begin(text: TextIO, file: Path, bounds: Bounds, progress: Callable[[str], None]) -> TextTable:
    """Read up to the first row of data."""
    comment, number, place = "", 1, text.tell()
    line = text.readline(MAX_LINE)
    while line.lstrip().startswith(COMMENTS) or (comment and line and not line.strip()):
        if number > _MOST_COMMENTS:
            raise RecordError(f"{file} begins with {number - 1} comments; remove them")
        comment = line if line.strip() else comment
        number, place = number + 1, text.tell()
        line = text.readline(MAX_LINE)
    if not line.strip():
        raise RecordError(f"{file} is empty or begins with an empty line; it needs a header line")
    delimiter = max(DELIMITERS, key=line.count)
    _check_header_line(line, delimiter, file, bounds)
    headers = _cells(line, delimiter)
    first = number + 1
    if all(_is_any_number(header) for header in headers):
        headers = _cells(comment.lstrip().lstrip("#%/"), delimiter)
        if len(headers) != len(_cells(line, delimiter)) or any(map(_is_any_number, headers)):
            raise RecordError(
                f"{file} begins with numbers; it needs a header line to name its columns"
            )
        text.seek(place)
        first = number
    check_headers(headers, file)
    place = text.tell()
    following = [text.readline(MAX_LINE) for _ in range(_LOOKED_AT)]
    text.seek(place)
    units = None
    if following[0].strip() and '"' not in following[0]:
        units = with_units(headers, _cells(following[0], delimiter))
    if units:
        headers, first = units, first + 1
        check_headers(headers, file)
        text.readline(MAX_LINE)
    decimal = _decimal(following, delimiter)
    return TextTable(file, text, headers, delimiter, decimal, first, bounds, progress)


def _check_header_line(line: str, delimiter: str, file: Path, bounds: Bounds) -> None:
    if "\0" in line or (len(line) == MAX_LINE and line.count(delimiter) < LARGEST.columns):
        raise RecordError(f"{file} looks like a binary file; give a CSV file")
    bounds.check(file, columns=line.count(delimiter) + 1)


def _cells(line: str, delimiter: str) -> list[str]:
    cells = next(csv.reader([line], delimiter=delimiter, strict=True), [])
    return [unquoted(cell.strip()) for cell in cells]


def _decimal(lines: Sequence[str], delimiter: str) -> str:
    """Return the decimal separator: a comma if some numbers have one and none has a point."""
    if delimiter == ",":
        return "."
    cells = [cell for line in lines for cell in line.strip().split(delimiter)]
    comma = any(_DECIMAL_COMMA.fullmatch(cell) for cell in cells)
    point = any("." in cell and is_number(cell) for cell in cells)
    return "," if comma and not point else "."


def _is_any_number(text: str) -> bool:
    return is_number(text) or bool(_DECIMAL_COMMA.fullmatch(text))


def _lines(text: TextIO, file: Path, delimiter: str, most: int, first: int) -> Iterator[str]:
    """Yield the lines of a table; refuse endless rows."""
    quoted, running = 0, 0
    for number, line in enumerate(iter(partial(text.readline, MAX_LINE), ""), first):
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


def _full_rows(chunk: list[list[str]], first: int, width: int, file: Path) -> Rows:
    """Return rows that are neither blank nor comments, with their row numbers in the file."""
    numbers: Sequence[int] = range(first, first + len(chunk))
    plain = set(map(len, chunk)) == {width}
    if plain and not any(row[0].startswith(COMMENTS) for row in chunk):
        return chunk, numbers
    pairs = [
        (row, number)
        for row, number in zip(chunk, numbers, strict=True)
        if row and not row[0].lstrip().startswith(COMMENTS)
    ]
    for row, number in pairs:
        if len(row) != width:
            split = any(map(_THOUSANDS.fullmatch, map(",".join, itertools.pairwise(row))))
            advice = "write numbers without separators of thousands" if split else "repair it"
            raise RecordError(
                f"row {number} of {file} has {counted(len(row), 'cell')}, the header has {width}; "
                f"{advice}"
            )
    return [row for row, _ in pairs], [number for _, number in pairs]
