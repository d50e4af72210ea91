"""A console for benchmarks, and pages over real sockets."""

from __future__ import annotations

import asyncio
import contextlib
import http.client
import json
import os
import re
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Container
from pathlib import Path
from typing import IO

DRIVE = {"pose": [0, 0, 0, 1], "age": 0.0, "stick": [0, 0], "clutch": False}
_PAGE_SIZE = os.sysconf("SC_PAGE_SIZE")


class Server:
    """A running console, and the cookie of a browser that has sent the key."""

    def __init__(self, folder: str, *options: str, messages: IO[str] | None = None) -> None:
        command = [sys.executable, "-u", "-m", "minorloop", "console", "--port", "0"]
        self.process = subprocess.Popen(
            [*command, "--folder", folder, *options],
            stdout=subprocess.PIPE,
            stderr=messages,
            text=True,
        )
        assert self.process.stdout is not None
        address = re.search(r"http://([^/]+)(/\S*)", self.process.stdout.readline())
        assert address is not None
        self.host = address[1]
        self.cookie = self._enter(address[2])

    def _enter(self, path: str) -> str:
        for _ in range(600):
            with contextlib.suppress(ConnectionError):
                answer = self.ask("GET", path)
                return answer.headers["set-cookie"].split(";")[0]
            time.sleep(0.1)
        raise TimeoutError("the console did not start")

    def ask(self, method: str, path: str, body: bytes | None = None) -> http.client.HTTPResponse:
        connection = http.client.HTTPConnection(self.host, timeout=300)
        headers = {"Origin": f"http://{self.host}", "Cookie": getattr(self, "cookie", "")}
        connection.request(method, path, body, headers)
        return connection.getresponse()

    def __enter__(self) -> Server:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.send_signal(signal.SIGTERM)
        self.process.wait(30)

    def memory(self) -> float:
        """Resident memory of all processes of the console, in MiB."""
        return sum(_resident(pid) for pid in self.pids()) / 2**20

    def serving(self) -> float:
        """Resident memory of the server process, in MiB."""
        listens = _listening(int(self.host.rsplit(":", 1)[1]))
        found = [_resident(pid) for pid in self.pids() if listens in _files(pid)]
        return max(found, default=0.0) / 2**20

    def pids(self) -> list[int]:
        """Ids of all processes of the console."""
        return [self.process.pid, *_offspring(self.process.pid)]

    def connect(self, **options):
        from websockets.asyncio.client import connect

        headers = {"Cookie": options.pop("cookie", self.cookie)}
        options = {"origin": f"http://{self.host}", "additional_headers": headers, **options}
        return connect(f"ws://{self.host}/ws", max_size=None, compression=None, **options)


class Page:
    """A page that takes the controls and sends its operator's input 50 times a second."""

    def __init__(self, socket) -> None:
        self.socket, self.seq, self.grant = socket, 0, 0
        self.drive = dict(DRIVE)
        self.state: dict = {}
        self.states: list[dict] = []
        self.state_times: list[float] = []
        self.late, self.answers, self.ages, self.seen = [], [], [], 0
        self.recording = None
        self.first_picture, self.presses = 0.0, 0
        self.notices: list[str] = []
        self.findings: list[dict] = []
        self.failed: list[str] = []
        self._changed = asyncio.Event()

    async def send(self, kind: str, **content) -> None:
        self.seq += 1
        message = {"type": kind, "seq": self.seq, "t": time.monotonic(), **content}
        await self.socket.send(json.dumps(message))

    async def listen(self) -> None:
        async for message in self.socket:
            now = time.monotonic()
            if isinstance(message, bytes):
                if message[0] == 1:
                    self.first_picture = self.first_picture or now
                    self.ages.append(now - struct.unpack_from("<d", message, 8)[0])
                continue
            content = json.loads(message)
            if content["type"] == "controls":
                self.grant = content["grant"]
            elif content["type"] == "failed":
                self.failed.append(content["text"])
            elif content["type"] == "findings":
                self.findings = content["findings"]
            elif content["type"] == "recording":
                self.recording = content["name"] or self.recording
            elif content["type"] == "state":
                self.state = content
                self.states.append({key: content[key] for key in ("t", "mode", "rates")})
                self.state_times.append(now)
                self.seen += 1
                self.late.append(content["late"])
                if content["received"] and self.grant:
                    self.answers.append(content["t"] - content["received"]["t"])
            self._changed.set()

    async def until(self, holds, seconds: float = 60.0) -> None:
        async with asyncio.timeout(seconds):
            while not holds():
                self._changed.clear()
                await self._changed.wait()

    async def steer(self) -> None:
        """Send input forever."""
        due = time.monotonic()
        while True:
            await self.send("drive", grant=self.grant, **self.drive)
            due += 0.02
            await asyncio.sleep(max(due - time.monotonic(), 0.0))


@contextlib.asynccontextmanager
async def piloted(server: Server):
    """A pilot in HEAD."""
    async with server.connect() as socket:
        page = Page(socket)
        tasks = [asyncio.create_task(page.listen())]
        await page.until(lambda: page.state)
        await page.send("take")
        await page.until(lambda: page.grant)
        taken = time.monotonic()
        tasks.append(asyncio.create_task(page.steer()))
        await page.until(lambda: page.state["received"] and page.state["received"]["t"] > taken)
        while page.state["mode"] != "HEAD":  # more than once on a busy machine
            await page.send("mode", grant=page.grant, mode="HEAD")
            with contextlib.suppress(TimeoutError):
                await page.until(lambda: page.state["mode"] == "HEAD", 1.0)
        page.tasks = tasks
        try:
            yield page
        finally:
            for task in tasks:
                task.cancel()


def recorded(folder: Path, without: Container[Path] = ()) -> list[list[dict]]:
    """The states of each recording in a folder, but for some files."""
    from minorloop_head.console.recording import SUFFIX, TEXT, entries

    found = []
    for path in sorted(set(folder.glob(f"*{SUFFIX}"))):
        if path not in without:
            texts = (json.loads(content) for kind, _, content in entries(path) if kind == TEXT)
            found.append([each for each in texts if each["type"] == "state"])
    return found


def _offspring(pid: int) -> list[int]:
    """All descendants of a process."""
    try:
        text = Path(f"/proc/{pid}/task/{pid}/children").read_text()
    except OSError:
        return []
    children = [int(word) for word in text.split()]
    return [*children, *(each for child in children for each in _offspring(child))]


def _listening(port: int) -> str:
    """Name of the socket that listens on a port, as in the files of a process."""
    for line in Path("/proc/net/tcp").read_text().splitlines()[1:]:
        fields = line.split()
        if fields[3] == "0A" and int(fields[1].rsplit(":", 1)[1], 16) == port:
            return f"socket:[{fields[9]}]"
    return ""


def _files(pid: int) -> set[str]:
    found = set()
    with contextlib.suppress(OSError):
        for entry in Path(f"/proc/{pid}/fd").iterdir():
            with contextlib.suppress(OSError):  # closed meanwhile
                found.add(os.readlink(entry))
    return found


def _resident(pid: int) -> float:
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * _PAGE_SIZE
    except (OSError, IndexError):
        return 0.0
