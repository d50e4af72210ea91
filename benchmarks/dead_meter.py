"""Whether a dead meter ends a run, and one that works does not: ``--seed S`` for another block."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks._plants import Array
from benchmarks._timing import Row, seconds

SEEDS = 20
ACTUATORS = {"twin:ipmc": (-1.2, 1.2), "twin:fibre": (0.2, 0.65), "twin:wire": (0.0, 0.3)}
"""Ranges of the plans; a wire does not move below 0.2 A or so."""
STEPS = (0.0, 1e-3, 0.01, 1 / 16)
"""Resolution of a meter that works, over the range of its readings."""
NOISE = 1e-3
"""Standard deviation of the noise, over the range; the meters of every other seed have none."""
HOLD, INTERVAL, HOLDS = 20.0, 1.0, 16
AFTER = 3
"""Holds after which a dead meter is to end a run that swings from end to end."""


class _Metered:
    """A twin that is read by a meter with a resolution and noise, which may die."""

    def __init__(self, address: str, seed: int, digit: float, noise: float, dies: int) -> None:
        from minorloop.connect import connect

        self._twin, self._chance = connect(address, specimen=seed), np.random.default_rng(seed)
        self.inputs, self.outputs, self.tick = self._twin.inputs, self._twin.outputs, INTERVAL
        self._digit, self._noise, self._dies = digit, noise, dies
        self._levels: list[float] = []
        self.exact: list[Array] = []
        self._reading = 0.0

    def apply(self, u: float, duration: float, sample_interval: float):
        from minorloop.lab.records import Record

        record = self._twin.apply(u, duration, sample_interval)
        if self._levels[-1:] != [u]:
            self._levels.append(u)
            self.exact.append(np.zeros(0))
        self.exact[-1] = np.append(self.exact[-1], record.y)
        y = record.y + self._noise * self._chance.normal(size=record.y.size)
        if self._digit:
            y = np.round(y / self._digit) * self._digit
        if len(self._levels) > self._dies:
            y = np.full(y.size, self._reading)
        self._reading = float(y[-1])
        return Record(record.u, y, record.t, record.inputs, record.outputs)

    def exchange(self, u: float) -> float:
        return float(self.apply(u, self.tick, self.tick).y[-1])

    def safe(self) -> None:
        self._twin.safe()


def rows(quick: bool = False, seed: int = 0) -> list[Row]:
    block = range(seed, seed + (2 if quick else SEEDS))
    with tempfile.TemporaryDirectory(dir="/dev/shm" if os.path.isdir("/dev/shm") else None) as name:
        return [_dead(Path(name), block), _sound(Path(name), block)]


def _dead(folder: Path, block: range) -> Row:
    held: list[float] = []

    def measure() -> None:
        for address, (low, high) in ACTUATORS.items():
            for seed in block:
                for dies in (0, HOLDS // 2):
                    swings = [low, high] * HOLDS
                    ended, holds, _ = _ended(folder, address, seed, swings, 1e-3, dies)
                    held.append(holds - dies if ended else np.inf)

    taken = seconds(measure)
    late = sum(holds > AFTER for holds in held)
    return Row(
        f"{len(held)} meters that die, seeds {block.start} to {block.stop - 1}",
        taken,
        required=f"the run ends after {AFTER} holds",
        met=not late,
        accuracy=f"{late} later; most holds {max(held)}",
    )


def _sound(folder: Path, block: range) -> Row:
    stopped: list[str] = []
    runs = unmoved = 0

    def measure() -> None:
        nonlocal runs, unmoved
        for address, ends in ACTUATORS.items():
            for seed in block:
                for name, levels in _plans(*ends, seed):
                    for step in STEPS:
                        runs += 1
                        ended, _, exact = _ended(folder, address, seed, levels, step, 10**6)
                        if ended:
                            unmoved += not np.ptp(np.concatenate(exact[-AFTER:]))
                            stopped.append(f"{address} {name} 1/{1 / step if step else np.inf:.0f}")

    taken = seconds(measure)
    kinds = ", ".join(f"{stopped.count(one)} x {one}" for one in sorted(set(stopped)))
    return Row(
        f"{runs} runs with a meter that works, seeds {block.start} to {block.stop - 1}",
        taken,
        required="none ends while the actuator moves",
        met=len(stopped) == unmoved,
        accuracy=f"{len(stopped)} end, {unmoved} of them after {AFTER} holds in which the actuator "
        f"itself did not move: {kinds}",
    )


def _plans(low: float, high: float, seed: int) -> Iterator[tuple[str, Array]]:
    chance = np.random.default_rng(seed)
    yield "random", chance.uniform(low, high, HOLDS)
    yield "ends", np.array([low, high] * (HOLDS // 2))
    yield "staircase", np.concatenate([np.linspace(low, high, 11), np.linspace(high, low, 11)])
    yield "small steps", low + 0.1 * (high - low) * chance.random(HOLDS)


def _ended(
    folder: Path, address: str, seed: int, levels: Array, step: float, dies: int
) -> tuple[bool, int, list[Array]]:
    """Whether the meter ended a run, how many points it has, and the outputs in each hold."""
    from minorloop.errors import InstrumentError
    from minorloop.lab.plan import Plan
    from minorloop.lab.run import run
    from minorloop.lab.store import Setup, Store

    twin = _Metered(address, seed, 0.0, 0.0, 10**6)
    span = float(np.ptp([twin.apply(u, HOLD, INTERVAL).y for u in levels]))
    plant = _Metered(address, seed, step * span, NOISE * span * (seed % 2), dies)
    u, y = str(plant.inputs[0]), str(plant.outputs[0])
    plan = Plan(levels, HOLD, sample_interval=INTERVAL, input=u)
    path = folder / f"{len(list(folder.iterdir()))}"
    with Store.create(path, plan, Setup(address, u, y)) as store:
        try:
            run(plant, plan, store)
        except InstrumentError:
            return True, len(store), plant.exact
        return False, len(store), plant.exact


if __name__ == "__main__":
    for row in rows("--quick" in sys.argv, int(sys.argv[sys.argv.index("--seed") + 1])):
        print(*row.cells(), sep="; ")
