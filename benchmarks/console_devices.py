"""The console on a board, a camera and a tracker that are programs of their own.

The board is on a pseudo-terminal, the camera sends MJPEG of a simulated pipe over HTTP, and the
tracker sends UDP, all on this machine. ``MINORLOOP_CONSOLE_SECONDS`` sets how long it steers; 600
is required, 60 is the default. Then a hole of the pipe is found, centred and measured, and each
device is pulled.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import re
import tempfile
import time
from collections import Counter
from collections.abc import AsyncIterator
from pathlib import Path

import numpy as np

from benchmarks._console import Page, Server, recorded
from benchmarks._simulated_devices import Device, devices, holes
from benchmarks._timing import Row, within

_BACK, _SETTLED, _RECORDED = 3.0, 20.0, 1.0
"""Seconds until a device that was put back is used again, until buffers have their final size, and
that are recorded before a device is pulled."""
_CAUSES = {"camera": "camera", "board": "device|plant", "tracker": "tracker", "browser": "controls"}
"""What the cause has to name."""
_TRIES, _LONGEST, _EXACT = 4, 120.0, 0.1
"""How often and how long it is tried, and the accuracy in mm: 1 % of the radius of the pipe."""
_SEARCHED, _PICKED, _CENTRED, _RADIUS = 1.5, 0.4, 15.0, 10.0
"""Seconds until a picture was searched, until a pick is tracked, and until it is centred; radius of
the pipe in mm."""
_FAR = 60.0
"""Pixels from the edge of a picture: more than the diameter of a hole."""
_EVERY = 1.0
_FLAT, _LONG = 0.5, 300.0
"""Growth in MiB a minute that counts as none, and seconds without which it is not known."""


def rows(quick: bool) -> list[Row]:
    """Measure, and return the rows of the report."""
    seconds = 5.0 if quick else float(os.environ.get("MINORLOOP_CONSOLE_SECONDS", "60"))
    settled = 1.0 if quick else _SETTLED
    with tempfile.TemporaryDirectory() as name, devices(Path(name)) as (running, options):
        sessions = Path(name) / "sessions"
        starts = ("first", "second")
        found = [asyncio.run(_started(sessions, options, when)) for when in starts]
        with Server(str(sessions), *options) as server:
            found += asyncio.run(_steered(server, settled, seconds))
            found.append(asyncio.run(_inspected(server)))
            for pulled, device in (*running.items(), ("browser", None)):
                found.append(asyncio.run(_pulled(server, sessions, pulled, device)))
    return found


async def _started(folder: Path, options: list[str], when: str) -> Row:
    """Return the time from the command to HEAD with the file of the head."""
    began = time.monotonic()
    with Server(str(folder), *options) as server:
        served = time.monotonic() - began
        async with _steering(server) as page:
            seconds = time.monotonic() - began
            pictured = page.first_picture - began
    return within(
        f"start until HEAD, {when} of two",
        seconds,
        3.0,
        f"page {served:.1f} s, first picture {pictured:.1f} s; {_load()}",
    )


async def _steered(server: Server, settled: float, seconds: float) -> list[Row]:
    """Steer for a while; HEAD is pressed again where the machine has lost it."""
    lost: Counter[str] = Counter()
    memory = []
    async with _steering(server) as page:
        await asyncio.sleep(settled)
        page.late.clear(), page.answers.clear(), page.ages.clear()
        began = time.monotonic()
        while (passed := time.monotonic() - began) < seconds:
            memory.append((passed, *_by_process(server)))
            if page.state["mode"] != "HEAD":
                lost[re.split("[;,:]", page.state["reason"])[0]] += 1
                await _press(page)
            await asyncio.sleep(_EVERY)
    late = float(np.mean(np.array(page.late) > 10.0))
    age, answer = np.percentile(page.ages, 95), np.percentile(page.answers, 99)
    rate = f"{len(page.ages) / seconds:.1f} a second"
    return [
        Row(
            f"ticks over 10 ms late, {seconds:.0f} s",
            float(np.percentile(page.late, 99.9)) / 1e3,
            required="<= 0.1 %",
            met=late <= 1e-3,
            accuracy=f"{late:.2%} of {len(page.late)}; {_load()}; held: "
            f"{', '.join(f'{count} times {why}' for why, count in lost.items()) or 'never'}",
        ),
        within("picture age since its arrival, p95", float(age), 0.12, rate),
        within("input to command, p99", float(answer), 0.05),
        _flat(memory),
    ]


def _flat(memory: list[tuple]) -> Row:
    """Return the growth of the memory of all processes, by a line through it."""
    t = np.array([row[0] for row in memory])
    names = sorted({name for _, sizes in memory for name in sizes})
    sizes = {name: np.array([row[1].get(name, 0.0) for row in memory]) for name in names}
    slopes = {name: 60.0 * float(np.polyfit(t, each, 1)[0]) for name, each in sizes.items()}
    total, growth = sum(each[-1] for each in sizes.values()), sum(slopes.values())
    each = ", ".join(f"{name} {sizes[name][-1]:.0f} {slopes[name]:+.2f}" for name in names)
    return Row(
        "memory of all processes",
        0.0,
        required=f"grows by <= {_FLAT} MiB a minute, over {_LONG:.0f} s or more",
        met=growth <= _FLAT if t[-1] > 0.9 * _LONG else None,
        accuracy=f"{total:.0f} MiB, {growth:+.2f} a minute: {each}",
    )


def _by_process(server: Server) -> tuple[dict[str, float]]:
    """Return the private memory of each process of the console by its name, in MiB."""
    found: dict[str, float] = {}
    for pid in server.pids():
        with contextlib.suppress(OSError):
            name = Path(f"/proc/{pid}/comm").read_text().strip().removeprefix("console-")
            text = Path(f"/proc/{pid}/smaps_rollup").read_text()
            lines = (line.split() for line in text.splitlines() if line.startswith("Private_"))
            found[name] = found.get(name, 0.0) + sum(int(words[1]) for words in lines) / 2**10
    return (found,)


async def _inspected(server: Server) -> Row:
    """Look round, measure what is framed, and compare it with the holes of the pipe."""
    began, tries = time.monotonic(), 0
    async with _steering(server) as page:
        while not page.findings and tries < _TRIES and time.monotonic() - began < _LONGEST:
            tries += await _measured(page)
    found = [min(_apart(each, hole) for hole in holes()) for each in page.findings]
    place, width = (max(errors) for errors in zip(*found, strict=True)) if found else (9.0, 9.0)
    return Row(
        "a hole found, centred and measured",
        time.monotonic() - began,
        required=f"place and width within {_EXACT} mm",
        met=place <= _EXACT and width <= _EXACT,
        accuracy=f"errors {place:.3f} and {width:.3f} mm in {tries} tries",
    )


async def _measured(page: Page) -> bool:
    """Measure a hole that is framed, then look round again; return whether there was one."""
    inside = [spot for spot in page.state["spots"] if _is_inside(*spot[:2])]
    if not inside:
        if page.state["mode"] != "HEAD":
            await _press(page)
        await page.send("find", grant=page.grant)
        await asyncio.sleep(_SEARCHED)
        return False
    await page.send("pick", grant=page.grant, u=inside[0][0], v=inside[0][1])
    await asyncio.sleep(_PICKED)
    await page.send("mode", grant=page.grant, mode="TRACK")
    with contextlib.suppress(TimeoutError):
        await page.until(lambda: page.state["centred"], _CENTRED)
    with contextlib.suppress(TimeoutError):
        await page.send("measure", grant=page.grant)
        await page.until(lambda: bool(page.findings), 3.0 * _SEARCHED)
    await _press(page)
    return True


def _is_inside(u: float, v: float) -> bool:
    """Return whether a pixel is well inside the picture."""
    return _FAR < u < 640 - _FAR and _FAR < v < 480 - _FAR


def _apart(found: dict, hole: tuple[float, float, float]) -> tuple[float, float]:
    """Return the distance on the wall and the difference of the widths, in mm."""
    angle, place, width = hole
    around = math.radians((found["phi"] - angle + 180.0) % 360.0 - 180.0) * _RADIUS
    return math.hypot(around, found["z"] - place), abs(found["diameter"] - width)


async def _pulled(server: Server, sessions: Path, name: str, device: Device | None) -> Row:
    """Pull a device in HEAD, put it back, and press a key; for the browser, cut its connection."""
    before = set(sessions.glob("*"))
    async with server.connect() as socket:
        watcher = Page(socket)
        watching = asyncio.create_task(watcher.listen())
        async with _steering(server) as page:
            await page.send("record", grant=page.grant, on=True)
            await page.until(lambda: page.recording)
            await asyncio.sleep(_RECORDED)
            while not await _press(page):  # it was lost meanwhile: the machine is busy
                pass
            began = time.monotonic()
            if device is None:
                page.socket.transport.abort()
            else:
                device.pull()
            await watcher.until(lambda: watcher.state["t"] > began and _holds(watcher))
            await asyncio.sleep(_RECORDED)
            cause = watcher.state["reason"]
            if device is not None:
                device.put_back()
                await asyncio.sleep(_BACK)
                on = await _press(page)
                await page.send("record", grant=page.grant, on=False)
        if device is None:
            async with _steering(server) as page:
                on = page.presses == 1
        await asyncio.sleep(_RECORDED)
        watching.cancel()
    (session,) = recorded(sessions, without=before)
    held = next(s["t"] for s in session if s["t"] > began and s["mode"] == "HOLD") - began
    gaps = int(np.sum(np.diff([state["seq"] for state in session]) != 1))
    return Row(
        f"{name} pulled in HEAD: held",
        held,
        required="<= 200 ms, cause, one key, nothing lost",
        met=held <= 0.2 and on and not gaps and re.search(_CAUSES[name], cause) is not None,
        accuracy=f"{cause!r}; {'goes on' if on else 'does NOT go on'} by one key; {gaps} gaps in "
        f"{len(session)} states; {_load()}",
    )


def _holds(page: Page) -> bool:
    return page.state["mode"] == "HOLD"


@contextlib.asynccontextmanager
async def _steering(server: Server) -> AsyncIterator[Page]:
    """A page that steers in HEAD, and knows how often it pressed the key."""
    async with server.connect() as socket:
        page = Page(socket)
        tasks = [asyncio.create_task(page.listen())]
        await page.until(lambda: page.state)
        await page.send("take")
        await page.until(lambda: page.grant)
        tasks.append(asyncio.create_task(page.steer()))
        await page.until(lambda: page.state["received"] and page.ages)
        page.presses = 1
        while not await _press(page):  # more than once on a busy machine
            page.presses += 1
        try:
            yield page
        finally:
            for task in tasks:
                task.cancel()


async def _press(page: Page) -> bool:
    """Press the key of HEAD once; return whether it is on within half a second."""
    await page.send("mode", grant=page.grant, mode="HEAD")
    with contextlib.suppress(TimeoutError):
        await page.until(lambda: page.state["mode"] == "HEAD", 0.5)
    return bool(page.state["mode"] == "HEAD")


def _load() -> str:
    return f"load {os.getloadavg()[0]:.1f}"
