"""Cases of faults at instruments, whose counts are all zero, and of scores that take minutes."""

from __future__ import annotations

import os
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

from expected.case import Case

_ROOT = Path(__file__).parents[2]
_TESTS = os.pathsep.join(
    str(_ROOT / one)
    for one in ("tests", "packages/minorloop/tests", "packages/minorloop-head/tests")
)


def _printed(*arguments: str) -> Any:
    """Return the exit status of a module and the lines that it prints, without their layout."""
    run = subprocess.run(
        [sys.executable, "-m", *arguments],
        cwd=_ROOT,
        env={**os.environ, "PYTHONPATH": _TESTS},
        capture_output=True,
        text=True,
        check=False,
    )
    return {
        "status": run.returncode,
        "rows": [" ".join(row.split()) for row in run.stdout.splitlines()],
    }


def _faults() -> Any:
    """Return the exit status, and each count over all cases: none but that of cases may be more
    than 0."""
    found = _printed("faults", "60")
    rows = [row.split() for row in found["rows"]]
    counts = [[int(cell) for cell in row[-7:-1]] for row in rows if _is_number(row[-1])]
    names = ("cases", "left on", "lost", "twice", "differs", "hung")
    return {
        "status": found["status"],
        **{
            name: sum(column) for name, column in zip(names, zip(*counts, strict=True), strict=True)
        },
    }


def _is_number(cell: str) -> bool:
    return cell.replace(".", "", 1).isdigit()


CASES = (
    Case("faults", _faults, quick=False),
    Case(
        "cracks",
        partial(_printed, "benchmarks.cracks", "score", "--first", "1000", "--count", "40"),
        quick=False,
    ),
)
