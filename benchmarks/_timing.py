"""Rows of a benchmark, and how to time things side by side."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

FIXED: dict[str, Any] = {"diagonal": "uniform", "slope": False, "lag": 0}
"""Options of `identify` with which nothing is compared: one fit is timed."""


@dataclass(frozen=True)
class Row:
    """One thing measured; ``ours`` and ``theirs`` in seconds, ``way`` what theirs is."""

    what: str
    ours: float
    way: str = ""
    theirs: float | None = None
    ratio: float | None = None
    required: str = ""
    met: bool | None = None
    accuracy: str = ""

    def cells(self, verdict: bool = True) -> tuple[str, ...]:
        theirs = "" if self.theirs is None else f"{readable(self.theirs)}: {self.way}"
        ratio = "" if self.ratio is None else f"{self.ratio:.3g}"
        word = {None: "", True: "met", False: "short"}[self.met if verdict else None]
        return (
            self.what, readable(self.ours), theirs, ratio, self.required, word, self.accuracy,
        )  # fmt: skip


def faster(
    what: str, ours: float, way: str, theirs: float, least: float, accuracy: str, accurate: bool
) -> Row:
    """We are to be ``least`` times as fast as the other way, and accurate."""
    ratio = theirs / ours
    met = ratio >= least and accurate
    return Row(what, ours, way, theirs, ratio, f">= {least:g} times as fast", met, accuracy)


def dearer(
    what: str,
    ours: float,
    way: str,
    theirs: float,
    most: float,
    accuracy: str = "",
    accurate: bool = True,
) -> Row:
    """We may take ``most`` times as long as something that does less."""
    ratio = ours / theirs
    met = ratio <= most and accurate
    return Row(what, ours, way, theirs, ratio, f"<= {most:g} times as long", met, accuracy)


def within(what: str, ours: float, most: float, accuracy: str = "", accurate: bool = True) -> Row:
    """We may take ``most`` seconds."""
    met = ours <= most and accurate
    return Row(what, ours, required=f"<= {readable(most)}", met=met, accuracy=accuracy)


def readable(seconds: float) -> str:
    for scale, unit in ((1.0, "s"), (1e-3, "ms"), (1e-6, "us")):
        if seconds >= scale:
            return f"{seconds / scale:.3g} {unit}"
    return f"{seconds / 1e-9:.3g} ns"


def seconds(work: Callable[[], object]) -> float:
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def best(*works: Callable[[], object], rounds: int = 5) -> list[float]:
    """Least time of each, taken in turn so that a slow spell of the machine hits all alike."""
    times = [[seconds(work) for work in works] for _ in range(rounds)]
    return [min(column) for column in zip(*times, strict=True)]


def in_child(*command: object, **environment: str) -> str:
    """What ``python command`` prints, in a process of its own."""
    run = subprocess.run(
        [sys.executable, *map(str, command)],
        capture_output=True,
        text=True,
        check=True,
        timeout=1800,
        env={**os.environ, **environment},
    )
    return run.stdout


def as_json(rows: list[Row], quick: bool) -> str:
    return json.dumps(
        {"cores": os.cpu_count(), "quick": quick, "rows": [asdict(row) for row in rows]}
    )
