"""Uploads of the lab page: a folder for each file, a quota for all, and a limited time.

Unfinished uploads count with their full size.
"""

import asyncio
import contextlib
import errno
import secrets
import shutil
import tempfile
import time
from collections.abc import AsyncIterator, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

from minorloop.errors import OutputError

_PREFIX = "minorloop-lab-"
MODEL, REPORT, INPUTS = RESULTS = "model.json", "report.html", "inputs.csv"
"""Names of results in the folder of a file."""
_BLOCK = 1 << 18
"""Bytes of a block to write."""
_T = TypeVar("_T")


class FullError(OutputError):
    """There is no room for a file at present."""


@dataclass(frozen=True, kw_only=True)
class Quota:
    """Limits of uploads."""

    file: int = 32 * 1024**2
    """Most bytes of a file."""
    disk: int = 1024**3
    """Most bytes of all files, with the bytes reserved for their results."""
    files: int = 64
    """Most files."""
    result: int = 5 * 1024**2 // 2
    """Most bytes of each result of a file; a worker cannot exceed it."""
    memory: int = 2 * 1024**3
    """Most bytes of memory of each worker; it cannot exceed it."""
    kept: float = 4 * 3600.0
    """Seconds without use after which a file is removed."""
    spared: float = 60.0
    """Seconds without use after which a file may be removed to make room."""


@dataclass(eq=False)
class Upload:
    """An uploaded file and its results."""

    key: str
    folder: Path
    name: str
    length: int
    reserved: int
    used: float = field(default_factory=time.monotonic)
    users: int = 0

    @property
    def size(self) -> int:
        """Bytes of the file, with those reserved for its results."""
        return self.length + self.reserved

    @contextlib.contextmanager
    def in_use(self) -> Iterator[None]:
        """Context in which the file is not removed."""
        self.users += 1
        try:
            yield
        finally:
            self.users -= 1
            self.used = time.monotonic()


class Uploads:
    """All uploads, in a folder that is removed with the server.

    It is made in ``folder``, by default in the system's folder for temporary files.
    """

    def __init__(self, quota: Quota, folder: Path | None = None) -> None:
        self.quota, self._folder = quota, folder
        self._reserved = len(RESULTS) * quota.result
        self._all: dict[str, Upload] = {}
        self._leaving: set[Upload] = set()
        # A disk may take seconds to write; the event loop must not wait for it.
        self._disk = ThreadPoolExecutor(2, thread_name_prefix="uploads")

    async def start(self) -> None:
        """Make the folder."""
        made = await self._on_disk(tempfile.mkdtemp, None, _PREFIX, self._folder)
        self.root = Path(made).absolute()  # workers have other working folders

    async def stop(self) -> None:
        """Remove the folder."""
        await self._on_disk(_remove, self.root)
        self._disk.shutdown(wait=False)

    async def expire(self, every: float = 60.0) -> None:
        """Remove unused files, without end."""
        while True:
            await asyncio.sleep(every)
            await self.remove_old()

    async def remove_old(self) -> None:
        """Remove files that were not used for a long time."""
        before = time.monotonic() - self.quota.kept
        for upload in [each for each in self._all.values() if _idle(each, before)]:
            await self.remove(upload)

    async def add(self, name: str, size: int) -> Upload:
        """Register a file of a size.

        Raises a `FullError` if there is no room, and no unused file can be removed.
        """
        while not self._has_room(size):
            before = time.monotonic() - self.quota.spared
            idle = [each for each in self._all.values() if _idle(each, before)]
            if not idle:
                raise FullError(
                    f"the lab has no room for this file now: it keeps at most {self.quota.files} "
                    f"files and {self.quota.disk >> 20} MiB; try again in a minute"
                )
            await self.remove(min(idle, key=lambda each: each.used))
        key = secrets.token_urlsafe(16)
        upload = Upload(key, self.root / key, name, size, self._reserved)
        self._all[key] = upload
        try:
            await self._on_disk(upload.folder.mkdir)
        except OSError as error:
            await self.remove(upload)
            raise _refusal(error) from None
        return upload

    async def write(self, upload: Upload, chunks: AsyncIterator[bytes]) -> None:
        """Write the content of a file in blocks.

        Raises a `FullError` if the disk has no room for it.
        """
        file: BinaryIO | None = None
        held = bytearray()
        written = 0
        try:
            file = await self._on_disk(_opened, upload.folder / upload.name)
            async for chunk in chunks:
                held += chunk
                if len(held) >= _BLOCK:
                    written += await self._on_disk(file.write, bytes(held))
                    held.clear()
            written += await self._on_disk(file.write, bytes(held))
            upload.length = written
            await self._on_disk(file.close)
        except OSError as error:
            raise _refusal(error) from None
        finally:
            if file is not None:
                with contextlib.suppress(OSError):  # its buffer cannot be written
                    await self._on_disk(file.close)

    def find(self, key: str) -> Upload | None:
        """Return a file by its key."""
        return self._all.get(key)

    async def remove(self, upload: Upload) -> None:
        """Remove a file; its bytes are free once it is deleted."""
        self._all.pop(upload.key, None)
        self._leaving.add(upload)
        try:
            await self._on_disk(_remove, upload.folder)
        finally:
            self._leaving.discard(upload)

    def _has_room(self, size: int) -> bool:
        quota, counted = self.quota, [*self._all.values(), *self._leaving]
        taken, count = sum(each.size for each in counted), len(counted)
        return taken + size + self._reserved <= quota.disk and count < quota.files

    async def _on_disk(self, work: Callable[..., _T], *options: Any) -> _T:
        return await asyncio.get_running_loop().run_in_executor(self._disk, work, *options)


def _idle(upload: Upload, before: float) -> bool:
    return upload.users == 0 and upload.used < before


def _opened(path: Path) -> BinaryIO:
    return path.open("xb")


def _remove(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)


def _refusal(error: OSError) -> FullError:
    full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
    reason = "its disk is full" if full else error.strerror or "it cannot be written"
    return FullError(f"the server cannot keep this file: {reason}; nothing of it was kept")
