"""A console whose processes are killed and stopped, one after the other, while a pilot steers.

``MINORLOOP_FAULTS`` says which, ``camera loop server plant worker console`` without it, and
``MINORLOOP_FAULT_COUNT`` how often each, 20 without it. All times are on the monotonic clock, which
all processes of a machine share: when the plant was made safe is what its own process wrote down.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from uuid import uuid4

import numpy as np

from benchmarks._console import Page, Server, piloted
from benchmarks._timing import Row

KINDS = ("camera", "loop", "server", "plant", "worker", "console")
SIGNALS = {"killed": signal.SIGKILL, "stopped": signal.SIGSTOP}
_PARTS = ("plant", "loop", "camera", "server")
_ALL = Counter({f"console-{name}": 1 for name in _PARTS})
_WORKERS = 3
"""Of the lab page, once it was opened."""
_TURNED = [0.0, -0.1, 0.0, 0.995]
_MOST_BACK = 60.0
_MARK = "MINORLOOP_FAULTS_OF"
_SHARED = ("psm_", "sem.", "pymp")


def rows(quick: bool) -> list[Row]:
    """Measure, and return the rows of the report."""
    kinds = os.environ.get("MINORLOOP_FAULTS", " ".join(KINDS)).split()
    count = 1 if quick else int(os.environ.get("MINORLOOP_FAULT_COUNT", "20"))
    found = []
    with _scene() as scene:
        inner = [kind for kind in kinds if kind != "console"]
        if inner:
            with Server(str(scene.folder / "sessions")) as server:
                for kind in inner:
                    for how in SIGNALS:
                        found.append(asyncio.run(_faults(scene, server, kind, how, count)))
            found.append(scene.left("after the end of the console"))
        if "console" in kinds:
            found.append(_ended(scene, count))
    return found


@dataclass
class _Scene:
    """Folder, processes and files of the consoles under test."""

    folder: Path
    mark: str = field(default_factory=lambda: uuid4().hex)
    shared: set[str] = field(default_factory=lambda: _shared())

    def processes(self) -> dict[int, str]:
        """Id and name of each process of the console, orphans included."""
        found = {}
        for entry in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):
                if self.mark.encode() in (entry / "environ").read_bytes():
                    found[int(entry.name)] = (entry / "comm").read_text().strip()
        return found  # a zombie has no environment

    def named(self) -> Counter[str]:
        """How many processes there are of each name, without workers."""
        return Counter(name for name in self.processes().values() if name in _ALL)

    def files(self) -> list[str]:
        """Temporary files, but for the folder of the server's uploads, and shared memory."""
        temporary = sorted(path.name for path in (self.folder / "tmp").iterdir())
        return [*temporary, *(_shared() - self.shared)]

    def left(self, when: str) -> Row:
        """Return a row that says whether nothing is left."""
        processes, files = self.processes(), self.files()
        return Row(
            f"left {when}",
            0.0,
            required="nothing",
            met=not processes and not files,
            accuracy=f"{len(processes)} processes, {len(files)} files and shared memories",
        )


@contextlib.contextmanager
def _scene() -> Iterator[_Scene]:
    with tempfile.TemporaryDirectory() as folder:
        scene = _Scene(Path(folder))
        (scene.folder / "tmp").mkdir()
        before = os.environ.get("TMPDIR")
        os.environ |= {_MARK: scene.mark, "TMPDIR": str(scene.folder / "tmp")}
        try:
            yield scene
        finally:
            del os.environ[_MARK], os.environ["TMPDIR"]
            if before is not None:
                os.environ["TMPDIR"] = before


def _shared() -> set[str]:
    folder = Path("/dev/shm")
    if not folder.is_dir():
        return set()
    return {path.name for path in folder.iterdir() if path.name.startswith(_SHARED)}


async def _faults(scene: _Scene, server: Server, kind: str, how: str, count: int) -> Row:
    """Cause many faults of a kind; measure the time until held or safe, and until back."""
    held, back, wrong = [], [], Counter()
    await _until(lambda: scene.named() == _ALL, f"{_ALL}, all processes")
    files = len(scene.files())
    for _ in range(count):
        trial = _Trial(scene, server, kind, SIGNALS[how])
        await trial.run()
        held.append(trial.held)
        back.append(trial.back)
        wrong.update(trial.wrong)
        print(f"{kind} {how}: {trial.held:.3f} s, back {trial.back:.1f} s", file=sys.stderr)
        await _until(lambda: scene.named() == _ALL, f"{_ALL}, all processes")
        wrong["left"] += trial.pid in scene.processes()
        wrong["left"] += len(scene.files()) > files
    errors = ", ".join(f"{count} x {name}" for name, count in wrong.items() if count)
    limit = 5.0 if kind == "worker" else 0.2
    done = {"loop": "safe", "worker": "answered"}.get(kind, "held")
    return Row(
        f"{kind} {how}, {count} times: {done}",
        max(held),
        required=f"<= {limit:g} s",
        met=max(held) <= limit and not errors,
        accuracy=f"median {np.median(held) * 1e3:.0f} ms; back after {np.median(back):.1f} s, at "
        f"most {max(back):.1f} s; wrong: {errors or 'nothing'}",
    )


