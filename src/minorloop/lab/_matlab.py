"""Variables of a MATLAB file, whose sizes are known before anything of them is expanded.

The format of versions 5 to 7.2 is that of "MAT-File Format", The MathWorks: elements of a type, a
number of bytes and content, of which those of variables may be compressed one by one.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import RecordError
from minorloop.files import printable
from minorloop.lab.bounds import NUMBER, Bounds

_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8"} | {
    12: "i8",
    13: "u8",
}
"""Types of the content of elements, as numpy names them."""
_OLD, _OLD_CLASSES = ("f8", "f4", "i4", "i2", "u2", "u1"), {0: 6, 1: 4, 2: 5}
"""Types of version 4, and its classes as later versions number them."""
_MATRIX, _COMPRESSED = 14, 15
_CLASSES = {1: "cell", 2: "struct", 3: "object", 4: "text", 5: "sparse", 16: "function"}
_OPAQUE = 17
"""Class of dates, tables and the like, which have no size."""
_NUMBERS = range(6, 16)
"""Classes of matrices of numbers: two of floats, and integers."""
_COMPLEX, _HDF5 = 0x800, 2
"""Flag of a matrix; number of version 7.3 in the header, which has another format."""
_HEADER, _LONGEST_NAME, _MOST_SIDES = 128, 255, 32
_PACKED, _CHUNK = 1 << 13, 1 << 20
"""Bytes that are read from compressed content, and converted, at once."""


def matlab_columns(file: Path, bounds: Bounds) -> tuple[dict[str, FloatArray], list[str]]:
    """Return the columns of a MATLAB file of version 4 to 7.2, and the other variables in words.

    A vector is a column; the columns of a matrix ``data`` are ``data_1``, ``data_2`` and so on.

    Raises
    ------
    RecordError
        If it cannot be read, or is larger than the bounds.
    """
    try:
        with file.open("rb") as raw:
            return _columns(file, raw, bounds)
    except (RecordError, MemoryError):
        raise
    except Exception as error:
        raise RecordError(f"{file} is not a MATLAB file: {error}") from None


def _columns(file: Path, raw: BinaryIO, bounds: Bounds) -> tuple[dict[str, FloatArray], list[str]]:
    columns: dict[str, FloatArray] = {}
    others: list[str] = []
    held, rows, count = 0, 0, 0
    for one in _variables(file, raw):
        if one.is_table:
            held, rows = held + NUMBER * prod(one.shape), max(rows, *one.shape)
            count += 1 if 1 in one.shape else min(one.shape)
        elif not one.is_hidden:
            others.append(one.in_words)
    bounds.check(file, rows=rows, columns=count, held=held)
    for one in _variables(file, raw):
        found = _split(one.name, one.numbers()) if one.is_table else {}
        for name in columns.keys() & found.keys():
            raise RecordError(f"{file} has two columns named '{name}'; rename one")
        columns |= found
    return columns, others


def _variables(file: Path, raw: BinaryIO) -> Iterator[_Variable]:
    """Return the variables of a file; what is not read of one is skipped."""
    raw.seek(0)
    begin = raw.read(_HEADER)
    if 0 in begin[:4]:
        return _variables_of_4(raw)
    order = {b"IM": "<", b"MI": ">"}.get(begin[-2:], "")
    if not order:
        raise ValueError("it does not begin like one")
    if struct.unpack(order + "H", begin[-4:-2])[0] >> 8 == _HDF5:
        raise RecordError(
            f"{file} has MATLAB format 7.3, which is not read; save it with the option -v7"
        )
    return _variables_of_5(raw, order)


def _split(name: str, value: FloatArray) -> dict[str, FloatArray]:
    """Return the columns of a matrix, whose shorter side counts them."""
    if 1 in value.shape:
        return {name: value.ravel()}
    wide = value.T if value.shape[0] >= value.shape[1] else value
    return {f"{name}_{k}": np.ascontiguousarray(part) for k, part in enumerate(wide, 1)}


@dataclass(frozen=True)
class _Variable:
    """A variable of which the header was read."""

    name: str
    kind: int
    flags: int
    shape: tuple[int, ...]
    content: _Element
    dtype: np.dtype[Any] | None = None
    """Of its numbers, where no tag has it."""

    def __post_init__(self) -> None:
        if printable(self.name) != self.name:
            raise ValueError("the name of a variable cannot be printed")

    @property
    def is_table(self) -> bool:
        """Whether it is a vector or a matrix of real numbers."""
        real = self.kind in _NUMBERS and not self.flags & _COMPLEX and not self.is_hidden
        return real and len(self.shape) == 2 and prod(self.shape) > 1

    @property
    def is_hidden(self) -> bool:
        """Whether MATLAB keeps it for itself."""
        return not self.name or self.name.startswith("__")

    @property
    def in_words(self) -> str:
        """Its name, with its shape and type."""
        if self.kind not in (*_CLASSES, *_NUMBERS):
            return f"{self.name} (object)"
        kind = _CLASSES.get(self.kind, "complex" if self.flags & _COMPLEX else "numbers")
        sizes = {"struct": (), "text": self.shape[:-1]}.get(kind, self.shape)
        return f"{self.name} ({' '.join(['x'.join(map(str, sizes)), kind]).strip()})"

    def numbers(self) -> FloatArray:
        """Return its numbers, of which none is expanded before."""
        content, found = self.content, np.empty(prod(self.shape))
        dtype, small = self.dtype, b""
        if dtype is None:
            kind, size, small = content.tag()
            dtype = np.dtype(content.order + _TYPES.get(kind, "u1"))
            if kind not in _TYPES or size != found.size * dtype.itemsize:
                raise ValueError(f"{self.name} has {size} bytes of {found.size} numbers")
        step = _CHUNK // dtype.itemsize
        for first in range(0, found.size, step):
            part = found[first : first + step]
            part[:] = np.frombuffer(small or content.read(part.size * dtype.itemsize), dtype)
        content.end()
        return found.reshape(self.shape, order="F")


def _variables_of_4(raw: BinaryIO) -> Iterator[_Variable]:
    """Yield the variables of version 4: a header of five integers, a name, and numbers."""
    end, start = raw.seek(0, 2), 0
    while start < end:
        raw.seek(start)
        content = _Element(raw, "<")
        header = content.read(20)
        order = "<" if struct.unpack("<i", header[:4])[0] in range(1000) else ">"
        form, rows, columns, imaginary, length = struct.unpack(f"{order}5i", header)
        kind, type_ = form % 10, form // 10 % 100
        if form not in range(2000) or type_ not in range(len(_OLD)) or kind not in _OLD_CLASSES:
            raise ValueError(f"it has a variable of type {form}")
        dtype = np.dtype(order + _OLD[type_])
        size = rows * columns * dtype.itemsize * (2 if imaginary else 1)
        start += len(header) + length + size
        if min(rows, columns, length) < 0 or length > _LONGEST_NAME or start > end:
            raise ValueError("it ends within a variable")
        name = content.read(length).rstrip(b"\0").decode("latin1")
        flags = _COMPLEX if imaginary else 0
        yield _Variable(name, _OLD_CLASSES[kind], flags, (rows, columns), content, dtype)


def _variables_of_5(raw: BinaryIO, order: str) -> Iterator[_Variable]:
    """Yield the variables of versions 5 to 7.2."""
    end = raw.seek(0, 2)
    start = _HEADER
    while start < end:
        raw.seek(start)
        kind, size, _ = _Element(raw, order).tag()
        start = raw.tell() + size
        if kind not in (_MATRIX, _COMPRESSED) or start > end:
            raise ValueError(f"it has an element of type {kind} and {size} bytes")
        content = _Element(raw, order, zlib.decompressobj() if kind == _COMPRESSED else None)
        if kind == _COMPRESSED and content.tag()[0] != _MATRIX:
            raise ValueError("a compressed element is not a variable")
        flags, _ = content.integers("u4", 2)
        shape = () if flags & 0xFF == _OPAQUE else content.integers("i4", _MOST_SIDES)
        if min(shape, default=0) < 0:
            raise ValueError("a variable has a negative size")
        name = content.small(_LONGEST_NAME).decode("latin1")
        yield _Variable(name, flags & 0xFF, flags, shape, content)


class _Element:
    """Content of an element, expanded as it is read and never further.

    Parameters
    ----------
    raw : BinaryIO
        The file, at its begin.
    order : str
        ``<`` or ``>``.
    expand : zlib.Decompress, optional
        For compressed content.
    """

    def __init__(self, raw: BinaryIO, order: str, expand: zlib._Decompress | None = None) -> None:
        self.order, self._raw, self._expand = order, raw, expand

    def read(self, count: int) -> bytes:
        """Return as many bytes."""
        if self._expand is None:
            found = self._raw.read(count)
        else:
            parts = bytearray()
            while len(parts) < count and not self._expand.eof:
                packed = self._expand.unconsumed_tail or self._raw.read(_PACKED)
                part = self._expand.decompress(packed, count - len(parts))
                if not part and not packed:
                    break
                parts += part
            found = bytes(parts)
        if len(found) < count:
            raise ValueError("it ends within a variable")
        return found

    def end(self) -> None:
        """Check that compressed content ends here, but for what fills its last eight bytes."""
        if self._expand is not None:
            for packed in (self._expand.unconsumed_tail, self._raw.read(_PACKED)):
                if not self._expand.eof:
                    self._expand.decompress(packed, 8)
            if not self._expand.eof:
                raise ValueError("a compressed variable does not end with its numbers")

    def tag(self) -> tuple[int, int, bytes]:
        """Return type and size of the next element, and its content if this is in the tag."""
        tag = self.read(8)
        kind, size = struct.unpack(self.order + "II", tag)
        if kind >> 16:
            return kind & 0xFFFF, kind >> 16, tag[4 : 4 + (kind >> 16)]
        return kind, size, b""

    def small(self, most: int) -> bytes:
        """Return the content of the next element, of a few bytes."""
        _, size, content = self.tag()
        if size > most:
            raise ValueError(f"an element of {size} bytes is too long")
        if not content:
            content = self.read(size)
            self.read(-size % 8)
        return content

    def integers(self, dtype: str, most: int) -> tuple[int, ...]:
        """Return the content of the next element as integers."""
        content = self.small(4 * most)
        return tuple(np.frombuffer(content, self.order + dtype).tolist())
