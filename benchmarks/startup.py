"""What starting costs: imports, the command line, the first compiled call."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks._timing import Row, seconds

_ROUNDS = 7
_FIRST_CALL = """
import time, numba
began = time.perf_counter()
import numpy as np, minorloop
model = minorloop.Preisach([-1, 0, 1], np.tril(np.ones((2, 2))))
u = np.sin(np.arange(50.0))
model.invert(model.simulate(u))
{more}
print(time.perf_counter() - began)
"""


def rows() -> list[Row]:
    commands = {
        "import numpy": [sys.executable, "-c", "import numpy"],
        "import minorloop": [sys.executable, "-c", "import minorloop"],
        "minorloop --help": [str(Path(sys.executable).with_name("minorloop")), "--help"],
    }
    times: dict[str, list[float]] = {name: [] for name in commands}
    for _ in range(_ROUNDS):
        for name, command in commands.items():
            times[name].append(seconds(lambda c=command: subprocess.run(c, capture_output=True)))
    middle = {name: statistics.median(values) for name, values in times.items()}
    found = []
    for name in ("import minorloop", "minorloop --help"):
        ratio = middle[name] / middle["import numpy"]
        found.append(Row(f"{name} / import numpy", ratio, "x", "<= 3", ratio <= 3))
    for more, what in (
        ("", "simulate and invert"),
        ("minorloop.identify(u, u, levels=3)", "the same and identify"),
    ):
        with tempfile.TemporaryDirectory() as cache:
            first, later = _first_call(cache, more), _first_call(cache, more)
        found += [
            Row(f"first call on a new machine: {what}", first, "s", "<= 5", first <= 5),
            Row(f"first call in a later process: {what}", later, "s", "<= 0.5", later <= 0.5),
        ]
    return found


def _first_call(cache: str, more: str) -> float:
    command = [sys.executable, "-c", _FIRST_CALL.format(more=more)]
    environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
    run = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    return float(run.stdout)
