"""The operator's seat under load, under attack, and cut off.

A console of its own, four pages over real sockets on this machine. ``MINORLOOP_SEAT_SECONDS`` sets
how long they watch; 600 is what is required, 60 is the default.
"""

from __future__ import annotations

import asyncio
import contextlib
import http.client
import json
import os
import re
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
from itertools import chain
from pathlib import Path

import numpy as np

from benchmarks._timing import Row

PAGES = 4
HOSTILE = 10_000
_PAGE_SIZE = os.sysconf("SC_PAGE_SIZE")
_PAINTS = "performance.getEntriesByName('first-contentful-paint')"
_FETCHED = "performance.getEntriesByType('resource').reduce((sum, e) => sum + e.encodedBodySize, 0)"
_DRIVE = {"pose": [0, 0, 0, 1], "age": 0.0, "stick": [0, 0], "clutch": False}


def rows(quick: bool) -> list[Row]:
    """What was measured."""
    seconds = 5.0 if quick else float(os.environ.get("MINORLOOP_SEAT_SECONDS", "60"))
    with tempfile.TemporaryDirectory() as folder, _Server(folder) as server:
        _lab(server, True)  # the workers have begun, and are as large as they become
        lab = _lab(server, quick)
        found = asyncio.run(_watched(server, seconds))
        found += asyncio.run(_cut_off(server, Path(folder)))
        found += asyncio.run(_attacked(server, 300 if quick else HOSTILE))
        found += [lab, _still(), *_painted(server)]
        return found


