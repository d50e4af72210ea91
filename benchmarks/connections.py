"""The console under a flood of connections without a key, and of large uploads.

A console on this machine, limited to 1,024 files, with a pilot who steers. The flood comes from
another process with many addresses of this machine. It represents other machines, and so has a
lower priority than the console. Each part takes at most two minutes.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import resource
import selectors
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks._console import Page, Server, piloted
from benchmarks._timing import Row

FILES = 1024
CONNECTIONS = 2000
UPLOADS, MEGABYTES = 100, 30
MEMORY, DISK = 500.0, 1024.0
KINDS = ("silent", "slow header", "websocket", "no key")
_FLOOD = 20.0
_UPLOADING = 120.0


def rows(quick: bool) -> list[Row]:
    """Measure, and return the rows of the report."""
    with (
        limited_files(FILES),
        tempfile.TemporaryDirectory() as folder,
        open(f"{folder}/messages", "w+") as messages,
    ):
        before = _labs()
        with Server(folder, messages=messages) as server:
            (root,) = _labs() - before
            drop(server, table(12_000))  # so that the workers have started
            found = asyncio.run(_flooded(server, 200 if quick else CONNECTIONS))
            found += uploaded(server, root, 8 if quick else UPLOADS, MEGABYTES)
        messages.seek(0)
        lines = len(messages.readlines())
        return [*found, _log_row(lines)]


def _log_row(lines: int) -> Row:
    what = "log messages of the console about flood and uploads"
    return Row(
        what, 0.0, required="< 100 lines", met=lines < 100, accuracy=f"{lines} lines of messages"
    )


@contextlib.contextmanager
def limited_files(most: int) -> Iterator[None]:
    """Limit the open files of the processes that are started in the block."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


async def _flooded(server: Server, count: int) -> list[Row]:
    """Measure a pilot without and then with the flood."""
    async with piloted(server) as pilot:
        await asyncio.sleep(3.0)
        await _watched(pilot, lambda: asyncio.sleep(_FLOOD / 2))
        calm = _Course.of(pilot)
        results: list[dict] = []

        async def flood() -> None:
            command = [sys.executable, "-m", "benchmarks.connections", server.host, str(count)]
            child = await asyncio.create_subprocess_exec(*command, stdout=subprocess.PIPE)
            try:
                await _newcomer(server)
                answer, _ = await asyncio.wait_for(child.communicate(), 4 * _FLOOD)
                results.append(json.loads(answer))
            finally:
                if child.returncode is None:
                    child.kill()

        await _watched(pilot, flood)
        under = _Course.of(pilot)
    return [
        Row(
            f"ticks over 10 ms late, {count} connections in {_FLOOD:g} s",
            under.latest,
            required="<= 0.1 %",
            met=under.late <= 1e-3,
            accuracy=f"{under.late:.2%} of {under.ticks}; {calm.late:.2%} before; {results[0]}",
        ),
        Row(
            "longest time without a state, under the flood",
            under.gap,
            required="no HOLD",
            met=under.holds == 0,
            accuracy=f"{under.holds} states in HOLD; {calm.gap * 1e3:.0f} ms, {calm.holds} before",
        ),
    ]


async def _newcomer(server: Server) -> None:
    """Somebody with the key comes in the midst of the flood."""
    await asyncio.sleep(_FLOOD / 4)
    async with asyncio.timeout(10.0), server.connect() as socket_:
        page = Page(socket_)
        listening = asyncio.create_task(page.listen())
        await page.until(lambda: page.state)
        listening.cancel()


async def _watched(pilot: Page, meanwhile) -> None:
    pilot.late.clear(), pilot.states.clear()
    await meanwhile()


@dataclass(frozen=True)
class _Course:
    """What a pilot saw."""

    late: float
    latest: float
    ticks: int
    gap: float
    holds: int

    @classmethod
    def of(cls, pilot: Page) -> _Course:
        late = np.array(pilot.late)
        times = np.array(pilot.state_times[-len(late) :])
        return cls(
            late=float(np.mean(late > 10.0)),
            latest=float(late.max()) / 1e3,
            ticks=late.size,
            gap=float(np.diff(times).max()),
            holds=sum(state["mode"] != "HEAD" for state in pilot.states),
        )


def flood(host: str, count: int, seconds: float = _FLOOD) -> Counter[str]:
    """Open connections without a key, keep them as long as the server does, and open others.

    Half of them come at once and the rest over the time; each kind of ``KINDS`` is a quarter.
    """
    address, port = host.rsplit(":", 1)
    counts: Counter[str] = Counter()
    open_: dict[socket.socket, int] = {}
    waiting = selectors.DefaultSelector()
    began = time.monotonic()
    opened, trickled = 0, began
    while (now := time.monotonic()) < began + seconds:
        due = count // 2 + int(count / 2 * min((now - began) / (0.8 * seconds), 1.0))
        for _ in range(min(due - opened, 50)):
            with contextlib.suppress(OSError):
                one = _stranger(address, int(port), opened)
                waiting.register(one, selectors.EVENT_READ)
                open_[one] = opened % len(KINDS)
            opened += 1
        if now > trickled + 0.2:
            trickled = now
            for one in [each for each, kind in open_.items() if kind == 1]:
                with contextlib.suppress(OSError):
                    one.send(b"X")
        for key, _ in waiting.select(0.01):
            one = key.fileobj
            try:
                more = one.recv(4096)
            except OSError:
                more = b""
            if not more:
                counts["closed by the server"] += 1
                waiting.unregister(one)
                del open_[one]
                one.close()
    counts["opened"], counts["left open"] = opened, len(open_)
    for one in open_:
        one.close()
    return counts


