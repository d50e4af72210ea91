"""What starting costs: imports, the command line, the first compiled call."""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks._timing import Row, dearer, in_child, seconds, within

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
_MORE = {
    "simulate and invert": "",
    "the same and identify": "minorloop.identify(u, u, minorloop.Plane(3))",
}


def rows(quick: bool = False) -> list[Row]:
    found = _imports(rounds=2 if quick else 15)
    for what, more in _MORE.items():
        found += _first_calls(what, _FIRST_CALL.format(more=more), quick)
    return found


def _imports(rounds: int) -> list[Row]:
    script = Path(sys.executable).with_name("minorloop")
    commands = {
        "import numpy": [sys.executable, "-c", "import numpy"],
        "import minorloop": [sys.executable, "-c", "import minorloop"],
        "minorloop --help": [str(script), "--help"],
    }
    times: dict[str, list[float]] = {name: [] for name in commands}
    for _ in range(rounds):
        for name, command in commands.items():
            times[name].append(seconds(lambda c=command: _run(c)))
    middle = {name: statistics.median(values) for name, values in times.items()}
    numpy = middle.pop("import numpy")
    return [dearer(name, taken, "import numpy", numpy, 3) for name, taken in middle.items()]


def _run(command: list[str]) -> None:
    subprocess.run(command, capture_output=True, check=True)


def _first_calls(what: str, program: str, quick: bool) -> list[Row]:
    """Beyond importing numba; on a new machine nothing is compiled yet."""
    if quick:
        return [within(f"first call, later process: {what}", float(in_child("-c", program)), 0.5)]
    with tempfile.TemporaryDirectory() as cache:
        times = [float(in_child("-c", program, NUMBA_CACHE_DIR=cache)) for _ in range(6)]
    return [
        within(f"first call, new machine: {what}", times[0], 5),
        within(f"first call, later process: {what}", statistics.median(times[1:]), 0.5),
    ]
