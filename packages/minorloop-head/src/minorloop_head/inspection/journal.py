"""The journal of an inspection or a sweep, from which it is resumed after an interruption.

It has a line for each step, view and scan of an inspection, and for each burst of a sweep.
"""

from __future__ import annotations

import json
import os
import reprlib
import time
import weakref
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, TypeAlias, TypeVar

import msgspec
import numpy as np

from minorloop.errors import OutputError, ParameterError, RecordError
from minorloop.files import first_difference, lock_path, new_folder, refusal, write_atomically

FINISHED = "finished"
NAME = "journal.jsonl"
_AGAIN = (
    "delete this line and all lines after it, so that they are measured again, or begin in a new "
    "folder"
)
Seconds = Annotated[float, msgspec.Meta(ge=0.0, le=1e9)]
Told: TypeAlias = Callable[..., None]
"""Called with a text on the progress, and ``kept=True`` with one that stays on the terminal."""


class Line(
    msgspec.Struct,
    kw_only=True,
    tag_field="what",
    tag=lambda name: name.removesuffix("Line").lower(),
):
    """A line: its kind is ``what``, the name of its class in lower case.

    A number that is not known is NaN or null.
    """

    t: Seconds
    """Seconds since the first line, without the time between an interruption and its resume."""


class BeginLine(Line):
    """The first line, which also describes the inspected pipe and the head."""

    began: str


class ResumeLine(Line):
    """Resume of an inspection or a sweep, with some views or bursts."""

    resumed: str
    views: int | msgspec.UnsetType = msgspec.UNSET
    bursts: int | msgspec.UnsetType = msgspec.UNSET


class EndLine(Line):
    """End: its reason, and whether the head has confirmed that it is safe."""

    why: str
    safe: bool | msgspec.UnsetType = msgspec.UNSET


_AnyLine = TypeVar("_AnyLine", bound=Line)


class Impossible(ValueError):
    """A value that a line cannot have, with its name and the allowed values."""

    def __init__(self, name: str, value: Any, allowed: str) -> None:
        super().__init__(name, value, allowed)
        self.name, self.value, self.allowed = name, value, allowed


def plain(value: Any) -> Any:
    """Return structures and arrays as objects and lists of JSON."""
    return msgspec.to_builtins(value, enc_hook=lambda array: array.tolist())


def converted(raw: Any, kind: Any) -> Any:
    """Return a value of JSON as a structure.

    Raises an `Impossible` if a value is of another kind, or beyond its bounds; a `ValueError` if a
    value is missing, or cannot be read.
    """
    try:
        return msgspec.convert(raw, kind, dec_hook=lambda _, value: np.array(value))
    except msgspec.ValidationError as error:
        expected, _, path = str(error).partition(" - at `$")
        if not expected.startswith("Expected"):
            raise
        allowed = expected.removeprefix("Expected ").replace("`", "").partition(", got")[0]
        for sign, word in ((">=", "at least"), ("<=", "at most")):
            allowed = allowed.replace(f"float {sign}", word).replace(f"int {sign}", word)
        raise Impossible(*_at(raw, path.removesuffix("`")), allowed) from None


@contextmanager
def refusing(where: str) -> Iterator[None]:
    """Refuse a line with an impossible value in one sentence, given its number and file.

    Raises a `RecordError`.
    """
    try:
        yield
    except Impossible as error:
        said = f"has {reprlib.repr(error.value)} as {error.name!r}, which must be {error.allowed}"
        raise RecordError(f"{where} {said}; {_AGAIN}") from None
    except (TypeError, ValueError) as error:
        raise RecordError(f"{where} is incomplete: {error}; {_AGAIN}") from None


def _at(raw: Any, path: str) -> tuple[str, Any]:
    """Return the last name on a path such as ``.pose.pan [deg]`` or ``.rim[1][0]``, and its value.

    Names may have spaces and brackets: they are compared with the keys of the line.
    """
    name = "line"
    while path:
        if path[0] == "[":
            number, _, path = path[1:].partition("]")
            raw = raw[int(number)]
        else:
            name = max((each for each in raw if path[1:].startswith(each)), key=len)
            raw, path = raw[name], path[1 + len(name) :]
    return name, raw


