"""Many specimens: one worker against two, one worker killed, a million operators."""

from __future__ import annotations

import os
import re
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks._timing import Row, faster, in_child, seconds, within
from minorloop import Preisach
from minorloop.fleet.simulation import FleetState, simulate_fleet

BANDS, SAMPLES = 20, 2_000


def rows(quick: bool = False) -> list[Row]:
    found = [_million(100_000 if quick else 1_000_000)]
    return [*found, *_fleet(20 if quick else 1_000)]


def _million(operators: int) -> Row:
    rng = np.random.default_rng(0)
    model = Preisach(np.linspace(-1, 1, 51), np.tril(rng.uniform(size=(50, 50))))
    simulate_fleet(model, np.zeros(10))  # compile first
    state, times = FleetState.begin(model, operators), []
    for _ in range(20):
        u = rng.uniform(-1, 1, operators)
        times.append(seconds(lambda u=u: simulate_fleet(model, u, state, in_place=True)))
    peak = _peak_gigabytes()
    said = f"median of 20 steps; slowest {max(times):.2g} s; peak memory {peak:.2g} GB"
    return within(
        f"simulate_fleet, {operators} operators, one step, L = 50",
        float(np.median(times)),
        1.0,
        said,
        peak <= 3.0,
    )


def _fleet(specimens: int) -> list[Row]:
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        _write_records(folder, specimens)
        one, two = (_identified(folder, workers) for workers in (1, 2))
        killed = _identified(folder, 2, kill=True)
    what = f"{specimens} specimens, L = {BANDS}, N = {SAMPLES} each"
    return [
        faster(f"{what}, two workers", two[0], "one worker", one[0], 1.7, f"{two[1]} done", True),
        Row(
            f"{what}, one of two workers killed",
            killed[0],
            required=f"{specimens} done",
            met=killed[1] == specimens,
            accuracy=f"{killed[1]} done",
        ),
    ]


def _write_records(folder: Path, specimens: int) -> None:
    rng, lines = np.random.default_rng(0), ["specimen,file,input,output"]
    base = np.tril(rng.uniform(size=(BANDS, BANDS)))
    for k in range(specimens):
        weights = base * rng.uniform(0.8, 1.2, base.shape)
        model = Preisach(np.linspace(-1, 1, BANDS + 1), weights)
        u = np.concatenate([[-1, 1], rng.uniform(-1, 1, SAMPLES - 2)])
        y = model.simulate(u) + rng.normal(0, 0.05, SAMPLES)
        table, header = np.column_stack([u, y]), "voltage [V],tip [mm]"
        np.savetxt(folder / f"r{k}.csv", table, delimiter=",", header=header, comments="")
        lines.append(f"s{k},r{k}.csv,voltage,tip")
    (folder / "manifest.csv").write_text("\n".join(lines) + "\n")


def _identified(folder: Path, workers: int, kill: bool = False) -> tuple[float, int]:
    """Seconds, and how many were identified; in a process of its own, with its start."""
    said = in_child("-m", "benchmarks.one_fleet", folder, workers, int(kill), time.time())
    took, done = re.findall(r"^([\d.]+) (\d+)$", said, flags=re.MULTILINE)[-1]
    return float(took), int(done)


def _peak_gigabytes() -> float:
    if os.name != "posix":
        return float("nan")
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