def _stranger(address: str, port: int, number: int) -> socket.socket:
    """A connection of one of the kinds, from one of many addresses."""
    one = socket.socket()
    one.settimeout(0.5)
    with contextlib.suppress(OSError):  # systems other than Linux have one address
        one.bind((f"127.0.{1 + number % 50}.{1 + number // 50 % 200}", 0))
    one.connect((address, port))
    kind = KINDS[number % len(KINDS)]
    host = f"Host: {address}:{port}\r\n"
    if kind == "slow header":
        one.sendall(f"GET / HTTP/1.1\r\n{host}X-Slow: ".encode())
    elif kind == "websocket":
        upgrade = "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
        key = "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
        origin = f"Origin: http://{address}:{port}\r\n"
        one.sendall(f"GET /ws HTTP/1.1\r\n{host}{origin}{upgrade}{key}\r\n".encode())
    elif kind == "no key":
        one.sendall(f"GET / HTTP/1.1\r\n{host}\r\n".encode())
    return one


def uploaded(server: Server, root: Path, count: int, megabytes: int) -> list[Row]:
    """Large files at once, and a small one among them."""
    large = table(megabytes * 10**6)
    statuses: Counter[int | str] = Counter()
    threads = [
        threading.Thread(target=_upload, args=(server, large, statuses), daemon=True)
        for _ in range(count)
    ]
    idle = server.serving(), server.memory()
    peaks = np.zeros(3)
    answers: list[float] = []
    began = time.monotonic()
    for thread in threads:
        thread.start()
    small = threading.Thread(target=_small, args=(server, answers), daemon=True)
    small.start()
    while any(each.is_alive() for each in (*threads, small)):
        if time.monotonic() > began + _UPLOADING:
            break
        peaks = np.maximum(peaks, (server.serving(), server.memory(), on_disk(root)))
        time.sleep(0.1)
    statuses["not answered yet"] = sum(each.is_alive() for each in threads)
    said = ", ".join(f"{number} x {status}" for status, number in statuses.items() if number)
    shape = f"{count} uploads of {megabytes} MB"
    worst = max(answers, default=float("inf"))
    return [
        Row(
            f"{shape}: a 12 kB file among them, the slowest of {len(answers)}",
            worst,
            required="<= 5 s",
            met=worst <= 5.0,
            accuracy=f"answers to the large ones: {said}",
        ),
        Row(
            f"{shape}: memory",
            time.monotonic() - began,
            required=f"<= {MEMORY:.0f} MB",
            met=bool(peaks[0] * 1.048576 <= MEMORY),
            accuracy=(
                f"server {peaks[0]:.0f} MiB (idle {idle[0]:.0f}); with all its processes "
                f"{peaks[1]:.0f} MiB (idle {idle[1]:.0f})"
            ),
        ),
        Row(
            f"{shape}: disk",
            time.monotonic() - began,
            required=f"<= {DISK:.0f} MiB",
            met=bool(peaks[2] <= DISK),
            accuracy=f"{peaks[2]:.0f} MiB at most",
        ),
    ]


def table(size: int) -> bytes:
    """A record of so many bytes."""
    rng = np.random.default_rng(0)
    u = rng.uniform(0.1, 1.0, 500)
    lines = [f"{k / 200:.6g},{x:.17f},{x * x:.17f},{x / 3:.17f}\n" for k, x in enumerate(u)]
    block = "".join(lines)
    text = "time [s],voltage [V],length [um],force [N]\n" + block * (1 + size // len(block))
    return text[:size].rsplit("\n", 1)[0].encode() + b"\n"


def _labs() -> set[Path]:
    """Folders in which labs keep their files."""
    place = Path(tempfile.gettempdir())
    return {*place.glob("minorloop-lab-*"), *place.glob("minorloop-*/minorloop-lab-*")}


def drop(server: Server, content: bytes) -> tuple[int, dict]:
    """The answer to a file."""
    answer = server.ask("POST", "/api/lab?name=run.csv", content)
    return answer.status, json.loads(answer.read())


def _upload(server: Server, content: bytes, statuses: Counter[int | str]) -> None:
    try:
        statuses[drop(server, content)[0]] += 1
    except OSError as error:
        statuses[type(error).__name__] += 1


def _small(server: Server, answers: list[float]) -> None:
    """A small file again and again, while large ones are on their way."""
    for _ in range(5):
        time.sleep(1.0)
        began = time.monotonic()
        status, found = drop(server, table(12_000))
        answers.append(time.monotonic() - began if status == 200 else float("inf"))
        assert status != 200 or len(found["columns"]) == 4


def on_disk(root: Path) -> float:
    """Bytes of the files of the lab, in MiB."""
    total = 0
    for file in root.rglob("*"):
        with contextlib.suppress(OSError):
            total += file.stat().st_size
    return total / 2**20


if __name__ == "__main__":
    with contextlib.suppress(OSError, AttributeError):
        os.nice(10)
    with contextlib.suppress(ValueError):
        resource.setrlimit(resource.RLIMIT_NOFILE, (8192, 8192))
    print(json.dumps(flood(sys.argv[1], int(sys.argv[2]))))