class _Server:
    """A console, and the cookie of a browser that came with its key."""

    def __init__(self, folder: str, *options: str) -> None:
        command = [sys.executable, "-u", "-m", "minorloop", "console", "--port", "0"]
        self.process = subprocess.Popen(
            [*command, "--folder", folder, *options], stdout=subprocess.PIPE, text=True
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

    def __enter__(self) -> _Server:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.send_signal(signal.SIGTERM)
        self.process.wait(30)

    def memory(self) -> float:
        """Resident memory of the server and of what it started, in MiB."""
        pids = [self.process.pid, *_children(self.process.pid)]
        return sum(_resident(pid) for pid in pids) / 2**20

    def connect(self, **options):
        from websockets.asyncio.client import connect

        headers = {"Cookie": options.pop("cookie", self.cookie)}
        options = {"origin": f"http://{self.host}", "additional_headers": headers, **options}
        return connect(f"ws://{self.host}/ws", max_size=None, compression=None, **options)


class _Page:
    """A page that takes the controls and sends what its operator does, 50 times a second."""

    def __init__(self, socket) -> None:
        self.socket, self.seq, self.grant = socket, 0, 0
        self.drive = dict(_DRIVE)
        self.state: dict = {}
        self.states: list[dict] = []
        self.late, self.answers, self.ages, self.seen = [], [], [], 0
        self.recording = None
        self.notices: list[str] = []
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
                    self.ages.append(now - struct.unpack_from("<d", message, 8)[0])
                continue
            told = json.loads(message)
            if told["type"] == "seats":
                self.grant = told["grant"]
            elif told["type"] == "recording":
                self.recording = told["name"] or self.recording
            elif told["type"] == "state":
                self.state = told
                self.states.append({key: told[key] for key in ("t", "mode", "rates")})
                self.seen += 1
                self.late.append(told["late"])
                if told["heard"] and self.grant:
                    self.answers.append(told["t"] - told["heard"]["t"])
            self._changed.set()

    async def until(self, holds, seconds: float = 60.0) -> None:
        async with asyncio.timeout(seconds):
            while not holds():
                self._changed.clear()
                await self._changed.wait()

    async def steer(self) -> None:
        """Drive for ever."""
        due = time.monotonic()
        while True:
            await self.send("drive", grant=self.grant, **self.drive)
            due += 0.02
            await asyncio.sleep(max(due - time.monotonic(), 0.0))


@contextlib.asynccontextmanager
async def _piloted(server: _Server):
    """A pilot in HEAD."""
    async with server.connect() as socket:
        page = _Page(socket)
        tasks = [asyncio.create_task(page.listen())]
        await page.until(lambda: page.state)
        await page.send("take")
        await page.until(lambda: page.grant)
        tasks.append(asyncio.create_task(page.steer()))
        await page.until(lambda: page.state["heard"] and page.state["heard"]["seq"] > 2)
        while page.state["mode"] != "HEAD":  # on a machine that is busy, more than once
            await page.send("mode", grant=page.grant, mode="HEAD")
            with contextlib.suppress(TimeoutError):
                await page.until(lambda: page.state["mode"] == "HEAD", 1.0)
        page.tasks = tasks
        try:
            yield page
        finally:
            for task in tasks:
                task.cancel()


async def _watched(server: _Server, seconds: float) -> list[Row]:
    """Four pages watch, one of them steers."""
    async with contextlib.AsyncExitStack() as stack:
        pilot = await stack.enter_async_context(_piloted(server))
        others = [
            _Page(await stack.enter_async_context(server.connect())) for _ in range(PAGES - 1)
        ]
        tasks = [asyncio.create_task(page.listen()) for page in others]
        await asyncio.sleep(10.0)  # the map and what else grows once
        before = server.memory()
        for page in (pilot, *others):
            page.late.clear(), page.answers.clear(), page.ages.clear()
            page.seen = 0
        began = time.monotonic()
        await asyncio.sleep(seconds / 2)
        half = server.memory()
        await asyncio.sleep(seconds / 2)
        passed = time.monotonic() - began
        after = server.memory()
        for task in tasks:
            task.cancel()
    rates = [page.seen / passed for page in (pilot, *others)]
    pictures = [len(page.ages) / passed for page in (pilot, *others)]
    ages = np.concatenate([page.ages for page in (pilot, *others)])
    late = np.mean(np.array(pilot.late) > 10.0)
    answer, age = np.percentile(pilot.answers, 99), np.percentile(ages, 95)
    growth, last = after - before, after - half
    note = f"load {os.getloadavg()[0]:.1f}"
    return [
        Row(
            f"ticks over 10 ms late, {passed:.0f} s",
            float(np.percentile(pilot.late, 99.9)) / 1e3,
            required="<= 0.1 %",
            met=bool(late <= 1e-3),
            accuracy=f"{late:.2%} of {len(pilot.late)}; {note}",
        ),
        Row(
            "input to head command, p99",
            float(answer),
            required="<= 50 ms",
            met=bool(answer <= 0.05),
            accuracy=f"median {np.median(pilot.answers) * 1e3:.0f} ms",
        ),
        Row(
            "capture to page, p95",
            float(age),
            required="<= 120 ms",
            met=bool(age <= 0.12),
            accuracy=f"least {min(rates):.1f} states and {min(pictures):.1f} pictures a second",
        ),
        Row(
            "memory of server, loop and workers",
            passed,
            required="flat",
            met=bool(last <= 4.0),
            accuracy=f"{before:.0f} MiB, {growth - last:+.1f} and {last:+.1f} MiB in either half",
        ),
    ]


async def _cut_off(server: _Server, folder: Path) -> list[Row]:
    """Time until it holds, for each way to lose the operator; each operator records."""
    async with server.connect() as socket:
        watcher = _Page(socket)
        watching = asyncio.create_task(watcher.listen())
        cuts, found, jump = await _cut(server)
        await asyncio.sleep(0.5)
        watching.cancel()
    recordings = _recorded(folder)
    states = sorted([*watcher.states, *chain(*recordings)], key=lambda state: state["t"])
    for name, began in cuts.items():
        first = next(s for s in states if s["t"] > began and s["mode"] == "HOLD")
        found.append(_held(name, first["t"] - began, stopped=first["rates"] == [0.0, 0.0]))
    gaps = sum(int(np.sum(np.diff([s["seq"] for s in each]) != 1)) for each in recordings)
    told = sum(map(len, recordings))
    found.append(
        Row(
            "to go on after that",
            0.0,
            required="no jump, nothing lost",
            met=jump <= 0.1 and gaps == 0,
            accuracy=f"{jump:.3f} degrees; {gaps} gaps in {told} recorded states",
        )
    )
    return found


async def _cut(server: _Server) -> tuple[dict[str, float], list[Row], float]:
    """When each way was tried, what the first gave, and the jump at the end."""
    found = []
    async with _piloted(server) as page:
        await page.send("record", grant=page.grant, on=True)
        await page.until(lambda: page.recording)
        page.drive["pose"] = None
        began = time.monotonic()
        await page.until(lambda: page.state["t"] > began and page.state["mode"] == "HOLD")
        found.append(_held("pose lost", page.state["t"] - began))
    cuts = {}
    async with _piloted(server) as page:
        await page.send("record", grant=page.grant, on=True)
        page.drive["stick"] = [1.0, 0.0]
        await asyncio.sleep(1.0)
        page.tasks[1].cancel()
        cuts["page silent"] = time.monotonic()
        await page.until(lambda: page.state["mode"] == "HOLD")
    async with _piloted(server) as page:
        await page.send("record", grant=page.grant, on=True)
        page.drive["stick"] = [1.0, 0.0]
        await asyncio.sleep(1.0)
        cuts["link cut"] = time.monotonic()
        page.socket.transport.abort()
    await asyncio.sleep(1.0)
    jump = 0.0
    async with _piloted(server) as page:
        await page.send("record", grant=page.grant, on=True)
        page.drive["stick"] = [1.0, 0.0]
        page.drive["pose"] = [0.0, -0.1, 0.0, 0.995]
        await asyncio.sleep(1.0)
        cuts["server suspended for 1 s"] = time.monotonic()
        server.process.send_signal(signal.SIGSTOP)
        await asyncio.sleep(1.0)
        server.process.send_signal(signal.SIGCONT)
        await page.until(lambda: page.state["mode"] == "HOLD")
        held = page.state["command"]
        await asyncio.sleep(0.5)
        page.drive["pose"] = [0.0, 0.2, 0.0, 0.98]
        await page.send("mode", grant=page.grant, mode="HEAD")
        await page.until(lambda: page.state["mode"] == "HEAD")
        jump = float(np.abs(np.subtract(page.state["command"], held)).max())
        await page.send("record", grant=page.grant, on=False)
        await asyncio.sleep(0.5)
    return cuts, found, jump


def _held(name: str, seconds: float, *, stopped: bool = True) -> Row:
    word = "catheter stopped" if stopped else "catheter NOT stopped"
    return Row(
        f"HOLD: {name}",
        seconds,
        required="<= 200 ms",
        met=seconds <= 0.2 and stopped,
        accuracy=word,
    )


def _recorded(folder: Path) -> list[list[dict]]:
    """The states of each recording."""
    from minorloop.teleop.recording import TEXT, entries, listed

    found = []
    for name in listed(folder):
        told = (json.loads(c) for kind, _, c in entries(folder / f"{name}.session") if kind == TEXT)
        found.append([each for each in told if each["type"] == "state"])
    return found


async def _attacked(server: _Server, count: int) -> list[Row]:
    """Hostile connections while a pilot steers."""
    rng = np.random.default_rng(0)
    async with _piloted(server) as pilot:
        await asyncio.sleep(1.0)
        before = pilot.state["command"], pilot.state["place"]
        began = time.monotonic()
        limit = asyncio.Semaphore(8)

        async def one(k: int) -> bool:
            async with limit:
                return await _hostile(server, k, pilot.grant, rng)

        reasons = await asyncio.gather(*(one(k) for k in range(count)))
        seconds = time.monotonic() - began
        moved = np.abs(np.subtract(pilot.state["command"], before[0])).max()
        pushed = np.abs(np.subtract(pilot.state["place"], before[1])).max()
        alive = server.process.poll() is None and bool(pilot.grant)
        mode = pilot.state["mode"]
    closed = sum(reasons)
    still = moved == 0 and pushed < 0.5
    return [
        Row(
            f"{count} hostile messages",
            seconds,
            required="0 crashes, 0 commands, a reason for each",
            met=alive and still and closed == count,
            accuracy=f"{closed} closed with a reason; command moved {moved:g} degrees; then {mode}",
        )
    ]


async def _hostile(server: _Server, k: int, grant: int, rng: np.random.Generator) -> bool:
    """One connection that means harm; whether it was closed with a reason."""
    from websockets.exceptions import ConnectionClosed

    drive = {"type": "drive", "seq": 1, "t": 1.0, "grant": grant, **_DRIVE, "stick": [1, 1]}
    take = {"type": "take", "seq": 9, "t": 9.0}
    options: dict = {}
    messages: list[str | bytes] = [json.dumps(drive)]
    kind = k % 10
    if kind == 1:
        messages = ["x" * 100_000]
    elif kind == 2:
        messages = [rng.bytes(50)]
    elif kind == 3:
        messages = [json.dumps(drive).replace("[1, 1]", "[NaN, NaN]")]
    elif kind == 4:
        messages = [json.dumps({**drive, "pose": "up", "stick": {}})]
    elif kind == 5:
        messages = [json.dumps(take), json.dumps({**take, "seq": 8})]
    elif kind == 6:
        options["origin"] = "http://evil.example"
    elif kind == 7:
        options["cookie"] = "minorloop=guess"
    elif kind == 8:
        messages = ["[" * 2000]
    elif kind == 9:
        messages = [json.dumps({**drive, "grant": grant + 1, "type": "mode", "mode": "HEAD"})]
    try:
        async with asyncio.timeout(30), server.connect(**options) as socket:
            for message in messages:
                await socket.send(message)
            async for _ in socket:
                pass
            return socket.close_code in (1008, 1009)
    except ConnectionClosed as error:
        return error.rcvd is not None and error.rcvd.code in (1008, 1009)


def _still() -> Row:
    """How far the operator's head moves a tracked target; two runs that differ in it alone."""
    from minorloop.teleop.eyes import Eyes
    from minorloop.teleop.messages import Drive, Mode, Pick
    from minorloop.teleop.plant import head_of, open_plant, open_tip
    from minorloop.teleop.session import Session

    control, paths = head_of("twin:pipe", None), []
    for swing in (0.0, np.radians(30.0)):
        sight = _Beside(Eyes(*open_tip("twin:pipe")))
        session = Session(open_plant("twin:pipe"), sight.view, control, sight)
        seen = []
        for k in range(700):
            yaw = np.radians(27.0) if k < 350 else swing * np.sin(0.3 * k)
            pose = (0.0, float(-np.sin(yaw / 2)), 0.0, float(np.cos(yaw / 2)))
            order = {"seq": k, "t": 0.04 * k, "grant": 1}
            drive = Drive(pose=pose, age=0.0, stick=(0.0, 0.0), clutch=False, **order)
            session.hear(drive, 0.04 * k)
            if k == 1:
                session.hear(Mode(mode="HEAD", **order), 0.04 * k)
            if k == 300:
                u, v, *_ = session.seen.spots[0] if session.seen.spots else (400.0, 300.0)
                session.hear(Pick(u=u, v=v, **order), 0.04 * k)
            if k == 340:
                session.hear(Mode(mode="TRACK", **order), 0.04 * k)
            session.tick(0.04 * k)
            if k >= 550 and session.seen.target is not None:
                seen.append(session.seen.target[:2])
        paths.append(np.array(seen))
    moved = float(np.abs(paths[1] - paths[0]).max())
    jitter = float(np.sqrt(np.mean((paths[1] - paths[1].mean(axis=0)) ** 2)))
    return Row(
        "target in TRACK while the operator's head swings 30 degrees",
        0.0,
        required="moves < 1 px",
        met=moved < 1.0 and jitter < 1.0,
        accuracy=f"{moved:.3f} px by it; {jitter:.2f} px rms with it and without",
    )


class _Beside:
    """Eyes in the same process."""

    def __init__(self, eyes) -> None:
        self.eyes, self.view, self._seen = eyes, eyes._view, []

    def look(self, look) -> None:
        self._seen.append(self.eyes.tick(look))

    def seen(self) -> list:
        seen, self._seen = self._seen, []
        return seen


def _painted(server: _Server) -> list[Row]:
    """First contentful paint of both pages, and their size; none without a Chromium."""
    path = shutil.which("chromium") or shutil.which("chromium-browser")
    if path is None:
        return []
    from playwright.sync_api import sync_playwright

    name, value = server.cookie.split("=", 1)
    found = []
    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path=path, args=["--no-sandbox"])
        for page_name in ("/", "/lab"):
            times = []
            for _ in range(3):
                context = browser.new_context()
                context.add_cookies(
                    [{"name": name, "value": value, "url": f"http://{server.host}"}]
                )
                page = context.new_page()
                page.goto(f"http://{server.host}{page_name}")
                page.wait_for_function(f"{_PAINTS}.length > 0")
                times.append(page.evaluate(f"{_PAINTS}[0].startTime") / 1e3)
                size = page.evaluate(_FETCHED) / 1e3
                context.close()
            found.append(
                Row(
                    f"first contentful paint of {page_name}, best of 3",
                    min(times),
                    required="<= 1 s",
                    met=min(times) <= 1.0,
                    accuracy=f"{size:.0f} kB fetched; load {os.getloadavg()[0]:.1f}",
                )
            )
        browser.close()
    return found


