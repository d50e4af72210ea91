"""Recorded sessions: the messages to the pages, in order, each with its time.

A recording is ``MAGIC``, then entries: kind (1 byte), time in s (8 bytes), length (4 bytes), all
little-endian, and as many bytes. Entries are written without a buffer, so that they survive the end
of the process. An entry that was cut short is ignored on reading.
"""

from __future__ import annotations

import errno
import os
import queue
import struct
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

from minorloop.errors import RecordError

MAGIC = b"minorloop session 1\n"
SUFFIX = ".session"
TEXT, PICTURE = 0, 1
_ENTRY = struct.Struct("<Bdl")
_LONGEST = 1 << 24
"""Largest size of an entry in bytes; a file with a larger one counts as damaged."""
MOST_UNWRITTEN = 20_000
"""Most entries of a recording that wait for the disk: some ten minutes."""


class Recorder:
    """Writes a recording.

    ``folder``: created if it does not exist; ``name``: of the file, without its suffix. Raises
    an `OSError` if it cannot be written, or the recording exists.
    """

    def __init__(self, folder: Path, name: str) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.path = folder / f"{name}{SUFFIX}"
        self._file: BinaryIO = self.path.open("xb", buffering=0)
        self.began, self.size = time.monotonic(), 0
        try:
            self._put(MAGIC)
        except OSError:
            self._file.close()
            self.path.unlink(missing_ok=True)
            raise

    def write(self, kind: int, t: float, content: bytes) -> None:
        """Add an entry.

        Raises an `OSError` if the disk has no room for the whole entry; none of it remains then.
        """
        self._put(_ENTRY.pack(kind, t, len(content)) + content)

    @property
    def closed(self) -> bool:
        """Whether it has ended."""
        return self._file.closed

    def close(self) -> None:
        """End the recording."""
        self._file.close()

    def _put(self, content: bytes) -> None:
        """Write all or nothing: a disk that becomes full may have written a part."""
        if self._file.write(content) < len(content):
            self._file.truncate(self.size)
            self._file.seek(self.size)
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self.size += len(content)


class SessionRecording:
    """Recordings one after the other; only `write` and `close` wait for the disk.

    Its ``recorder``: of the present recording. ``folder``: of the recordings; ``ended``: called in
    any thread with the message on a recording that ended because of the disk.
    """

    def __init__(self, folder: Path, ended: Callable[[str], None]) -> None:
        self._folder, self._ended = folder, ended
        self._unwritten: queue.Queue[tuple[Recorder, tuple[int, float, bytes] | None]]
        self._unwritten = queue.Queue()
        self.recorder: Recorder | None = None

    def begin(self, name: str) -> None:
        """Begin a recording.

        Raises an `OSError` as `Recorder` does.
        """
        self.recorder = Recorder(self._folder, name)

    def keep(self, kind: int, t: float, content: bytes) -> None:
        """Queue an entry, in any thread, if a recording is on."""
        recorder = self.recorder
        if recorder is None:
            return
        if self._unwritten.qsize() > MOST_UNWRITTEN:
            self.end()
            self._ended("the disk is too slow; recording ended")
        else:
            self._unwritten.put((recorder, (kind, t, content)))

    def end(self) -> None:
        """End the recording; queued entries are still written."""
        recorder, self.recorder = self.recorder, None
        if recorder is not None:
            self._unwritten.put((recorder, None))

    def write(self) -> None:
        """Write queued entries forever, in a separate thread."""
        while True:
            recorder, entry = self._unwritten.get()
            try:
                if entry is None:
                    recorder.close()
                elif not recorder.closed:  # an entry may be queued while its recording ends
                    recorder.write(*entry)
            except OSError as error:
                recorder.close()
                self.recorder = None if self.recorder is recorder else self.recorder
                self._ended(f"recording ended: {error}")
            finally:
                self._unwritten.task_done()

    def close(self, patience: float) -> None:
        """End the recording, and wait up to ``patience`` seconds until it is written."""
        self.end()
        done = self._unwritten.all_tasks_done
        with done:
            done.wait_for(lambda: not self._unwritten.unfinished_tasks, patience)


def entries(path: Path) -> Iterator[tuple[int, float, bytes]]:
    """Yield kind, time and content of each entry.

    Raises a `RecordError` if it is not a recording.
    """
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise RecordError(f"{path.name} is not a recorded session; give one of the console")
        while len(head := file.read(_ENTRY.size)) == _ENTRY.size:
            kind, t, size = _ENTRY.unpack(head)
            if not 0 <= size <= _LONGEST or kind not in (TEXT, PICTURE):
                raise RecordError(f"{path.name} is damaged after {t:.2f} s")
            content = file.read(size)
            if len(content) < size:
                return
            yield kind, t, content


def listed(folder: Path) -> list[str]:
    """Return the names of the recordings in a folder, the newest first."""
    if not folder.is_dir():
        return []
    files = sorted(folder.glob(f"*{SUFFIX}"), key=lambda p: p.stat().st_mtime, reverse=True)
    return [path.stem for path in files if _is_recording(path)]


def _is_recording(path: Path) -> bool:
    """Return whether a file begins like a recording; the folder may hold others."""
    try:
        with path.open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC
    except OSError:
        return False
