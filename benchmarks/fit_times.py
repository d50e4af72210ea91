"""Processor time of a fit: ten draws of each of eight shapes of input, and the worst of them.

``python -m benchmarks.fit_times --seed S`` draws the records from the seeds S to S + 9.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from benchmarks._timing import Row
from minorloop import Preisach
from minorloop.identification.pipeline import Options
from minorloop.lab.records import Record

Array = np.ndarray
Shape = Callable[[np.random.Generator, int], Array]
SIZES = {
    (50, 1_000): 0.5, (100, 1_000): 1.0, (100, 20_000): 2.5, (200, 10_000): 8.0,
}  # fmt: skip
"""Levels and samples, and most seconds of processor time of the worst draw."""
OPTIONS: dict[str, dict[str, Any]] = {"smoothness 0": {"smoothness": 0.0}, "default": {}}
DRAWS, QUICK = 10, 2
UNEVEN = 10.0
"""Largest ratio of the worst draw to the median of its size."""
OPTIMAL = 1e-10
"""Largest violation of the optimality conditions."""
NOISE = 0.005


def walk(rng: np.random.Generator, samples: int) -> Array:
    steps = np.cumsum(rng.normal(size=samples))
    return np.asarray(steps / np.abs(steps).max())


def steps(rng: np.random.Generator, samples: int) -> Array:
    return rng.uniform(-1, 1, samples)


def decaying_staircase(rng: np.random.Generator, samples: int) -> Array:
    turns = int(rng.integers(10, 60))
    ends = np.append(-1.0, np.linspace(1, 0, turns, endpoint=False) * (-1.0) ** np.arange(turns))
    ramps = np.interp(np.linspace(0, turns, samples), np.arange(turns + 1), ends)
    return np.asarray(np.round(20 * ramps) / 20)


def reversal_curves(rng: np.random.Generator, samples: int) -> Array:
    levels = np.linspace(0.95, -0.95, int(rng.integers(10, 40)))
    ends = np.append([-1.0, 1.0], np.column_stack([levels, np.ones(levels.size)]))
    way = np.append(0.0, np.cumsum(np.abs(np.diff(ends))))
    return np.interp(np.linspace(0, way[-1], samples), way, ends)


def multisine(rng: np.random.Generator, samples: int) -> Array:
    share = np.arange(samples) / samples
    periods, phase = rng.integers(1, 60, 8), rng.uniform(0, 2 * np.pi, 8)
    sines = np.sin(2 * np.pi * np.outer(share, periods) + phase) @ rng.uniform(0.2, 1, 8)
    return np.asarray(sines / np.abs(sines).max())


def triangle(rng: np.random.Generator, samples: int) -> Array:
    share = np.arange(samples) / samples
    wave = 2 / np.pi * np.arcsin(np.sin(2 * np.pi * rng.uniform(5, 50) * share))
    return np.asarray(wave * (0.2 + 0.8 * np.abs(np.sin(np.pi * rng.uniform(0.5, 3) * share + 1))))


def random_staircase(rng: np.random.Generator, samples: int) -> Array:
    held = int(rng.integers(2, 12))
    return np.repeat(rng.uniform(-1, 1, samples // held + 1), held)[:samples]


def decaying_oscillation(rng: np.random.Generator, samples: int) -> Array:
    share = np.arange(samples) / samples
    return np.cos(2 * np.pi * rng.integers(15, 120) * share) * (1 - share)


SHAPES = (
    walk, steps, decaying_staircase, reversal_curves,
    multisine, triangle, random_staircase, decaying_oscillation,
)  # fmt: skip


def a_record(shape: Shape, bands: int, samples: int, seed: int) -> tuple[Preisach, Array, Array]:
    """A rough or a smooth plane, an input of this shape, and its outputs with noise."""
    rng, grid = np.random.default_rng([seed, bands, samples]), np.linspace(-1, 1, bands)
    density = rng.uniform(0, 1, (bands, bands))
    if rng.random() < 0.5:
        near = rng.uniform(1, 8) * (grid[:, None] - grid) ** 2
        far = rng.uniform(0, 2) * (grid[:, None] + grid) ** 2
        density = np.exp(-near - far) * (0.7 + 0.6 * density)
    model = Preisach.from_density(np.linspace(-1, 1, bands + 1), np.tril(density))
    u = shape(rng, samples)
    y = model.simulate(u)
    return model, u, y + NOISE * np.ptp(y) * rng.normal(size=samples)


def measured(bands: int, samples: int, seeds: range, name: str) -> Row:
    """The worst and the median draw of one size."""
    options, most = OPTIONS[name], SIZES[bands, samples]
    found = []
    for shape in SHAPES:
        for seed in seeds:
            model, u, y = a_record(shape, bands, samples, seed)
            began = time.process_time()
            fit = Options.of({"levels": model.levels, **options}).identify(Record(u, y))
            found.append((time.process_time() - began, shape.__name__, seed, fit.kkt))
    times = [one[0] for one in found]
    worst, shape, seed, _ = max(found)
    middle, kkt = float(np.median(times)), max(one[3] for one in found)
    met = worst <= most and worst <= UNEVEN * middle and kkt <= OPTIMAL
    accuracy = f"median {middle:.2f} s; worst {shape} of seed {seed}; kkt {kkt:.0e}"
    required = f"worst <= {most:g} s of the processor, {UNEVEN:g} medians"
    what = f"identify L = {bands}, N = {samples:,}, {name}, {len(SHAPES)} shapes"
    return Row(what, worst, required=required, met=met, accuracy=accuracy)


def rows(quick: bool = False) -> list[Row]:
    return list(found_rows(range(QUICK if quick else DRAWS), list(SIZES)[: 1 if quick else None]))


def found_rows(seeds: range, sizes: list[tuple[int, int]]) -> Iterator[Row]:
    """A row for each size and each set of options, once the kernels are loaded."""
    for name, options in OPTIONS.items():
        for shape in SHAPES:
            model, u, y = a_record(shape, 40, 900, 0)
            Options.of({"levels": model.levels, **options}).identify(Record(u, y))
        for bands, samples in sizes:
            yield measured(bands, samples, seeds, name)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fit_times", description=__doc__)
    parser.add_argument("--seed", type=int, default=0, help="first seed")
    first = parser.parse_args().seed
    for row in found_rows(range(first, first + DRAWS), list(SIZES)):
        print(*row.cells(), sep="; ", flush=True)


if __name__ == "__main__":
    main()
