"""Workbooks and MATLAB files that say what is not true: they are written part by part."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterable
from io import BytesIO
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile

HEADERS = "<row><c t='inlineStr'><is><t>u</t></is></c><c t='inlineStr'><is><t>y</t></is></c></row>"
_SPREADSHEET = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
_TYPES = "[Content_Types].xml"
_SHARED = (
    "<Override PartName='/xl/sharedStrings.xml' ContentType='application/"
    "vnd.openxmlformats-officedocument.spreadsheetml.sharedStrings+xml'/>"
)


def workbook(file: Path, *rows: tuple[str, int], strings: tuple[str, int] | None = None) -> Path:
    """Write a workbook of one sheet; its rows and shared texts are repeated."""
    import openpyxl

    sound = BytesIO()
    book = openpyxl.Workbook()
    book.active.append(["u"])
    book.save(sound)
    text, times = strings or ("", 0)
    parts = {
        "xl/worksheets/sheet1.xml": ("worksheet", "sheetData", rows),
        "xl/sharedStrings.xml": ("sst", "", ((f"<si><t>{text}</t></si>", times),)),
    }
    with ZipFile(sound) as known, ZipFile(file, "w", ZIP_DEFLATED) as flood:
        for name in {*known.namelist()} - {_TYPES, *parts}:
            flood.writestr(name, known.read(name))
        types = known.read(_TYPES).decode()
        flood.writestr(_TYPES, types.replace("</Types>", f"{_SHARED}</Types>"))
        for name, (outer, inner, content) in parts.items():
            with flood.open(name, "w", force_zip64=True) as part:
                part.write(f"<{outer} xmlns='{_SPREADSHEET}'>".encode())
                part.write(f"<{inner}>".encode() if inner else b"")
                _repeat(part.write, content)
                part.write(f"</{inner}>".encode() if inner else b"")
                part.write(f"</{outer}>".encode())
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
