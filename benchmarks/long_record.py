"""Identify from a long record of slow loops in this process: seconds and gigabytes, as JSON."""

from __future__ import annotations

import json
import sys
import time

import numpy as np

from benchmarks._plants import Array
from benchmarks.one_fit import peak_gigabytes
from minorloop import Preisach
from minorloop.identification.pipeline import Options
from minorloop.lab.records import Record

AUTO = dict.fromkeys(("diagonal", "slope", "lag"), "auto")


def a_record(samples: int, each: int = 2000) -> tuple[Array, Array]:
    """Loops of growing and shrinking amplitude, ``each`` samples a loop, with noise."""
    levels = np.linspace(-1, 1, 61)
    middle = (levels[1:] + levels[:-1]) / 2
    weights = np.exp(-10 * ((middle[:, None] - 0.3) ** 2 + (middle + 0.3) ** 2))
    model = Preisach(levels, np.tril(weights / weights.sum()), slope=0.3)
    share = np.arange(samples) / samples
    size = 0.3 + 0.7 * np.abs(np.sin(7 * np.pi * share))
    u = size * np.sin(2 * np.pi * np.arange(samples) / each)
    noise = np.random.default_rng(0).normal(size=samples)
    return u, model.simulate(u) + 0.002 * noise


def main() -> None:
    """``python -m benchmarks.long_record SAMPLES LEVELS``, as many levels or auto."""
    samples, levels = int(sys.argv[1]), sys.argv[2]
    options = {**AUTO, "levels": levels if levels == "auto" else int(levels)}
    str(
        Options.of({"holdout": 0.3, **options}).identify(Record(*a_record(50_000)))
    )  # loads the kernels
    u, y = a_record(samples)
    began = time.perf_counter()
    found = Options.of({"holdout": 0.3, **options}).identify(Record(u, y))
    str(found)
    seconds = time.perf_counter() - began
    figures = {"seconds": seconds, "peak_gb": peak_gigabytes(), "error": found.holdout_nrmse}
    print(json.dumps({**figures, "levels": found.model.bands}))


if __name__ == "__main__":
    main()