@dataclass
class _Trial:
    """One fault, while a pilot turns the head and pushes the catheter, and records."""

    scene: _Scene
    server: Server
    kind: str
    signal: signal.Signals
    held: float = np.inf
    back: float = np.inf
    pid: int = 0
    wrong: list[str] = field(default_factory=list)

    async def run(self) -> None:
        async with piloted(self.server) as page:
            page.drive |= {"stick": [1.0, 0.0], "pose": _TURNED}
            recordings = set(self._recordings())
            await page.send("record", grant=page.grant, on=True)
            await page.until(lambda: set(self._recordings()) - recordings)
            (self._recording,) = set(self._recordings()) - recordings
            while True:  # on a busy machine, it may hold before the fault
                await _entered(page)
                await asyncio.sleep(0.3)
                if page.state["mode"] == "HEAD":
                    break
            await getattr(self, f"_{self.kind}")(page)

    def _fault(self) -> float:
        found = [
            pid
            for pid, name in self.scene.processes().items()
            if name == f"console-{self.kind}"[:15]
        ]
        self.pid = found[-1]
        os.kill(self.pid, self.signal)
        return time.monotonic()

    async def _camera(self, page: Page) -> None:
        began, pictures = self._fault(), len(page.ages)
        await page.until(lambda: page.state["t"] > began and page.state["mode"] == "HOLD")
        self.held = page.state["t"] - began
        if "no picture" not in page.state["reason"]:
            self.wrong.append("not reported")
        self.back = await _entered(page) - began
        if len(page.ages) == pictures:
            self.wrong.append("entered without pictures")

    async def _plant(self, page: Page) -> None:
        began = self._fault()
        await page.until(lambda: page.state["t"] > began and page.state["mode"] == "HOLD")
        self.held = page.state["t"] - began
        if "plant" not in page.state["reason"]:
            self.wrong.append("not reported")
        await page.until(lambda: page.state["safe_at"] > began)
        self.back = await _entered(page) - began

    async def _loop(self, page: Page) -> None:
        page.failed.clear()
        began = self._fault()
        await page.until(lambda: page.state["safe_at"] > began)
        self.held = page.state["safe_at"] - began
        if page.state["mode"] != "HOLD" or "made safe" not in page.state["reason"]:
            self.wrong.append("not in HOLD")
        if not any("control loop" in text for text in page.failed):
            self.wrong.append("not reported")
        self.back = await _entered(page) - began
        self._check_recording(began)

    async def _server(self, page: Page) -> None:
        began = self._fault()
        with contextlib.suppress(asyncio.CancelledError, TimeoutError):
            await asyncio.wait_for(asyncio.wait(page.tasks[:1]), _MOST_BACK)
        async with asyncio.timeout(_MOST_BACK):
            while True:
                with contextlib.suppress(OSError, EOFError):
                    async with piloted(self.server) as again:
                        self.back = again.state["t"] - began
                        if again.recording is not None:
                            self.wrong.append("recording continues")
                        break
        states = self._check_recording(began)
        held = [s["t"] for s in states if s["t"] > began and s["mode"] == "HOLD"]
        self.held = held[0] - began if held else np.inf

    async def _worker(self, page: Page) -> None:
        await asyncio.to_thread(self.server.ask, "GET", "/lab")
        dropped = await asyncio.to_thread(self._ask, "/api/lab?name=run.csv", _table())
        job = f"/api/lab/{dropped['user']}/identify"
        choice = json.dumps({"input": "u [V]", "output": "y [um]", "levels": 40}).encode()
        busy = await _resting(self.scene)
        answer = asyncio.create_task(asyncio.to_thread(self._lines, job, choice))
        await _until(lambda: _busiest(self.scene, busy) > 0, "a worker at work")
        self.pid = _busiest(self.scene, busy)
        os.kill(self.pid, self.signal)
        began = time.monotonic()
        last = (await answer)[-1]
        self.held = time.monotonic() - began
        if "ended unexpectedly" not in last.get("error", ""):
            self.wrong.append("no error")
        quick = json.dumps({"input": "u [V]", "output": "y [um]", "levels": 5}).encode()
        if not any("result" in one for one in await asyncio.to_thread(self._lines, job, quick)):
            self.wrong.append("no result afterwards")
        self.back = time.monotonic() - began
        if page.state["mode"] != "HEAD":
            self.wrong.append("held by it")

    def _ask(self, path: str, content: bytes) -> dict:
        return json.loads(self.server.ask("POST", path, content).read())

    def _lines(self, path: str, content: bytes) -> list[dict]:
        answer = self.server.ask("POST", path, content).read()
        return [json.loads(line) for line in answer.splitlines()]

    def _recordings(self) -> list[Path]:
        return list((self.scene.folder / "sessions").glob("*.session"))

    def _check_recording(self, began: float) -> list[dict]:
        """The states of the recording, which must reach to the fault without a gap."""
        from minorloop_head.console.recording import TEXT, entries

        texts = [json.loads(c) for kind, _, c in entries(self._recording) if kind == TEXT]
        states = [each for each in texts if each["type"] == "state"]
        if not states or states[-1]["t"] < began - 0.15:
            self.wrong.append("recording lost")
        if np.any(np.diff([s["seq"] for s in states]) != 1):
            self.wrong.append("gap in the recording")
        return states


