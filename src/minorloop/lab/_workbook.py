"""Rows of an Excel workbook, read as a stream: memory is needed for the cells that are kept only.

A workbook is a zip of XML parts (ECMA-376). openpyxl builds a tree of each row and objects of all
texts and styles before the first cell is known, so that of openpyxl only conversions are used.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterator
from pathlib import Path
from sys import getsizeof
from typing import IO, Any, TypeAlias
from xml.parsers import expat
from zipfile import ZipFile

from minorloop.errors import MissingExtraError
from minorloop.lab.bounds import LARGEST, Bounds

Row: TypeAlias = tuple[int, tuple[Any, ...]]
"""Number of a row, and its cells from column A to the last that is not empty."""

_CHUNK = 1 << 16
_LONGEST_TEXT, _LONGEST_TAG, _DEEPEST = 32_767, 1 << 20, 100
"""Characters of a cell, which Excel does not exceed; bytes of a tag; tags in each other."""
_DIGITS, _WHOLE = 16, re.compile(r"[-+]?[0-9]+").fullmatch
"""Characters from which a whole number is read as others are."""
_SLOT, _ENTRY = 8, 256
"""Bytes that a cell takes beside its value, and about those of a sheet or a format."""


class Workbook:
    """An open workbook.

    Parameters
    ----------
    file : Path
    bounds : Bounds

    Raises
    ------
    MissingExtraError
        If openpyxl is not installed.
    """

    def __init__(self, file: Path, bounds: Bounds) -> None:
        try:
            import openpyxl.utils.datetime
        except ImportError:
            raise MissingExtraError("openpyxl", "excel") from None
        self.file, self._bounds, self._held = file, bounds, 0
        self._conversions = openpyxl.utils.datetime
        self._epoch = self._conversions.WINDOWS_EPOCH
        self._dates: dict[int, bool] = {}
        self._strings: list[str] = []
        self._zip = ZipFile(file)
        start = self._related("", "officeDocument")
        book = next(iter(start.values()))
        sheets = self._related(book, "worksheet")
        self.sheets: dict[str, str] = {}
        for _, tag, attributes in self._tags(book, ("workbookPr", "sheet")):
            if tag == "workbookPr" and attributes.get("date1904") in ("1", "true"):
                self._epoch = self._conversions.MAC_EPOCH
            elif tag == "sheet" and attributes["id"] in sheets:
                self.sheets[attributes["name"]] = sheets[attributes["id"]]
        for part in self._related(book, "sharedStrings").values():
            for text in _Texts("si").parse(self._open(part)):
                self.hold(_SLOT + getsizeof(text))
                self._strings.append(text)
        for part in self._related(book, "styles").values():
            self._dates |= self._date_styles(part)

    def close(self) -> None:
        """Close the file."""
        self._zip.close()

    def rows(self, sheet: str) -> Iterator[Row]:
        """Yield the rows of a sheet that are not blank."""
        return _SheetRows(self).parse(self._open(self.sheets[sheet]))

    def hold(self, size: int) -> None:
        """Count bytes of memory that are kept."""
        self._held += size
        self._bounds.check(self.file, held=self._held)

    def value(self, kind: str, text: str, style: int) -> Any:
        """Return the value of a cell that is not empty, as openpyxl does."""
        if kind == "s":
            return self._strings[int(text)]
        value: Any = text
        if kind == "n":
            value = int(text) if len(text) < _DIGITS and _WHOLE(text) else float(text)
            if style in self._dates:
                span = self._dates[style]
                try:
                    value = self._conversions.from_excel(value, self._epoch, timedelta=span)
                except (OverflowError, ValueError):
                    value = "#VALUE!"
        elif kind == "b":
            value = bool(int(text))
        elif kind == "d":
            value = self._conversions.from_ISO8601(text)
        self._held += getsizeof(value)
        return value

    def _open(self, part: str) -> IO[bytes]:
        info = self._zip.getinfo(part)
        self._bounds.check_expansion(self.file, info.compress_size, info.file_size)
        return self._zip.open(info)

    def _tags(self, part: str, wanted: tuple[str, ...]) -> Iterator[tuple[str, str, Any]]:
        """Yield parent, name and attributes of tags."""
        for found in _Tags(wanted).parse(self._open(part)):
            self.hold(_ENTRY)
            yield found

    def _related(self, part: str, kind: str) -> dict[str, str]:
        """Return the parts of a kind that a part refers to, by their ids."""
        folder, name = posixpath.split(part)
        rows = self._tags(posixpath.join(folder, "_rels", f"{name}.rels"), ("Relationship",))
        return {
            one["Id"]: posixpath.normpath(posixpath.join("/", folder, one["Target"])).lstrip("/")
            for _, _, one in rows
            if one["Type"].endswith(f"/{kind}")
        }

    def _date_styles(self, part: str) -> dict[int, bool]:
        """Return the styles of dates and times; True for those of time spans."""
        from openpyxl.styles.numbers import BUILTIN_FORMATS, is_date_format, is_timedelta_format

        formats, found, count = dict(BUILTIN_FORMATS), {}, 0
        for parent, tag, attributes in self._tags(part, ("numFmt", "xf")):
            if tag == "numFmt" and parent == "numFmts":
                formats[int(attributes["numFmtId"])] = attributes["formatCode"]
            elif parent == "cellXfs":
                code = formats.get(int(attributes.get("numFmtId", 0)), "General")
                if is_date_format(code):
                    found[count] = bool(is_timedelta_format(code))
                count += 1
        return found


class _Part:
    """Handlers of the XML of a part, which add to ``found``.

    Text is taken from tags of the name ``wanted``, except phonetic ones.
    """

    wanted = "t"

    def __init__(self) -> None:
        self.found: list[Any] = []
        self.text: list[str] = []
        self._length, self._depth, self._phonetic, self._taking = 0, 0, False, False

    def opened(self, name: str, attributes: dict[str, str]) -> None:
        """Handle the begin of a tag."""

    def closed(self, name: str) -> None:
        """Handle the end of a tag."""

    def parse(self, stream: IO[bytes]) -> Iterator[Any]:
        """Yield what is found, and close the stream."""
        parser = expat.ParserCreate(namespace_separator=" ")
        parser.buffer_text = True
        parser.StartElementHandler, parser.EndElementHandler = self._start, self._end
        parser.CharacterDataHandler = self._take
        parser.StartDoctypeDeclHandler = _refuse_definitions
        fed = 0
        with stream:
            while chunk := stream.read(_CHUNK):
                parser.Parse(chunk, False)
                fed += len(chunk)
                if fed - parser.CurrentByteIndex > _LONGEST_TAG:
                    raise ValueError(f"it has a tag of more than {_LONGEST_TAG} bytes")
                yield from self.found
                self.found.clear()
            parser.Parse(b"", True)
        yield from self.found

    def joined(self) -> str:
        """Return the text since the last call."""
        text = "".join(self.text)
        self.text.clear()
        self._length = 0
        return text

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        name = tag.rpartition(" ")[2]
        self._depth += 1
        if self._depth > _DEEPEST:
            raise ValueError(f"it has more than {_DEEPEST} tags in each other")
        if name == self.wanted:
            self._taking = not self._phonetic
        elif name == "rPh":
            self._phonetic = True
        else:
            self.opened(name, attributes)

    def _end(self, tag: str) -> None:
        name = tag.rpartition(" ")[2]
        self._depth -= 1
        if name == self.wanted:
            self._taking = False
        elif name == "rPh":
            self._phonetic = False
        else:
            self.closed(name)

    def _take(self, data: str) -> None:
        if self._taking:
            self._length += len(data)
            if self._length > _LONGEST_TEXT:
                raise ValueError(f"it has a cell of more than {_LONGEST_TEXT} characters")
            self.text.append(data)


def _refuse_definitions(*_: Any) -> None:
    raise ValueError("it has a document type, whose definitions could expand without bound")


class _Tags(_Part):
    """Finds parent, name and attributes of tags."""

    def __init__(self, names: tuple[str, ...]) -> None:
        super().__init__()
        self._names, self._within = names, [""]

    def opened(self, name: str, attributes: dict[str, str]) -> None:
        if name in self._names:
            bare = {key.rpartition(" ")[2]: value for key, value in attributes.items()}
            self.found.append((self._within[-1], name, bare))
        self._within.append(name)

    def closed(self, name: str) -> None:
        self._within.pop()


class _Texts(_Part):
    """Finds the texts of tags of a name."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self._name = name

    def closed(self, name: str) -> None:
        if name == self._name:
            self.found.append(self.joined())


