"""Runs on instruments that go wrong: what is left on, and what is in the store."""

from __future__ import annotations

import json
import random
import signal
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from faults.instruments import KINDS, LONGEST, SIGNALS, TROUBLES, Fault, Supply
from minorloop.lab.store import Store
from offspring import started

PLAN = "voltage [V],hold [s]\n0.5,0.2\n-0.25,0.2\n"
RUN = "run --actuator visa:bench.json --plan plan.csv --holds interval=0.02 --store s.sqlite"
RESUME = "resume --store s.sqlite"
ENDS = (0, 2, 130)
"""Exit statuses of a run that left its source off, as it says."""
UNSAFE = 3
DEADLY = tuple(getattr(signal, name).value for name in SIGNALS)
_TIMEOUT, _SAFE_WITHIN, _MUTE_WITHIN = 0.4, 10.0, 0.3


@dataclass(frozen=True)
class Case:
    """A run, and what comes in its way.

    Parameters
    ----------
    kind : str
        Of the instrument.
    fault : Fault
        What the instrument does.
    signals : tuple of (float, str)
        Signals at instants, in seconds since the one before.
    """

    kind: str
    fault: Fault = field(default_factory=Fault)
    signals: tuple[tuple[float, str], ...] = ()


@dataclass
class Outcome:
    """What became of a case; each of `FAILURES` has to be 0."""

    points: list[tuple[int, float, float]] = field(default_factory=list)
    lines: int = 0
    seconds: float = 0.0
    status: int = 0
    log: list[str] = field(default_factory=list)
    left_on: int = 0
    lost: int = 0
    twice: int = 0
    differs: int = 0
    hung: int = 0
    said: list[str] = field(default_factory=list)


FAILURES = ("left_on", "lost", "twice", "differs", "hung")


def at_every_line(kind: str, lines: int, faults: tuple[str, ...] = ()) -> Iterator[Case]:
    """A case for each fault at each line of a run."""
    for at in range(lines):
        for name in faults or (*SIGNALS, "double", *TROUBLES):
            yield Case(kind, Fault(name, at))


def at_random(kind: str, count: int, seconds: float) -> Iterator[Case]:
    """Cases of one to three signals at random instants of a run that takes so long."""
    for number in range(count):
        chance = random.Random(f"{kind} {number}")
        first = chance.uniform(0, 1.1 * seconds), chance.choice(SIGNALS)
        more = (
            (chance.uniform(0, 0.05), chance.choice(SIGNALS)) for _ in range(chance.randrange(3))
        )
        yield Case(kind, signals=(first, *more))


def carry_out(case: Case, whole: Outcome | None = None) -> Outcome:
    """Run, resume, and compare with a run that nothing came in the way of."""
    found = Outcome()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        supply = KINDS[case.kind](case.fault, folder)
        try:
            _disturbed(case, supply, folder, found)
            supply.fault = Fault()
            if not found.hung:
                _resumed(supply, folder, found)
        finally:
            supply.close()
    if whole is not None and found.points != whole.points:
        found.differs = 1
        found.said.append(f"the points are {found.points}")
    return found


def _disturbed(case: Case, supply: Supply, folder: Path, found: Outcome) -> None:
    mute = case.fault.kind == "mute"
    _write_files(supply, folder, _MUTE_WITHIN if mute else _SAFE_WITHIN)
    began = time.monotonic()
    status, log = _ended(RUN, supply, folder, found, case.signals)
    found.seconds, found.lines = time.monotonic() - began, supply.heard
    found.status, found.log = status, log
    # Before its first and after its last line a process may die of a signal: nothing is on then.
    fine = status in ENDS or -status in DEADLY or not supply.heard or (mute and status == UNSAFE)
    if (supply.energised and not (mute and status == UNSAFE)) or not fine:
        found.left_on = 1
        found.said.append(f"{case}: status {status}, on: {supply.energised}, {log[-2:]}")
    told = sum(" after " in line for line in log if not line.startswith("error"))
    kept = [point[0] for point in _points(folder)]
    found.lost = max(0, told - len(set(kept)))
    found.twice = len(kept) - len(set(kept))


def _resumed(supply: Supply, folder: Path, found: Outcome) -> None:
    _write_files(supply, folder, _SAFE_WITHIN)
    line = RESUME if (folder / "s.sqlite").exists() else RUN
    status, log = _ended(line, supply, folder, found, ())
    found.points = _points(folder)
    if status or supply.energised:
        found.left_on += 1
        found.said.append(f"resumed: status {status}, on: {supply.energised}, {log[-2:]}")


def _ended(
    line: str, supply: Supply, folder: Path, found: Outcome, signals: tuple[tuple[float, str], ...]
) -> tuple[int, list[str]]:
    """Exit status of a command line, and its log, after the instrument has heard all of it."""
    with started(line, folder) as (process, log):
        supply.victim = process.pid
        for delay, name in signals:
            process.join(delay)
            supply.interrupt(name)
        process.join(LONGEST)
        if process.is_alive():
            found.hung = 1
            found.said.append(f"{line} hangs")
            process.kill()
            process.join()
        supply.victim = None
        said, status = log.readlines(), process.exitcode
    supply.settle()
    return status, said


def _write_files(supply: Supply, folder: Path, within: float) -> None:
    bench: dict[str, Any] = {
        **supply.bench(),
        "input": {"name": "voltage", "unit": "V", "low": -1, "high": 1},
        "output": {"name": "tip", "unit": "mm", "low": -5, "high": 5},
        "timeout": _TIMEOUT,
        "safe_within": within,
    }
    (folder / "bench.json").write_text(json.dumps(bench))
    (folder / "plan.csv").write_text(PLAN)


def _points(folder: Path) -> list[tuple[int, float, float]]:
    if not (folder / "s.sqlite").exists():
        return []
    with Store.open(folder / "s.sqlite") as store:
        return [(point.index, point.input, point.value) for point in store.points()]
