"""A run of very many holds: what a hold costs from first to last, and what readers cost it."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import resource
import secrets
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks._plants import Array
from benchmarks._timing import Row, within

HOLDS, SOME = 100_000, 10_000
"""Holds of a run, and how many of its first and of its last ones are compared."""
READ = 3_000
"""Holds of a run while others read its store."""
READERS, DRAWS = 2, 10
SAMPLES, INTERVAL = 10, 0.1
"""Readings of a hold, and seconds between them."""
GROWTH, SHOW, DELAY = 1.3, 1.0, 0.005
MEMORY = "/dev/shm"
"""A folder without a disk, whose speed would hide that of the program."""


class _FastMeter:
    """An actuator whose output follows at once, read with noise and without waiting."""

    def __init__(self, seed: int) -> None:
        from minorloop.lab.actuator import Channel

        self.inputs, self.outputs = (Channel("voltage", "V", -1.0, 1.0),), (Channel("tip", "mm"),)
        self.tick = INTERVAL
        self._chance, self._clock = np.random.default_rng(seed), 0.0

    def apply(self, u: float, duration: float, sample_interval: float):
        from minorloop.lab.records import Record

        t = self._clock + sample_interval * np.arange(1, round(duration / sample_interval) + 1)
        self._clock += duration
        y = 2.0 * u + u**3 + 0.001 * self._chance.normal(size=t.size)
        return Record(np.full(t.size, u), y, t, "voltage [V]", "tip [mm]")

    def exchange(self, u: float) -> float:
        return float(self.apply(u, self.tick, self.tick).y[-1])

    def safe(self) -> None:
        pass


def rows(quick: bool = False) -> list[Row]:
    holds, some, read = (2_000, 500, 300) if quick else (HOLDS, SOME, READ)
    seed = secrets.randbelow(10**6)
    with tempfile.TemporaryDirectory(dir=MEMORY if os.path.isdir(MEMORY) else None) as folder:
        path = Path(folder) / "long.sqlite"
        costs, _ = _carried_out(path, holds, seed)
        first, last = costs[:some].mean(), costs[-some:].mean()
        grown = Row(
            f"processor time of a hold, the last {some} of {holds}",
            last,
            f"the first {some}",
            first,
            last / first,
            f"<= {GROWTH} times as long",
            last <= GROWTH * first,
            f"each tenth of the run: {_listed(costs)} ms; seed {seed}",
        )
        show_it = "runs", "show", "--store", str(path)
        _processor_time(Path(folder), *show_it)  # compiles the modules
        shown = [_processor_time(Path(folder), *show_it) for _ in range(DRAWS)]
        nothing = _processor_time(Path(folder), "--version")
        show = within(
            f"minorloop runs show, {holds} points, worst of {DRAWS}",
            max(shown),
            SHOW,
            f"median {np.median(shown):.2f} s; {nothing:.2f} s of a command that does nothing",
        )
        return [grown, show, _read(Path(folder), read, seed)]


def _carried_out(path: Path, holds: int, seed: int) -> tuple[Array, Array]:
    """Processor time of each hold, and of writing each point, in seconds.

    A write that another process locks out is an error: once the first point has made the store one
    that others can read, it does not wait. So what others cost a write is processor time, and no
    other load of the machine counts.
    """
    from minorloop.lab.plan import Plan
    from minorloop.lab.run import run
    from minorloop.lab.store import Setup, Store

    levels = np.random.default_rng(seed).uniform(-1, 1, holds)
    plan = Plan(levels, SAMPLES * INTERVAL, sample_interval=INTERVAL, input="voltage [V]")
    at, written = [time.process_time()], []

    class Timed(Store):
        def add(self, *point: object) -> None:
            began = time.process_time()
            super().add(*point)
            written.append(time.process_time() - began)
            if len(written) == 1:
                self._execute("PRAGMA busy_timeout = 0")

    with Timed.create(path, plan, Setup("bench", "voltage [V]", "tip [mm]")) as store:
        run(
            _FastMeter(seed),
            plan,
            store,
            watch=lambda progress: progress.point and at.append(time.process_time()),
        )
    return np.diff(at), np.array(written)


def _listed(costs: Array) -> str:
    return " ".join(f"{1e3 * part.mean():.2f}" for part in np.array_split(costs, 10))


def _processor_time(folder: Path, *arguments: str) -> float:
    """Processor time of a command whose modules are compiled in a folder, in seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-m", "minorloop", *arguments]
    environment = {**os.environ, "PYTHONPYCACHEPREFIX": str(folder / "modules")}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=environment)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _read(folder: Path, holds: int, seed: int) -> Row:
    """Compare the writes of a run that nobody reads with those of one that others read."""
    _, alone = _carried_out(folder / "alone.sqlite", holds, seed)
    path = folder / "read.sqlite"
    with _readers(path) as looks:
        _, read = _carried_out(path, holds, seed)
        looked = looks.value
    percent = np.percentile(read, [50, 99, 100]) - np.percentile(alone, [50, 99, 100])
    return within(
        f"a write while {READERS} processes read, longest of {holds}, more than alone",
        max(percent[2], 0.0),
        DELAY,
        f"median {1e3 * percent[0]:+.2f}, 99th percentile {1e3 * percent[1]:+.2f} ms (alone "
        f"{1e3 * alone.max():.2f} ms at most); the store was read {looked} times, and no "
        "write found it locked",
        looked > holds / 100,
    )


@contextlib.contextmanager
def _readers(path: Path) -> Iterator[object]:
    """Processes that open and read a store again and again; how often, as a shared number."""
    spawn = multiprocessing.get_context("spawn")
    looks, ended, begun = spawn.Value("q", 0), spawn.Event(), spawn.Barrier(READERS + 1)
    several = [
        spawn.Process(target=_look, args=(path, looks, ended, begun)) for _ in range(READERS)
    ]
    for process in several:
        process.start()
    begun.wait()
    try:
        yield looks
    finally:
        ended.set()
        for process in several:
            process.join()


def _look(path: Path, looks, ended, begun) -> None:
    from minorloop.lab.store import Store

    begun.wait()
    while not ended.is_set():
        if not path.exists():
            time.sleep(0.01)
            continue
        with Store.open(path) as store:
            store.totals(), store.points(max(len(store) - 1000, 0)), store.finished
        with looks.get_lock():
            looks.value += 1


if __name__ == "__main__":
    for row in rows("--quick" in sys.argv):
        print(*row.cells(), sep="; ")
