"""Files that were dropped on the lab page: a folder each, a quota for all, and none for ever.

What is still on its way counts as what is there. The folder of all is locked while its server
runs; the next one removes those that nobody locks, so that a server that was killed leaves none.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
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

PREFIX = "minorloop-lab-"
_LOCK = ".lock"
_AT_ONCE = 1 << 18
_RESULTS = 8 * 1024**2
"""Bytes that are kept for the model, the report and the inputs of a file."""
_T = TypeVar("_T")


class FullError(OutputError):
    """There is no room for a file now."""


@dataclass(frozen=True, kw_only=True)
class Quota:
    """What files may take.

    Parameters
    ----------
    file : int
        Bytes of a file.
    disk : int
        Bytes of all, with what is kept for their results.
    files : int
        Number of all.
    small : int
        Bytes up to which a file is small; large ones leave a part of the disk and of the
        number to small ones, and do not hold them up.
    large : int
        Large files that are received, read or identified at the same time.
    kept : float
        Seconds without use after which a file is removed.
    spared : float
        Seconds without use before which a file is not removed for another one.
    """

    file: int = 32 * 1024**2
    disk: int = 1024**3
    files: int = 64
    small: int = 1024**2
    large: int = 16
    kept: float = 4 * 3600.0
    spared: float = 60.0


@dataclass(eq=False)
class Upload:
    """A file that was dropped, and what became of it."""

    key: str
    folder: Path
    name: str
    length: int
    used: float = field(default_factory=time.monotonic)
    users: int = 0

    @property
    def size(self) -> int:
        """Bytes that it takes, with its results."""
        return self.length + _RESULTS

    @contextlib.contextmanager
    def in_use(self) -> Iterator[None]:
        """While something works with it, it is not removed for another."""
        self.users += 1
        try:
            yield
        finally:
            self.users -= 1
            self.used = time.monotonic()


class Uploads:
    """The files, in a folder that goes with the server.

    Parameters
    ----------
    quota : Quota
    """

    def __init__(self, quota: Quota) -> None:
        self.quota = quota
        self._all: dict[str, Upload] = {}
        self._going: set[Upload] = set()
        # Disks may make who writes wait for seconds; nobody else is to wait with them.
        self._disk = ThreadPoolExecutor(2, thread_name_prefix="uploads")

    async def start(self) -> None:
        """Remove what servers that were killed have left, and make the folder."""
        await self._on_disk(remove_orphans)
        self.root, self._lock = await self._on_disk(_locked_folder)

    async def stop(self) -> None:
        """Remove the folder."""
        await self._on_disk(_remove, self.root)
        _unlock(self._lock)
        self._disk.shutdown(wait=False)

    async def expire(self, every: float = 60.0) -> None:
        """Remove what was not used for long, for ever."""
        while True:
            await asyncio.sleep(every)
            await self.remove_old()

    async def remove_old(self) -> None:
        """Remove what was not used for long."""
        before = time.monotonic() - self.quota.kept
        for upload in [each for each in self._all.values() if _idle(each, before)]:
            await self.remove(upload)

    async def add(self, name: str, size: int) -> Upload:
        """Take in a file that is going to have a size.

        Raises
        ------
        FullError
            If there is no room, and none can be made of what nobody uses.
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
        upload = Upload(key, self.root / key, name, size)
        self._all[key] = upload
        try:
            await self._on_disk(upload.folder.mkdir)
        except OSError as error:
            await self.remove(upload)
            raise _refusal(error) from None
        return upload

    async def write(self, upload: Upload, chunks: AsyncIterator[bytes]) -> None:
        """Write the content of a file as it comes.

        Raises
        ------
        FullError
            If the disk has no room for it.
        """
        file: BinaryIO | None = None
        held = bytearray()
        written = 0
        try:
            file = await self._on_disk(_opened, upload.folder / upload.name)
            async for chunk in chunks:
                held += chunk
                if len(held) >= _AT_ONCE:
                    written += await self._on_disk(file.write, bytes(held))
                    held.clear()
            written += await self._on_disk(file.write, bytes(held))
            upload.length = written
            await self._on_disk(file.close)
        except OSError as error:
            raise _refusal(error) from None
        finally:
            if file is not None:
                with contextlib.suppress(OSError):  # what it holds cannot be written
                    await self._on_disk(file.close)

    def find(self, key: str) -> Upload | None:
        """A file by its key."""
        return self._all.get(key)

    async def remove(self, upload: Upload) -> None:
        """Remove a file; what it took is free when it is gone."""
        self._all.pop(upload.key, None)
        self._going.add(upload)
        try:
            await self._on_disk(_remove, upload.folder)
        finally:
            self._going.discard(upload)

    def _has_room(self, size: int) -> bool:
        quota, there = self.quota, [*self._all.values(), *self._going]
        taken, count = sum(each.size for each in there), len(there)
        share = 1.0 if size <= quota.small else 0.75
        return taken + size + _RESULTS <= share * quota.disk and count < share * quota.files

    async def _on_disk(self, work: Callable[..., _T], *options: Any) -> _T:
        return await asyncio.get_running_loop().run_in_executor(self._disk, work, *options)


def remove_orphans() -> None:
    """Remove the folders of servers that run no more; only ours, and only where that is known."""
    for folder in Path(tempfile.gettempdir()).glob(f"{PREFIX}*"):
        with contextlib.suppress(OSError):
            lock = _lock(folder) if _is_ours(folder) else None
            if lock is not None:
                _remove(folder)
                _unlock(lock)


def _idle(upload: Upload, before: float) -> bool:
    return upload.users == 0 and upload.used < before


def _opened(path: Path) -> BinaryIO:
    return path.open("xb")


def _locked_folder() -> tuple[Path, int | None]:
    while True:
        root = Path(tempfile.mkdtemp(prefix=PREFIX))
        if not hasattr(os, "getuid"):
            return root, None
        with contextlib.suppress(FileNotFoundError):
            lock = _lock(root)
            if lock is not None and (root / _LOCK).exists():
                return root, lock
            _unlock(lock)  # another server that starts took the folder for an old one


def _is_ours(folder: Path) -> bool:
    """Whether a folder was made by this user; where there are no users, none is removed."""
    if not hasattr(os, "getuid"):
        return False
    return not folder.is_symlink() and folder.stat().st_uid == os.getuid()


def _lock(folder: Path) -> int | None:
    """The lock of a folder, or nothing where somebody has it or there are no locks."""
    import fcntl

    lock = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(lock)
        return None
    return lock


def _unlock(lock: int | None) -> None:
    if lock is not None:
        os.close(lock)


def _remove(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)


def _refusal(error: OSError) -> FullError:
    full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
    reason = "its disk is full" if full else error.strerror or "it cannot be written"
    return FullError(f"the console cannot keep this file: {reason}; nothing of it was kept")
