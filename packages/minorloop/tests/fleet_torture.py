"""``PYTHONPATH=tests python -m fleet_torture [TIMES]``: fleets whose workers or scheduler are lost.

Each fault is caused that many times, 20 if nothing is said, on fleets of their own on this
machine. Printed are the seconds until it was said on stderr, until the command ended or went on,
and whether all specimens were there in the end, those done before kept as they were.
"""

import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import psutil

from fleet_records import write_manifest, write_record

SPECIMENS = 12
PATIENCE = 6
LIMIT = 12
AT_ONCE = 3
WITHIN = 10.0
"""Seconds within which a fault has to be said."""
OPTIONS = ["--law", "levels=6", "--prior", "smooth", "--limit", str(LIMIT)]
COMMAND = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in what a shell runs behind
from minorloop.fleet import identification
import fleet_faults
identification.identify_one = fleet_faults.work
from minorloop.cli import main
sys.exit(main(sys.argv[1:]))
"""


@dataclass
class Trial:
    """What was seen of one fault."""

    said: float
    ended: float
    status: int
    whole: bool
    orphans: int


HERE = {**os.environ, "PYTHONPATH": str(Path(__file__).parent)}
"""The environment of processes that run in other folders and import what tests share."""


@dataclass
class Fleet:
    """The command in a process of its own, and what it said when."""

    folder: Path
    arguments: list
    lines: list = field(default_factory=list)

    def start(self):
        names = ("fleet", "identify", "manifest.csv", "--out", "out", *OPTIONS, *self.arguments)
        self.process = subprocess.Popen(
            [sys.executable, "-c", COMMAND, *names],
            cwd=self.folder,
            env=HERE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        return self

    def done(self):
        return len(list((self.folder / "out" / "results").glob("*.json")))

    def wait_for(self, pattern):
        """When it first said so, or None if it never did."""
        for line in self.process.stderr:
            self.lines.append(line.rstrip())
            if re.search(pattern, line):
                return time.monotonic()
        return None

    def until(self, condition):
        """Wait until something is so; where the command ends before, show what it said."""
        until(lambda: condition() or self.process.poll() is not None)
        if not condition():
            raise AssertionError(f"{self.process.wait()}: {self.process.stderr.read()}")

    def end(self):
        self.process.stderr.read()
        return self.process.wait()


def make(folder, names):
    """Records, and a manifest."""
    for k, name in enumerate(names):
        write_record(folder / f"{name}.csv", k)
    write_manifest(folder, names)


def until(condition, seconds=300.0):
    """Wait until something is so."""
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError("what was waited for did not happen")
        time.sleep(0.01)


@contextmanager
def cluster(folder, workers=2):
    """A scheduler and workers, each a process of its own; gives both and the address."""
    place = folder / "scheduler.json"
    with ExitStack() as opened:

        def start(module, *arguments):
            process = subprocess.Popen(
                [sys.executable, "-m", f"distributed.cli.{module}", *arguments],
                cwd=folder,
                env=HERE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            opened.callback(process.wait)
            opened.callback(process.kill)
            return process

        local = "--no-dashboard", "--scheduler-file", str(place)
        scheduler = start("dask_scheduler", "--host", "127.0.0.1", "--port", "0", *local)
        until(lambda: place.exists() and "tcp://" in place.read_text())
        address = re.search(r"tcp://[\d.:]+", place.read_text())[0]
        threads = "--nthreads", "1", "--no-nanny"
        yield scheduler, [start("dask_worker", *local, *threads) for _ in range(workers)], address


def kept(folder):
    return {file.name: file.read_bytes() for file in (folder / "out" / "results").glob("*.json")}


def finish(folder, before):
    """Do the rest here; whether it is whole and what was done is as it was."""
    with Fleet(folder, ["--workers", "1"]).start().process as process:
        process.stderr.read()
    after = kept(folder)
    same = all(after.get(name) == content for name, content in before.items())
    return same and len(after) == len((folder / "manifest.csv").read_text().splitlines()) - 1


def on_cluster(fault, pattern):
    """A fault of a cluster in the middle of a fleet, of which one specimen waits till then."""

    def trial(folder):
        make(folder, [*(f"s{k}" for k in range(SPECIMENS)), "wait"])
        (folder / "wait.closed").touch()
        with cluster(folder) as (scheduler, workers, address):
            fleet = Fleet(folder, ["--workers", address, "--patience", str(PATIENCE)]).start()
            fleet.until(lambda: fleet.done() >= SPECIMENS // 2)
            began = time.monotonic()
            fault(scheduler, workers)
            said = fleet.wait_for(pattern)
            status = fleet.end()
            ended, before = time.monotonic(), kept(folder)
            for one in (scheduler, *workers):
                with suppress(ProcessLookupError):
                    one.send_signal(signal.SIGCONT)
        (folder / "wait.closed").unlink()
        whole = finish(folder, before)
        return Trial(since(began, said), ended - began, status, whole, orphans(folder))

    return trial


def locally(names, pattern, fault=None, status=0):
    """What local workers do to themselves, or is done to the command while they do it."""

    def trial(folder):
        make(folder, [*names, *(f"s{k}" for k in range(SPECIMENS))])
        fleet = Fleet(folder, ["--workers", "2"]).start()
        fleet.until(lambda: all((folder / f"{name}.seen").exists() for name in names))
        began = time.monotonic()
        if fault is not None:
            fleet.until(lambda: fleet.done() >= SPECIMENS // 2)
            began = time.monotonic()
            fault(fleet.process)
        said = fleet.wait_for(pattern)
        found = fleet.end()
        ended, left, before = time.monotonic(), orphans(folder), kept(folder)
        whole = finish(folder, before) if status else len(before) == SPECIMENS + len(names)
        return Trial(since(began, said), ended - began, found, whole, left)

    return trial


def since(began, said):
    return float("inf") if said is None else said - began


def orphans(folder):
    """Worker processes that outlive their fleet by a second."""

    def left():
        return [
            one.pid
            for one in psutil.process_iter(["cmdline", "ppid"])
            if "fleet._worker" in " ".join(one.info["cmdline"] or ()) and one.info["ppid"] == 1
        ]

    with suppress(TimeoutError):
        until(lambda: not left(), 1.0)
    return len(left())


def send(number):
    return lambda scheduler, workers: [one.send_signal(number) for one in workers]


FAULTS = {
    "scheduler killed": on_cluster(lambda scheduler, workers: scheduler.kill(), "scheduler"),
    "scheduler stopped": on_cluster(
        lambda scheduler, workers: scheduler.send_signal(signal.SIGSTOP), "scheduler"
    ),
    "all workers of a cluster leave": on_cluster(send(signal.SIGTERM), "no worker at"),
    "all workers of a cluster killed": on_cluster(send(signal.SIGKILL), "no worker at"),
    "all workers of a cluster stopped": on_cluster(send(signal.SIGSTOP), "no worker at"),
    "endless fit": locally(["hang"], "specimen hang has run for"),
    "all local workers killed": locally(["die-once-0", "die-once-1"], "once more"),
    "Control-C during an endless fit": locally(
        ["hang"], "interrupted", lambda process: process.send_signal(signal.SIGINT), 130
    ),
    "the command killed in an endless fit": locally(
        ["hang"], "$^", lambda process: process.kill(), -9
    ),
}
STATUS = {name: 2 for name in FAULTS if "cluster" in name or "scheduler" in name}
STATUS |= {"Control-C during an endless fit": 130, "the command killed in an endless fit": -9}


def in_a_folder(trial):
    with tempfile.TemporaryDirectory() as folder:
        return trial(Path(folder))


def main(times):
    print(f"{'fault':<36} times  said s (most)  ended s (most)  whole  orphans  status")
    good = True
    for name, trial in FAULTS.items():
        with ThreadPoolExecutor(AT_ONCE) as pool:
            seen = list(pool.map(in_a_folder, [trial] * times))
        said, ended = max(one.said for one in seen), max(one.ended for one in seen)
        whole, left = sum(one.whole for one in seen), sum(one.orphans for one in seen)
        status = sorted({one.status for one in seen})
        good &= (
            (said <= WITHIN or status[0] == -9)
            and whole == times
            and not left
            and status == [STATUS.get(name, 0)]
        )
        print(
            f"{name:<36} {times:>5} {said:>14.2f} {ended:>15.2f} {whole:>6} {left:>8}  {status}",
            flush=True,
        )
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 20))
