import asyncio
import errno
import tempfile
import time
from pathlib import Path

import pytest

from minorloop.page import uploads
from minorloop.page.lab import LabPage
from minorloop.page.uploads import FullError, Quota, Uploads

MIB = 1024**2
QUOTA = Quota(disk=30 * MIB + 1000, files=4, file=8 * MIB)


@pytest.fixture(autouse=True)
def scratch(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def kept(work, quota=QUOTA, folder=None):
    """The result of some work with started uploads."""

    async def run():
        found = Uploads(quota, folder)
        await found.start()
        try:
            return await work(found)
        finally:
            await found.stop()

    return asyncio.run(run())


async def chunks(*parts):
    for part in parts:
        yield part


def test_uploads_are_kept_and_removed_with_the_server(scratch):
    async def work(found):
        upload = await found.add("run.csv", 7)
        await found.write(upload, chunks(b"abc", b"defg"))
        assert found.find(upload.key) is upload
        return (upload.folder / "run.csv").read_bytes(), upload.length

    assert kept(work) == (b"abcdefg", 7)
    assert list(scratch.iterdir()) == []


def test_a_relative_folder_holds_uploads_for_workers_elsewhere(scratch, monkeypatch):
    async def work(found):
        return (await found.add("run.csv", 7)).folder

    monkeypatch.chdir(scratch)
    assert kept(work, folder=Path(".")).is_relative_to(scratch)


def test_unfinished_uploads_count(monkeypatch):
    async def work(found):
        await found.add("one.csv", 8 * MIB)
        with pytest.raises(FullError, match=r"at most 4 files and 30 MiB"):
            await found.add("two.csv", 8 * MIB)

    kept(work)


def test_results_count_as_large_as_a_worker_may_write_them(scratch):
    async def work(found):
        return (await found.add("run.csv", 7)).size

    assert kept(work) == 7 + 3 * QUOTA.result
    page = LabPage(workers=1, quota=QUOTA)
    for pool in (page._workers, page._quick):
        assert (pool._work.file, pool._work.memory) == (QUOTA.result, QUOTA.memory)


def test_unused_uploads_make_room(monkeypatch):
    async def work(found):
        used, idle = [await found.add(f"{k}.csv", 10) for k in range(2)]
        with used.in_use():
            now = time.monotonic()
            monkeypatch.setattr(uploads.time, "monotonic", lambda: now + QUOTA.spared + 1.0)
            fresh = [await found.add(f"{k}.csv", 10) for k in range(3)]
            there = [found.find(each.key) is not None for each in (used, idle, *fresh)]
            assert not idle.folder.exists()
        return there

    assert kept(work) == [True, False, True, True, True]


def test_old_uploads_are_removed(monkeypatch):
    async def work(found):
        upload = await found.add("one.csv", 10)
        await found.remove_old()
        assert found.find(upload.key) is upload
        now = time.monotonic()
        monkeypatch.setattr(uploads.time, "monotonic", lambda: now + QUOTA.kept + 1.0)
        expiring = asyncio.create_task(found.expire(every=0.0))
        async with asyncio.timeout(20.0):
            while upload.folder.exists():
                await asyncio.sleep(0)
        expiring.cancel()
        return found.find(upload.key)

    assert kept(work) is None


class FullDisk:
    """A file on a disk without room."""

    def __init__(self, path):
        self._file = path.open("xb")

    def write(self, content):
        self._file.write(content[:5])
        raise OSError(errno.ENOSPC, "No space left on device")

    def close(self):
        self._file.close()


def test_a_full_disk_is_reported(monkeypatch):
    monkeypatch.setattr(uploads, "_opened", FullDisk)

    async def work(found):
        upload = await found.add("run.csv", 10)
        with pytest.raises(FullError, match="its disk is full; nothing of it was kept"):
            await found.write(upload, chunks(b"0123456789"))

    kept(work)
