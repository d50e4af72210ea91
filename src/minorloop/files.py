"""Writing files: never over something that exists, never half a file.

A place is checked before a long computation, and written in one move after it: the bytes go
to a temporary file beside the target, which then takes its name.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeAlias

from minorloop.errors import OutputError

PathLike: TypeAlias = str | os.PathLike[str]


def check_writable(path: PathLike, *, force: bool = False) -> Path:
    """Give a path back when a file can be written there; refuse it otherwise.

    Parameters
    ----------
    path : str or path
        The file that is going to be written.
    force : bool
        Whether a file that exists may be replaced.

    Returns
    -------
    Path

    Raises
    ------
    OutputError
        If the path is a folder or a device, its folder is missing or closed to writing, or
        the file exists and ``force`` is false.
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
        raise _refusal(target, error) from None
    return target


def write_atomically(path: PathLike, content: str | bytes) -> None:
    """Write a whole file at once, replacing what is there.

    A reader sees the old file or the new one, never a part, and a failure leaves the old one.

    Parameters
    ----------
    path : str or path
        The file to write.
    content : str or bytes
        What goes in; text is written as UTF-8 with its line ends as they are.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    target = Path(os.path.realpath(_named(path)))
    data = content.encode() if isinstance(content, str) else content
    scratch = target.with_name(f".minorloop-{os.urandom(6).hex()}.tmp")
    try:
        with open(scratch, "xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(scratch, target)
    except OSError as error:
        raise _refusal(target, error) from None
    finally:
        with suppress(OSError):
            scratch.unlink(missing_ok=True)


def make_folder(path: PathLike, *, force: bool = False) -> Path:
    """Make a folder for results, or accept one that is there and empty.

    Parameters
    ----------
    path : str or path
        The folder; missing parents are made too.
    force : bool
        Whether it may hold files already, of which some are going to be replaced.

    Returns
    -------
    Path

    Raises
    ------
    OutputError
        If the path is a file, the folder is not empty, or it cannot be made.
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
        raise _refusal(folder, error) from None
    return folder


def _named(path: PathLike) -> Path:
    """The path, unless no file could have it as its name."""
    if "\0" in os.fspath(path):
        raise OutputError(f"{os.fspath(path)!r} cannot be written: it is not the name of a file")
    return Path(path)


def _refusal(path: Path, error: OSError) -> OutputError:
    """The error to raise for a place where the system says no."""
    if isinstance(error, OutputError):
        return error
    return OutputError(f"{path} cannot be written: {error.strerror or error}")


def first_difference(before: Mapping[str, Any], now: Mapping[str, Any], within: str = "") -> str:
    """The first thing in which two descriptions differ, in words; empty if they are the same.

    Parameters
    ----------
    before, now : mapping
        As JSON gives them, one in another to any depth.
    within : str
        What they are part of: ``meter`` makes a ``scale`` a ``meter.scale``.

    Returns
    -------
    str
        Such as ``meter.scale was 1 and is 2 now``.
    """
    for name in [*before, *(name for name in now if name not in before)]:
        path = f"{within}.{name}" if within else name
        one, other = before.get(name), now.get(name)
        if isinstance(one, Mapping) and isinstance(other, Mapping):
            if found := first_difference(one, other, path):
                return found
        elif one != other:
            return f"{path} was {_said(one)} and is {_said(other)} now"
    return ""


def _said(value: Any) -> str:
    return "left out" if value is None else f"{value!r:.80}"
