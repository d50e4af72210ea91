"""Cases of the studies: their figures on three specimens."""

from __future__ import annotations

from functools import partial
from typing import Any

from expected.case import Case, command
from papers.__main__ import main

_NAMES = ("ipmc", "fibre", "design", "benchmark", "stage", "head", "inspection")


def _study(name: str) -> Any:
    return command(f"{name} --specimens 3 --seed 1000 --json", main)


_BANDS = {name: {"*": 0.02} for name in ("head", "inspection", "stage")}
_BANDS["ipmc"] = {"*.rms_plays": 1e-3, "*.rms_cascade": 1e-6}
"""The last digits of a model become other decisions where pictures steer the head, and end the
search for plays, and that for dynamics, elsewhere."""
CASES = tuple(
    Case(
        f"study_{name}",
        partial(_study, name),
        quick=False,
        bands=_BANDS.get(name, {}),
        left_out=("*.realtime.*", "*.processor_s"),
    )
    for name in _NAMES
)
