"""Write files completely or not at all, and never over existing ones unless forced.

A path is checked before a long computation and written atomically after it: a temporary file in the
same folder is renamed to the target. A spreadsheet finds no formula in the texts of a table. Names
with control characters, which terminals and pages interpret, are refused.
"""

import csv
import errno
import io
import os
import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeAlias

from minorloop.errors import MinorloopError, OutputError, ParameterError

PathLike: TypeAlias = str | os.PathLike[str]

_CONTROL = re.compile("[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")
"""C0, DEL, C1, line separators, and marks and overrides of the direction of writing."""
_FORMULA = re.compile(r"'*\s*[\t\r=+\-@\uff1d\uff0b\uff0d\uff20]")
"""Characters with which a formula may begin in a spreadsheet, also after apostrophes."""
_DECIMAL = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?", re.ASCII)
_BEGIN = 4096
"""Number of bytes at the beginning of a file by which its kind is recognised."""
_OBJECT = re.compile(rb'\s*\{\s*["}]')
_FORMAT = re.compile(rb'"format"\s*:\s*"minorloop ([a-z]+)"')
_ENDINGS = {".csv": "a table", ".mat": "a table", ".xlsx": "a table", ".toml": "a TOML file"}

_FULL = (errno.ENOSPC, errno.EDQUOT)
"""Errors of a full disk, or of an exhausted quota."""


def check_name(what: str, name: str, error: type[MinorloopError] = ParameterError) -> str:
    """Return a name; refuse one with control characters.

    These are C0, DEL and C1, marks and overrides of the direction of writing, and separators of
    lines and paragraphs. Raises an ``error``, whose message says ``what`` has this name.
    """
    found = _CONTROL.search(name)
    if found:
        raise error(
            f"{what} is {name[:60]!a}, which has the character U+{ord(found[0]):04X}; leave out "
            "what cannot be printed"
        )
    return name


def printable(name: str) -> str:
    """Return a name in which each character that `check_name` refuses is replaced."""
    return _CONTROL.sub("\ufffd", name)


def kind_of_file(path: PathLike, begin: bytes) -> str:
    """Return the kind of a file, such as ``a model file``; empty if it is unknown.

    The ending of its name determines the kind, unless ``begin``, its first bytes, is JSON.
    """
    if _OBJECT.match(begin):
        found = _FORMAT.search(begin, 0, _BEGIN)
        return f"a {found[1].decode()} file" if found else "a JSON file"
    return _ENDINGS.get(Path(path).suffix.lower(), "")


