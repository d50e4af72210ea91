"""``python -m benchmarks.late_readings``: readings that are late, and others that only seem so.

A head by its camera alone is driven in changing surroundings, with readings in time and late ones.
Counted are the runs in which the guard calls the readings late.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable

import numpy as np

from minorloop_head.control.head import LEAD, HeadControl, camera_control
from minorloop_head.twins.head import Head
from minorloop_head.twins.surroundings import Course, Surroundings
from papers.catheter.head_static import identify_head

TICK, SECONDS = 0.04, 24.0
AGE = 0.06
"""Age of readings in time, in seconds: one to two ticks."""
NOISE = 0.02
LATE = (0.4, 0.5, 0.7, 1.0, 1.5, 2.0)
SINCE = 10.0
"""Seconds after which readings become late, in half of the runs; in the others they always are."""


def sway(period: float) -> Surroundings:
    return Surroundings(load=Course(0.0, amplitude=2e-3, period=period))


AROUND = {
    "as identified": Surroundings(),
    "0 C": Surroundings(ambient=0.0),
    "-10 C": Surroundings(ambient=-10.0),
    "45 C": Surroundings(ambient=45.0),
    "colder by 20 K at 6 s": Surroundings(ambient=Course(20.0, 0.0, at=6.0, duration=0.5)),
    "ambient swings by 15 K in 1.5 s": Surroundings(ambient=Course(20.0, amplitude=15, period=1.5)),
    "cooled a fifth as much": Surroundings(convection=15.0),
    "cooled five times as much": Surroundings(convection=400.0),
    "flooded at 7 s": Surroundings(convection=Course(75.0, 300.0, at=7.0, duration=0.5)),
    "drained at 9 s": Surroundings(convection=Course(300.0, 75.0, at=9.0, duration=1.0)),
    "swayed in 0.7 s": sway(0.7),
    "swayed in 1 s": sway(1.0),
    "swayed in 3 s": sway(3.0),
    "pushed at 8 s": Surroundings(load=Course(0.0, 3e-3, at=8.0, duration=0.2)),
}
WAYS: dict[str, Callable[[float], tuple[float, float]]] = {
    "steps": lambda t: [(40.0, 20.0), (20.0, 40.0), (30.0, 10.0), (35.0, 30.0)][int(t / 6)],
    "quick steps": lambda t: [(45.0, 10.0), (5.0, 45.0), (35.0, 35.0), (15.0, 5.0)][int(t / 3) % 4],
    "swings": lambda t: (25.0 + 10 * math.sin(0.8 * t), 25.0 + 10 * math.cos(2 * t)),
}


def called_late(
    control: HeadControl,
    seed: int,
    way: str,
    *,
    late: float = 0.0,
    since: float = 0.0,
    around: Surroundings | None = None,
) -> float:
    """Return when readings are first called late, in seconds; infinity if they are not."""
    head = Head(seed, NOISE, seed, delay=AGE, surroundings=around)
    state, every = control.begin(), [np.zeros(2)]
    for k in range(round(SECONDS / TICK)):
        t = k * TICK
        older = round(late / TICK) if t >= since else 0
        read = every[max(len(every) - 1 - older, 0)]
        current, state = control.step(state, WAYS[way](t), read, t=t)
        every.append(head.exchange(current))
        if any(axis.lateness.late for axis in state.axes):
            return t
    return math.inf


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--specimens", type=int, default=4)
    parser.add_argument("--seed", type=int, default=1000, help="of the first specimen")
    chosen = parser.parse_args()

    from rich.console import Console
    from rich.table import Table

    in_time = {name: [] for name in AROUND}
    late = {(seconds, since): [] for seconds in LATE for since in (0.0, SINCE)}
    for seed in range(chosen.seed, chosen.seed + chosen.specimens):
        wires, coupling = identify_head(seed)
        control = camera_control("observer", wires, coupling=coupling, lead=LEAD)
        for name, around in AROUND.items():
            in_time[name] += [called_late(control, seed, way, around=around) for way in WAYS]
        for seconds, since in late:
            when = called_late(control, seed, "steps", late=seconds, since=since)
            late[seconds, since].append(when - since)

    table = Table("readings in time", "runs", "called late")
    for name, when in in_time.items():
        table.add_row(name, str(len(when)), str(int(np.isfinite(when).sum())))
    found = Table("late by [s]", "from [s]", "runs", "called late", "after, median (longest) [s]")
    for (seconds, since), when in late.items():
        after = [each for each in when if math.isfinite(each)] or [math.nan]
        times = f"{np.median(after):.1f} ({max(after):.1f})"
        called = str(int(np.isfinite(when).sum()))
        found.add_row(f"{seconds:g}", f"{since:g}", str(len(when)), called, times)
    for each in (table, found):
        Console(width=120).print(each)


if __name__ == "__main__":
    main()
