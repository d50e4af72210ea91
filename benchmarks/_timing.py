"""Rows of a benchmark, and how to time two things side by side."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class Row:
    """What was measured; ``value`` against ``required``, and how accurate it was."""

    what: str
    value: float
    unit: str
    required: str
    met: bool | None
    accuracy: str = ""

    def cells(self) -> tuple[str, ...]:
        verdict = "" if self.met is None else ("met" if self.met else "short")
        return self.what, f"{self.value:.3g} {self.unit}", self.required, verdict, self.accuracy


def seconds(work: Callable[[], object]) -> float:
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def best(*works: Callable[[], object], rounds: int = 5) -> list[float]:
    """Least time of each, taken in turn so that a slow spell of the machine hits all alike."""
    times = [[seconds(work) for work in works] for _ in range(rounds)]
    return [min(column) for column in zip(*times, strict=True)]


def in_child(module: str, *arguments: object) -> dict[str, float]:
    """Run ``python -m module arguments`` and give the JSON object that it prints."""
    command = [sys.executable, "-m", module, *map(str, arguments)]
    run = subprocess.run(command, capture_output=True, text=True, check=True, timeout=1800)
    return json.loads(run.stdout)


def as_json(rows: list[Row]) -> str:
    return json.dumps({"rows": [asdict(row) for row in rows]})
