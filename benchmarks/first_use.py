"""The first identification with an empty cache of compiled kernels, and the second.

``python -m benchmarks.first_use piezo`` or ``array`` is one of them, in this process.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time

import numpy as np

from benchmarks._timing import Row
from benchmarks.real_records import DATA, PIEZO

FIRST, SECOND = 5.0, 1.5
"""Seconds of processor time that they may take, after the imports."""
ROWS = 7000


def rows(quick: bool = False) -> list[Row]:
    return [row for kind in ("array", "piezo") for row in _both(kind)]


def _both(kind: str) -> list[Row]:
    if kind == "piezo" and not (DATA / PIEZO).is_file():
        return []
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)  # an installation has the bytecode
        command = [sys.executable, "-m", "benchmarks.first_use", kind]
        found = []
        for what, most in (("first", FIRST), ("second", SECOND)):
            done = subprocess.run(command, env=environment, capture_output=True, check=True)
            took = json.loads(done.stdout)
            found.append(
                Row(
                    f"{what} identify in a new environment, {kind}, {ROWS:,} rows",
                    took["identify"],
                    required=f"<= {most:g} s of processor time",
                    met=took["identify"] <= most,
                    accuracy=f"imports and reading before it {took['before']:.2f} s, scores and "
                    f"advice after it {took['after']:.2f} s",
                )
            )
    return found


def main(kind: str) -> None:
    """Print the seconds of processor time of one identification."""
    began = time.process_time()
    import minorloop as ml

    if kind == "piezo":
        names = {"input": "input_V", "output": "displacement_um"}
        known = (ml.read(DATA / PIEZO, **names),)
    else:
        rng = np.random.default_rng(1000)
        u = np.interp(np.arange(ROWS) / 35, np.arange(201), rng.uniform(-1, 1, 201))
        loop = u + 0.2 * np.sign(np.gradient(u)) * (1 - u**2)
        known = u, loop + 0.01 * rng.normal(size=ROWS)
    before = time.process_time()
    found = ml.identify(*known, holdout=0.3)
    identified = time.process_time()
    str(found)
    took = {"before": before - began, "identify": identified - before}
    print(json.dumps({**took, "after": time.process_time() - identified}))


if __name__ == "__main__":
    main(sys.argv[1])
