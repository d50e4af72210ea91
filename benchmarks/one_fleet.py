"""``python -m benchmarks.one_fleet FOLDER WORKERS KILL BEGAN``: one fleet; seconds, and how many.

The seconds are those of the whole command, which its caller began at ``BEGAN``.
"""

from __future__ import annotations

import os
import signal
import sys
import tempfile
import time
from pathlib import Path

import psutil

from benchmarks._timing import FIXED
from minorloop.fleet import identify_fleet, read_manifest

OPTIONS = {"levels": 20, "prior": "none", **FIXED}


def main(folder: str, workers: str, kill: str, began: str) -> None:
    specimens, killed = read_manifest(Path(folder) / "manifest.csv"), []

    def watch(done: int, of: int, last: object) -> None:
        if kill == "1" and not killed and done >= of // 3:
            killed.append(_kill_a_worker())

    with tempfile.TemporaryDirectory() as scratch:
        options = {"workers": int(workers), "watch": watch, **OPTIONS}
        summary = identify_fleet(specimens, Path(scratch) / "out", **options)
        print(f"{time.time() - float(began):.3f} {len(summary.identified)}")


def _kill_a_worker() -> int:
    workers = [process.pid for process in psutil.Process().children()]
    os.kill(workers[0], signal.SIGKILL)
    return workers[0]


if __name__ == "__main__":
    main(*sys.argv[1:])
