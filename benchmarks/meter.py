"""Whether stored times are true, however long a meter takes for an answer."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks._timing import Row, readable

ANSWERS = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0)
"""Seconds that the meter takes for an answer."""
TOGETHER = 0.03
"""From here on the instruments are measured at the same time, as they wait for most of it."""
HOLDS = 20
SHORTEST = 0.5
"""Seconds of the shortest hold; a hold is ten answers long at least."""
PATIENCE = 60.0
"""Seconds of holds on one instrument; the rest is measured on others like it."""
MOST = 0.05
"""Share by which a stored time may differ from the true one."""


def rows(quick: bool = False) -> list[Row]:
    answers, holds = (ANSWERS[:5], 4) if quick else (ANSWERS, HOLDS)
    found = [_row(answer, holds) for answer in answers if answer < TOGETHER]
    with ThreadPoolExecutor(len(answers)) as pool:
        slow = [answer for answer in answers if answer >= TOGETHER]
        return found + list(pool.map(lambda answer: _row(answer, holds), slow))


@dataclass(frozen=True)
class _Errors:
    """Worst differences between what a store tells and what the instrument noted."""

    held: float
    samples: float
    points: float
    longer: float
    beyond: int
    unsettled: int


def _row(answer: float, holds: int) -> Row:
    each = min(holds, max(1, int(PATIENCE / _hold(answer))))
    parts = [each] * (holds // each) + ([holds % each] if holds % each else [])
    began = time.perf_counter()
    with ThreadPoolExecutor(len(parts)) as pool:
        found = list(pool.map(lambda part: _measured(answer, part), parts))
    taken = time.perf_counter() - began
    held, samples, points, longer = (
        max(getattr(errors, name) for errors in found)
        for name in ("held", "samples", "points", "longer")
    )
    beyond, unsettled = (
        sum(getattr(errors, name) for errors in found) for name in ("beyond", "unsettled")
    )
    accuracy = (
        f"worst error of held {held:.2%}, of a sample {samples:.2%} of its hold, of a point "
        f"{points:.2%}; {beyond} samples beyond their uncertainty; {unsettled} unsettled; an input "
        f"is on for up to {readable(longer)} more while its point is written"
    )
    what = f"{holds} holds of a constant with a meter on TCP that takes {readable(answer)}"
    required = f"times within {MOST:.0%}, 0 unsettled"
    met = max(held, samples, points) <= MOST and beyond == unsettled == 0
    return Row(what, taken, required=required, met=met, accuracy=accuracy)


def _hold(answer: float) -> float:
    return max(SHORTEST, 10 * answer)


def _measured(answer: float, holds: int) -> _Errors:
    command = [sys.executable, "-m", "benchmarks._slow_meter", str(answer)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            return _compared(_Line(int(process.stdout.readline())), answer, holds)
        finally:
            process.terminate()


class _Line:
    """A line over TCP, as a `Link` is."""

    def __init__(self, port: int) -> None:
        self.name = f"127.0.0.1:{port}"
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=30)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._file = self._socket.makefile("r", encoding="ascii")

    def send(self, text: str) -> None:
        self._socket.sendall(f"{text}\n".encode())

    def ask(self, text: str) -> str:
        self.send(text)
        return self.read()

    def read(self) -> str:
        return self._file.readline().strip()

    def flush(self) -> None:
        pass

    def close(self) -> None:
        self._socket.close()


def _compared(link: _Line, answer: float, holds: int) -> _Errors:
    """Carry a plan out and compare the store with the log of the instrument."""
    from minorloop.lab.actuator import Channel
    from minorloop.lab.drivers.bench import Bench
    from minorloop.lab.drivers.visa import Commands, ScpiMeter, ScpiSource
    from minorloop.lab.plan import Plan
    from minorloop.lab.run import run
    from minorloop.lab.store import Setup, Store

    voltage, tip = Channel("voltage", "V", -1.0, 1.0), Channel("tip", "mm")
    bench = Bench(
        ScpiSource(link, Commands(safe=["VOLT 0", "OUTP OFF"], confirm="VOLT?")),
        ScpiMeter(link),
        voltage,
        tip,
    )
    bench.check()
    levels = [0.5 if k % 2 else -0.5 for k in range(holds)]
    hold = _hold(answer)
    plan = Plan(levels, hold, hold, input=str(voltage)).slowed(bench.answer_time())
    setup = Setup("bench", str(voltage), str(tip))
    with (
        tempfile.TemporaryDirectory() as folder,
        Store.create(Path(folder) / "run.sqlite", plan, setup) as store,
    ):
        run(bench, plan, store)
        points = store.points()
        traces = [store.trace(k)[0] for k in range(holds)]
    log = json.loads(link.ask("LOG?"))
    link.close()
    return _errors(points, traces, log)


def _errors(points: list[Any], traces: list[np.ndarray], log: dict[str, Any]) -> _Errors:
    """How far stored times are from those of the instrument."""
    first = next(k for k, (_, level) in enumerate(log["set"]) if level != 0.0)
    put = np.array([t for t, _ in log["set"][first:]])  # the last of them makes safe
    reads = np.array([time for *time, level in log["read"] if level != 0.0])
    held = np.array([point.held for point in points])
    began = np.array([point.t for point in points]) - held
    true = np.split(reads, np.cumsum([t.size for t in traces])[:-1])
    off = [np.abs(t - (mine[:, 0] - on)) for t, mine, on in zip(traces, true, put, strict=False)]
    # What the instrument knows: a hold ends after its last answer, and before the next input.
    least = np.array([mine[-1, 1] for mine in true]) - put[: held.size]
    most = np.diff(put)[: held.size]
    passed = np.maximum(put[: held.size] - put[0], held)
    return _Errors(
        held=float(np.max(np.maximum(least - held, held - most) / most, initial=0.0)),
        samples=max(float(each.max() / length) for each, length in zip(off, held, strict=True)),
        points=float(np.max(np.abs(began - (put[: held.size] - put[0])) / passed)),
        longer=float(np.max(most - held)),
        beyond=sum(
            int((each > point.time_uncertainty).sum())
            for each, point in zip(off, points, strict=True)
        ),
        unsettled=sum(point.verdict == "unsettled" for point in points),
    )