@dataclass(frozen=True)
class Before:
    """Lines of the journal of an interrupted inspection or sweep; empty for a new one."""

    file: Path = Path(NAME)
    raw: tuple[bytes, ...] = ()
    """Lines up to the first that is damaged."""
    lines: tuple[Line, ...] = ()
    damaged: int = 0
    """Number of the first damaged line, from 1; 0 without one."""

    @classmethod
    def of(cls, folder: Path, begun: Mapping[str, Any], what: str, kinds: Any) -> Before:
        """Return the lines of the journal in a folder.

        Raises a `RecordError` if there is no folder or no journal in it, or a line has an
        impossible value; a `ParameterError` if it is finished, or another one was begun.

        ``begun``: the pipe and the head to be inspected; ``what``: ``inspection`` or ``sweep``;
        ``kinds``: union of the kinds of its lines.
        """
        if not folder.is_dir():
            raise RecordError(
                f"there is no folder {folder}; give the folder of the interrupted {what}, or begin "
                "without --resume"
            )
        file = folder / NAME
        raw, every = _read(file)
        damaged = 1 + every.index(None) if None in every else 0
        sound = [line for line in every[: damaged - 1 if damaged else None] if line is not None]
        if not sound:
            raise _unreadable(file)
        if next(line for line in reversed(every) if line is not None).get("why") == FINISHED:
            raise ParameterError(
                f"the {what} in {folder} is finished; give another folder, without --resume"
            )
        other = first_difference({name: sound[0].get(name) for name in begun}, begun)
        if other:
            raise ParameterError(
                f"the {what} in {folder} is another one: {other}; resume it with its first "
                "options, or give another folder"
            )
        found = cls(file, tuple(raw[: len(sound)]), damaged=damaged)
        lines: list[Line] = []
        for number, line in enumerate(sound, 1):
            with refusing(found.where(number)):
                lines.append(converted(line, kinds))
        if not isinstance(lines[0], BeginLine):
            raise _unreadable(file)
        return cls(file, found.raw, tuple(lines), damaged)

    def where(self, number: int) -> str:
        """Return the number of a line and the file, for a message."""
        return f"line {number} of {self.file}"

    def each(self, kind: type[_AnyLine]) -> Iterator[tuple[str, _AnyLine]]:
        """Return the lines of a kind, each with its number and file."""
        for number, line in enumerate(self.lines, 1):
            if isinstance(line, kind):
                yield self.where(number), line

    def set_aside(self, kept: str) -> str:
        """Copy a damaged journal beside it; return a sentence on that and on the ``kept`` part."""
        copies = (self.file.with_name(f"journal.damaged{n or ''}.jsonl") for n in range(1000))
        copy = next(each for each in copies if not each.exists())
        write_atomically(copy, self.file.read_bytes())
        return (
            f"line {self.damaged} of {self.file} is damaged; kept before it: {kept}; the rest is "
            f"measured again, and the damaged journal is kept in {copy}"
        )


NEW = Before()
"""Lines of an inspection or a sweep that is not resumed."""


def _read(file: Path) -> tuple[list[bytes], list[dict[str, Any] | None]]:
    """Return the lines of a journal, and each as an object, None for a damaged line.

    An incomplete last line is left out; an unreadable journal has no lines.
    """
    try:
        *raw, rest = file.read_bytes().split(b"\n")
    except OSError:
        return [], []
    if _parsed(rest) is not None:
        raw.append(rest)
    return raw, [_parsed(line) for line in raw]


def _parsed(line: bytes) -> dict[str, Any] | None:
    with suppress(ValueError, RecursionError):
        found = json.loads(line)
        if isinstance(found, dict) and "what" in found:
            return found
    return None


def _unreadable(file: Path) -> RecordError:
    return RecordError(
        f"{file} is not the journal of an inspection or a sweep, or is damaged; give its {NAME}"
    )


class Journal:
    """Writer of a journal; each line is on the disk when its method returns.

    ``folder``: existing; ``begun``: the pipe and the head; ``before``: lines of an interrupted
    journal, which is continued; ``clock``: returns the time of the head in seconds: a simulated
    head runs slower or faster; ``**kept``: number of its kept views or bursts.

    Its ``began``: time of its first line.
    Its ``resumed``: times of its continuations.
    """

    def __init__(
        self,
        folder: Path,
        begun: Mapping[str, Any],
        before: Before = NEW,
        *,
        clock: Callable[[], float] = time.monotonic,
        **kept: int,
    ) -> None:
        # Release the lock also if an error leaves the journal open.
        self._unlock = weakref.finalize(self, os.close, _locked(folder))
        now = f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}"
        self._clock = clock
        self._began = clock() - max((line.t for line in before.lines), default=0.0)
        self.began, self.resumed = now, []
        # An incomplete last line is dropped.
        write_atomically(folder / NAME, b"".join(line + b"\n" for line in before.raw))
        self._file = (folder / NAME).open("ab", buffering=0)
        if before.lines:
            (self.began,) = (line.began for _, line in before.each(BeginLine))
            self.resumed = [*(line.resumed for _, line in before.each(ResumeLine)), now]
            self.note(ResumeLine, resumed=now, **kept)
        else:
            self._write({**plain(BeginLine(t=self.seconds(), began=now)), **begun})

    def note(self, kind: type[_AnyLine], **content: Any) -> _AnyLine:
        """Add a line of a kind, and return it.

        Raises an `OutputError` if it cannot be written, as on a full disk. The lines before stay as
        they are.
        """
        line = kind(t=self.seconds(), **content)
        self._write(plain(line))
        return line

    def _write(self, line: dict[str, Any]) -> None:
        data, size = f"{json.dumps(line)}\n".encode(), os.fstat(self._file.fileno()).st_size
        try:
            while data:
                data = data[self._file.write(data) :]
            os.fsync(self._file.fileno())
        except OSError as error:
            with suppress(OSError):
                self._file.truncate(size)
            raise refusal(Path(self._file.name), error) from None

    def seconds(self) -> float:
        """Return the seconds of its clock since its first line."""
        return round(self._clock() - self._began, 2)

    def close(self) -> None:
        """End it."""
        self._file.close()
        self._unlock()


def _locked(folder: Path) -> int:
    """Return a lock that keeps other programs from writing a journal in a folder."""
    found = lock_path(folder)
    if found is None:
        raise OutputError(
            f"another program writes to {folder}; wait until it has ended, or give another folder"
        )
    return found


def folder_for(out: Path, *, resume: bool) -> Any:
    """Return a context of the folder of results: a new folder, or the one to resume."""
    return nullcontext(out) if resume else new_folder(out)


def go_on(folder: Path) -> str:
    """Return advice after a folder could not be written."""
    return (
        f"earlier results are kept in {folder}; the same command with --resume goes on from there"
    )


def untold(text: str, *, kept: bool = False) -> None:
    """Ignore a text on the progress."""
