"""The console under load, under attack, and cut off.

A console and four pages over real sockets on this machine. ``MINORLOOP_SEAT_SECONDS`` sets how long
they are connected; 600 is required, 60 is the default.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import tempfile
import time
from itertools import chain
from pathlib import Path

import numpy as np

from benchmarks._console import Page, Server, piloted, recorded
from benchmarks._console_parts import attacked, lab, painted, still
from benchmarks._timing import Row

PAGES = 4
HOSTILE = 10_000


def rows(quick: bool) -> list[Row]:
    """Measure, and return the rows of the report."""
    seconds = 5.0 if quick else float(os.environ.get("MINORLOOP_SEAT_SECONDS", "60"))
    with tempfile.TemporaryDirectory() as folder, Server(folder) as server:
        lab(server, True)  # so that the workers have started and reached their final size
        found = [lab(server, quick), still(), *painted(server)]
        found += asyncio.run(_watched(server, seconds))
        found += asyncio.run(_cut_off(server, Path(folder)))
        found += asyncio.run(attacked(server, 300 if quick else HOSTILE))
        return found


async def _watched(server: Server, seconds: float) -> list[Row]:
    """Measure with four pages, one of which steers."""
    async with contextlib.AsyncExitStack() as stack:
        pilot = await stack.enter_async_context(piloted(server))
        others = [Page(await stack.enter_async_context(server.connect())) for _ in range(PAGES - 1)]
        tasks = [asyncio.create_task(page.listen()) for page in others]
        await asyncio.sleep(10.0)  # until the map and other buffers have their final size
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


async def _cut_off(server: Server, folder: Path) -> list[Row]:
    """Measure the time until HOLD for each way to lose the operator, from recordings."""
    async with server.connect() as socket:
        watcher = Page(socket)
        watching = asyncio.create_task(watcher.listen())
        cuts, found, jump = await _cut(server)
        await asyncio.sleep(0.5)
        watching.cancel()
    recordings = recorded(folder)
    states = sorted([*watcher.states, *chain(*recordings)], key=lambda state: state["t"])
    for name, began in cuts.items():
        first = next(s for s in states if s["t"] > began and s["mode"] == "HOLD")
        found.append(_held(name, first["t"] - began, stopped=first["rates"] == [0.0, 0.0]))
    gaps = sum(int(np.sum(np.diff([s["seq"] for s in each]) != 1)) for each in recordings)
    count = sum(map(len, recordings))
    found.append(
        Row(
            "to continue after that",
            0.0,
            required="no jump, nothing lost",
            met=jump <= 0.1 and gaps == 0,
            accuracy=f"{jump:.3f} degrees; {gaps} gaps in {count} recorded states",
        )
    )
    return found


async def _cut(server: Server) -> tuple[dict[str, float], list[Row], float]:
    """Return the time of each way, the row of the first, and the jump at the end."""
    found = []
    async with piloted(server) as page:
        await page.send("record", grant=page.grant, on=True)
        await page.until(lambda: page.recording)
        page.drive["pose"] = None
        began = time.monotonic()
        await page.until(lambda: page.state["t"] > began and page.state["mode"] == "HOLD")
        found.append(_held("pose lost", page.state["t"] - began))
    cuts = {}
    async with piloted(server) as page:
        await page.send("record", grant=page.grant, on=True)
        page.drive["stick"] = [1.0, 0.0]
        await asyncio.sleep(1.0)
        page.tasks[1].cancel()
        cuts["page silent"] = time.monotonic()
        await page.until(lambda: page.state["mode"] == "HOLD")
    async with piloted(server) as page:
        await page.send("record", grant=page.grant, on=True)
        page.drive["stick"] = [1.0, 0.0]
        await asyncio.sleep(1.0)
        cuts["link cut"] = time.monotonic()
        page.socket.transport.abort()
    await asyncio.sleep(1.0)
    jump = 0.0
    async with piloted(server) as page:
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