def _lab(server: _Server, quick: bool) -> Row:
    """From the drop of 7,000 rows to the model."""
    from minorloop.operators.preisach import Preisach

    rng = np.random.default_rng(0)
    count = 1000 if quick else 7000
    t = np.arange(count) / 200
    u = 2 + (1 + 0.5 * np.sin(t / 6)) * np.sin(5 * t)
    model = Preisach(np.linspace(0, 4, 41), np.tril(rng.uniform(size=(40, 40))))
    y = model.simulate(u) + rng.normal(0, 0.3, count)
    lines = [f"{a:.6g},{b:.6g},{c:.6g}" for a, b, c in zip(t, u, y, strict=True)]
    text = "\n".join(["time [s],voltage [V],length [um]", *lines]) + "\n"
    began = time.monotonic()
    dropped = json.loads(server.ask("POST", "/api/lab?name=run.csv", text.encode()).read())
    choice = {"input": "voltage [V]", "output": "length [um]", "levels": 25}
    path = f"/api/lab/{dropped['user']}/identify"
    answer = server.ask("POST", path, json.dumps(choice).encode())
    while "result" not in (told := json.loads(answer.readline())):
        assert "error" not in told, told
    seconds = time.monotonic() - began
    scores = told["result"]["scores"]
    return Row(
        f"lab: {count} rows, L = 25, drop to model",
        seconds,
        required="<= 5 s",
        met=seconds <= 5.0,
        accuracy=f"{scores['holdout']:.2%} of range on held-out rows",
    )


def _children(pid: int) -> list[int]:
    try:
        text = Path(f"/proc/{pid}/task/{pid}/children").read_text()
    except OSError:
        return []
    return [int(word) for word in text.split()]


def _resident(pid: int) -> float:
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * _PAGE_SIZE
    except (OSError, IndexError):
        return 0.0
