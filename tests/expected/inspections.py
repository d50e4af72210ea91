"""Cases of the head: unattended inspections, one of them stopped and resumed, and a sweep."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Any

from expected.case import Case, command

_PIPES = {
    "full": "",
    "dry": "--water dry,temperature=20",
    "half": "--water 0,temperature=15",
    "cold": "--water full,temperature=8",
    "warm": "--water -4,temperature=35",
    "gas": "--water '-6,gas=forced gas'",
    "helium": "--water 2,gas=helium",
    "pressure": "--water 0,pressure=3",
    "resumed": "--water 4",
    "damaged": "--water -2,temperature=25",
}


def _inspected(name: str, number: int) -> Any:
    seed = 2000 + number
    line = f"head inspect --actuator twin:pipe --specimen {seed} --seed {seed} {_PIPES[name]}"
    whole = command(f"{line} --out out --json")
    journal = Path("out/journal.jsonl")
    found = {"whole": whole, "events": _events(journal)}
    if name in ("resumed", "damaged"):
        rows = journal.read_text(encoding="utf-8").splitlines(keepends=True)
        kept = "".join(rows[: len(rows) * 2 // 3])
        journal.write_text(kept if name == "resumed" else kept[:-20], encoding="utf-8")
        found["again"] = command(f"{line} --out out --resume --json")
        found["events again"] = _events(journal)
    return found


def _events(journal: Path) -> list[str]:
    """Return the kind and the outcome of each line of a journal."""
    kept = ("type", "kind", "what", "name", "outcome", "verdict", "view")
    told = []
    for row in journal.read_text(encoding="utf-8").splitlines():
        content = json.loads(row)
        words = [str(content[key]) for key in kept if isinstance(content.get(key), str)]
        told.append(" ".join(words))
    return told


def _swept() -> Any:
    line = "head sweep --actuator twin:pipe --specimen 2000 --seed 0 --water full"
    return command(f"{line} --around 20,32 --along 16,22 --out out --json")


CASES = (
    *(
        Case(
            f"inspection_{name}",
            partial(_inspected, name, number),
            quick=False,
            left_out=("*.began", "*.t", "*resumed[[]*"),
            bands={"*.answer.*": 1e-4},  # searches end a digit elsewhere on another processor
        )
        for number, name in enumerate(_PIPES)
    ),
    Case("sweep", _swept, quick=False),
)