class _SheetRows(_Part):
    """Finds the rows of a sheet."""

    def __init__(self, book: Workbook) -> None:
        super().__init__()
        self._book, self._row, self._column = book, 0, 0
        self._kind, self._style = "n", 0
        self._cells: dict[int, Any] = {}
        self._columns: dict[str, int] = {}

    def opened(self, name: str, attributes: dict[str, str]) -> None:
        if name == "c":
            self._kind = attributes.get("t", "n")
            self._style = int(attributes.get("s", 0))
            self.wanted = "t" if self._kind == "inlineStr" else "v"
            where = attributes.get("r")
            self._column = self._number(where) if where else self._column + 1
        elif name == "row":
            self._row = int(attributes.get("r", self._row + 1))
            self._column = 0

    def closed(self, name: str) -> None:
        if name == "c":
            text = self.joined()
            if text:
                if self._column > LARGEST.columns:
                    LARGEST.check(self._book.file, columns=self._column)
                self._cells[self._column] = self._book.value(self._kind, text, self._style)
        elif name == "row" and self._cells:
            row = [None] * max(self._cells)
            for column, value in self._cells.items():
                row[column - 1] = value
            self._book.hold(getsizeof(row))
            self.found.append((self._row, tuple(row)))
            self._cells.clear()

    def _number(self, where: str) -> int:
        """Return the number of the column of a cell such as ``AB12``, counted from 1."""
        letters = where.rstrip("0123456789")
        if letters not in self._columns:
            number = 0
            for letter in letters.upper():
                number = 26 * number + ord(letter) - ord("A") + 1
            self._columns[letters] = number
        return self._columns[letters]