def _ended(scene: _Scene, count: int) -> Row:
    """The command is killed, with one of its processes stopped every other time."""
    seconds = []
    for k in range(max(count // 4, 1)):
        server = Server(str(scene.folder / "sessions"))
        deadline = time.monotonic() + _MOST_BACK
        while scene.named() != _ALL and time.monotonic() < deadline:
            time.sleep(0.05)
        if k % 2:
            names = {name: pid for pid, name in scene.processes().items()}
            os.kill(names[f"console-{_PARTS[k // 2 % 4]}"], signal.SIGSTOP)
        server.process.kill()
        server.process.wait()
        began = time.monotonic()
        while scene.processes() and time.monotonic() < began + _MOST_BACK:
            time.sleep(0.02)
        seconds.append(time.monotonic() - began)
        server.process.stdout.close()
    left = scene.left("after the command was killed")
    return Row(
        f"command killed, {len(seconds)} times: all its processes have ended",
        max(seconds),
        required="<= 10 s, nothing left",
        met=max(seconds) <= 10.0 and bool(left.met),
        accuracy=left.accuracy,
    )


async def _entered(page: Page) -> float:
    """Ask for HEAD until it is on; when it was."""
    async with asyncio.timeout(_MOST_BACK):
        while page.state["mode"] != "HEAD":
            await page.send("mode", grant=page.grant, mode="HEAD")
            with contextlib.suppress(TimeoutError):
                await page.until(lambda: page.state["mode"] == "HEAD", 0.2)
    return page.state["t"]


async def _until(holds, what: str) -> None:
    deadline = time.monotonic() + _MOST_BACK
    while not holds():
        if time.monotonic() > deadline:
            raise TimeoutError(f"there never was {what}")
        await asyncio.sleep(0.05)


def _times(scene: _Scene) -> dict[int, int]:
    """Processor time of each worker, in ticks."""
    found = {}
    for pid, name in scene.processes().items():
        if name == "page-worker":
            with contextlib.suppress(OSError):
                fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
                found[pid] = int(fields[11]) + int(fields[12])
    return found


async def _resting(scene: _Scene) -> dict[int, int]:
    """Processor time of each worker once all of them have begun and none is at work."""
    async with asyncio.timeout(_MOST_BACK):
        while True:
            before = _times(scene)
            await asyncio.sleep(0.5)
            now = _times(scene)
            if len(now) == _WORKERS and now == before:
                return now


def _busiest(scene: _Scene, before: dict[int, int]) -> int:
    """The worker that has worked for a tenth of a second since; 0 where there is none."""
    for pid, ticks in _times(scene).items():
        if ticks - before.get(pid, ticks) >= 10:
            return pid
    return 0


def _table() -> bytes:
    rng = np.random.default_rng(0)
    t = np.arange(20_000) / 200
    u = 2 + (1 + 0.5 * np.sin(t / 6)) * np.sin(5 * t)
    y = u**2 + rng.normal(0, 0.3, t.size)
    lines = [f"{a:.6g},{b:.6g},{c:.6g}" for a, b, c in zip(t, u, y, strict=True)]
    return ("\n".join(["time [s],u [V],y [um]", *lines]) + "\n").encode()