def table_text(header: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """Return a table as CSV in which a spreadsheet finds no formula.

    Numbers do not change. A text that begins like a formula, with ``=``, ``+``, ``-``, ``@``, a tab
    or a carriage return, gets an apostrophe in front, with which spreadsheets mark text; `unquoted`
    removes it. Carriage returns become line feeds.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(map(_quoted, header))
    writer.writerows(map(_quoted, row) for row in rows)
    return text.getvalue()


def unquoted(cell: str) -> str:
    """Return the text of a cell that `table_text` wrote."""
    return cell[1:] if cell.startswith("'") and _FORMULA.match(cell) else cell


def _quoted(cell: object) -> object:
    if not isinstance(cell, str):
        return cell
    if _FORMULA.match(cell) and not _DECIMAL.fullmatch(cell):
        cell = f"'{cell}"
    return cell.replace("\r\n", "\n").replace("\r", "\n")  # which csv would not put in quotes


def check_writable(path: PathLike, *, force: bool = False) -> Path:
    """Return the path of a file that can be written; refuse others.

    Raises an `OutputError` if the path is a folder or a device, its folder is missing or not
    writable, or the file exists and ``force`` is false.
    """
    target = _named(path)
    folder = target.parent
    try:
        if target.is_dir():
            raise OutputError(f"{target} is a folder; give the name of a file")
        if not folder.is_dir():
            raise OutputError(f"the folder {folder} does not exist; make it first")
        if target.exists() and not target.is_file():
            raise OutputError(f"{target} is not a regular file; give the name of a file")
        if target.exists() and not force:
            raise OutputError(f"{target} exists already; give another name, or force to replace it")
        if not os.access(folder, os.W_OK | os.X_OK):
            raise OutputError(f"the folder {folder} cannot be written to; choose another one")
    except OSError as error:
        raise refusal(target, error) from None
    return target


def write_atomically(path: PathLike, content: str | bytes, *, new: bool = False) -> None:
    """Write a file completely or not at all, replacing an existing one unless it must be ``new``.

    A reader sees the old file or the new one, never a part. A failure leaves the old one. Text is
    written as UTF-8 with unchanged line ends. The name of a new file survives a power cut, where
    the system can guarantee it.

    Raises an `OutputError` if the file cannot be written.
    """
    target = Path(os.path.realpath(_named(path)))
    data = content.encode() if isinstance(content, str) else content
    scratch = target.with_name(f".minorloop-{os.urandom(6).hex()}.tmp")
    try:
        with open(scratch, "xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        if new:
            _take_name(scratch, target)
        else:
            os.replace(scratch, target)
    except FileExistsError:
        raise OutputError(f"{target} exists already; give another name") from None
    except OSError as error:
        raise refusal(target, error) from None
    finally:
        with suppress(OSError):
            scratch.unlink(missing_ok=True)


def _take_name(scratch: Path, target: Path) -> None:
    """Rename a finished file in one step; raise a `FileExistsError` if the name is taken."""
    try:
        os.link(scratch, target)  # unlike a rename, never replaces a file
    except FileExistsError:
        raise
    except OSError:  # a file system without links
        if target.exists():
            raise FileExistsError from None
        os.rename(scratch, target)
    with suppress(OSError):
        handle = os.open(target.parent, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def make_folder(path: PathLike, *, force: bool = False) -> Path:
    """Make a folder for results, or accept an existing one that is empty, or with ``force`` any.

    Missing parents are made too. Raises an `OutputError` if the path is a file, the folder is not
    empty and ``force`` is false, or it cannot be made.
    """
    folder = _named(path)
    try:
        if folder.exists() and not folder.is_dir():
            raise OutputError(f"{folder} is a file; give the name of a folder")
        folder.mkdir(parents=True, exist_ok=True)
        if not force and any(folder.iterdir()):
            raise OutputError(f"the folder {folder} is not empty; give a new or an empty one")
        if not os.access(folder, os.W_OK | os.X_OK):
            raise OutputError(f"the folder {folder} cannot be written to; choose another one")
    except OSError as error:
        raise refusal(folder, error) from None
    return folder


@contextmanager
def new_folder(path: PathLike) -> Iterator[Path]:
    """Yield a folder made as in `make_folder`; if an error leaves it empty, it is removed.

    Raises an `OutputError` as `make_folder`.
    """
    made = [each for each in (Path(path), *Path(path).parents) if not each.exists()]
    folder = make_folder(path)
    try:
        yield folder
    except BaseException:
        with suppress(OSError):  # it is not empty
            for each in made:
                each.rmdir()
        raise


def write_folder(path: PathLike, files: Mapping[str, str], *, force: bool = False) -> Path:
    """Write texts, by the names of their files, into a folder made as in `make_folder`."""
    folder = make_folder(path, force=force)
    for name, text in files.items():
        write_atomically(folder / name, text)
    return folder


def _named(path: PathLike) -> Path:
    """Return the path; refuse one that cannot be the name of a file."""
    if "\0" in os.fspath(path):
        raise OutputError(f"{os.fspath(path)!r} cannot be written: it is not the name of a file")
    return Path(path)


def refusal(path: Path, error: OSError) -> OutputError:
    """Return the error to raise for an error of the system; a full disk comes with advice."""
    if isinstance(error, OutputError):
        return error
    advice = "; free some space there" if error.errno in _FULL else ""
    return OutputError(f"{path} cannot be written: {error.strerror or error}{advice}")


def lock_path(path: PathLike, flags: int = os.O_RDONLY, *, shared: bool = False) -> int | None:
    """Open a file or a folder and lock it; return None if another process has the lock.

    The lock ends when the returned descriptor is closed, at the latest when the process ends.
    Several processes may have a ``shared`` lock. Windows locks only files, and never shared.
    """
    descriptor = os.open(path, flags, 0o600)
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            how = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
            fcntl.flock(descriptor, how | fcntl.LOCK_NB)
    except OSError:
        os.close(descriptor)
        return None
    return descriptor


def first_difference(before: Mapping[str, Any], now: Mapping[str, Any], within: str = "") -> str:
    """Return the first difference of two JSON objects in words; empty if they are equal.

    An example is ``meter.scale was 1 and is 2 now``; elements of lists count from 0. ``within`` is
    the name of the object that contains both: in ``meter``, ``scale`` is ``meter.scale``.
    """
    for name in [*before, *(name for name in now if name not in before)]:
        path = f"{within}.{name}" if within else name
        one, other = before.get(name), now.get(name)
        if isinstance(one, list) and isinstance(other, list):
            if len(one) != len(other):
                return f"{path} had {len(one)} elements and has {len(other)} now"
            one, other = (dict(zip(map(str, range(len(x))), x, strict=True)) for x in (one, other))
        if isinstance(one, Mapping) and isinstance(other, Mapping):
            if found := first_difference(one, other, path):
                return found
        elif one != other:
            return f"{path} was {_text_of(one)} and is {_text_of(other)} now"
    return ""


def _text_of(value: Any) -> str:
    return "left out" if value is None else f"{value!r:.80}"
