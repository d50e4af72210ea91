"""One identification in a process of its own, for its peak memory: bands, samples, smoothness."""

from __future__ import annotations

import json
import re
import resource
import sys
from pathlib import Path

import numpy as np

from benchmarks._timing import FIXED, seconds
from minorloop import Preisach, identify
from minorloop.identification import Plane, Smooth
from minorloop.identification.pipeline import Options
from minorloop.lab.records import Record

NOISE = 0.005


def a_record(
    bands: int, samples: int, rough: bool = False
) -> tuple[Preisach, np.ndarray, np.ndarray]:
    """A plane, random inputs, and its outputs with noise of half a percent."""
    rng, grid = np.random.default_rng(0), np.linspace(-1, 1, bands)
    density = rng.uniform(0, 1, (bands, bands))
    if not rough:
        density = np.exp(-3 * (grid[:, None] - grid) ** 2) * (0.7 + 0.6 * density)
    model = Preisach.from_density(np.linspace(-1, 1, bands + 1), np.tril(density))
    u = rng.uniform(-1, 1, samples)
    y = model.simulate(u)
    return model, u, y + NOISE * np.ptp(y) * rng.normal(size=samples)


def peak_gigabytes() -> float:
    """Most memory that this process held.

    Linux hands the ``ru_maxrss`` of a parent on to its children, so there its own account of
    the process is read instead.
    """
    status = Path("/proc/self/status")
    own = re.search(r"VmHWM:\s+(\d+) kB", status.read_text()) if status.exists() else None
    return int(own[1]) / 1e6 if own else resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e9


def main(bands: int, samples: int, smoothness: str) -> None:
    model, u, y = a_record(bands, samples)
    small, small_u, small_y = a_record(5, 100)
    strength = smoothness if smoothness == "auto" else float(smoothness)
    identify(
        small_u, small_y, Plane(small.levels, **FIXED), prior=Smooth(strength)
    )  # compile first
    fits = []
    options = {"levels": model.levels, "smoothness": strength, **FIXED}
    elapsed = seconds(lambda: fits.append(Options.of(options).identify(Record(u, y))))
    figures = {"seconds": elapsed, "kkt": fits[0].kkt, "peak_gb": peak_gigabytes()}
    print(json.dumps(figures))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3])
