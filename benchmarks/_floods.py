"""Workbooks and MATLAB files that say what is not true: they are written part by part."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterable
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile

HEADERS = "<row><c t='inlineStr'><is><t>u</t></is></c><c t='inlineStr'><is><t>y</t></is></c></row>"
_SPREADSHEET = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
_RELATED = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
_PACKAGE = "http://schemas.openxmlformats.org/package/2006/relationships"


def relations(**parts: tuple[str, str]) -> str:
    """Return the relations of a part of a workbook: kind and target by id."""
    rows = (
        f"<Relationship Id='{key}' Type='{_RELATED}/{kind}' Target='{part}'/>"
        for key, (kind, part) in parts.items()
    )
    return f"<Relationships xmlns='{_PACKAGE}'>{''.join(rows)}</Relationships>"


def workbook(
    file: Path,
    *rows: tuple[str, int],
    before: str = "",
    strings: tuple[str, int] | None = None,
) -> Path:
    """Write a workbook of one sheet; its rows and shared texts are repeated."""
    related = {"a": ("worksheet", "sheet.xml")}
    with ZipFile(file, "w", ZIP_DEFLATED) as book:
        book.writestr("_rels/.rels", relations(a=("officeDocument", "xl/book.xml")))
        book.writestr(
            "xl/book.xml",
            f"<workbook xmlns='{_SPREADSHEET}' xmlns:r='{_RELATED}'><sheets>"
            "<sheet name='run' r:id='a'/></sheets></workbook>",
        )
        with book.open("xl/sheet.xml", "w", force_zip64=True) as part:
            part.write(f"{before}<worksheet xmlns='{_SPREADSHEET}'><sheetData>".encode())
            _repeat(part.write, rows)
            part.write(b"</sheetData></worksheet>")
        if strings:
            related["b"] = ("sharedStrings", "/xl/strings.xml")
            with book.open("xl/strings.xml", "w", force_zip64=True) as part:
                part.write(f"<sst xmlns='{_SPREADSHEET}'>".encode())
                _repeat(part.write, [(f"<si><t>{strings[0]}</t></si>", strings[1])])
                part.write(b"</sst>")
        book.writestr("xl/_rels/book.xml.rels", relations(**related))
    return file


def _repeat(write: Callable[[bytes], object], texts: Iterable[tuple[str, int]]) -> None:
    for text, times in texts:
        for first in range(0, times, 1000):
            write(text.encode() * min(times - first, 1000))


def variable(
    name: bytes,
    count: int,
    content: Iterable[bytes] = (),
    kind: int = 6,
    size: int | None = None,
) -> bytes:
    """Return a compressed MATLAB variable, a column of ``count`` numbers as its header says."""
    size = 8 * count if size is None else size
    header = struct.pack("<4I2I2i2I", 6, 8, kind, 0, 5, 8, count, 1, 1, len(name))
    header += name.ljust(-(-len(name) // 8) * 8, b"\0") + struct.pack("<2I", 9, size & 0xFFFFFFFF)
    packer = zlib.compressobj()
    whole = (len(header) + size) & 0xFFFFFFFF
    parts = [packer.compress(struct.pack("<2I", 14, whole) + header)]
    packed = b"".join([*parts, *map(packer.compress, content), packer.flush()])
    return struct.pack("<2I", 15, len(packed)) + packed


def matlab(file: Path, *elements: bytes) -> Path:
    """Write a MATLAB file of version 5."""
    file.write_bytes(b"MATLAB 5.0".ljust(124) + b"\0\1IM" + b"".join(elements))
    return file
