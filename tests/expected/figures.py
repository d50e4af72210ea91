"""Figures of a case as lines of text, and what differs between two sets of them."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import numpy as np

LONG = 8
"""Numbers of an array above which its figures are a summary."""
CLOSE = 1e-9
"""Relative tolerance of numbers without a band of their own; whole numbers are exact."""

Figures = dict[str, Any]


def flat(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the name and value of each figure within nested mappings and sequences.

    A long array of numbers becomes its length and four numbers, of which the last changes if two
    elements are exchanged.
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from flat(inner, f"{name}.{key}" if name else str(key))
    elif isinstance(value, Sequence) and not isinstance(value, str | bytes):
        numbers = list(_numbers(value))
        if len(numbers) > LONG:
            yield name, _summary(numbers)
            return
        if not value:
            yield name, []
        for place, inner in enumerate(value):
            yield from flat(inner, f"{name}[{place}]")
    else:
        yield name, value


def _numbers(value: Any) -> Iterator[float]:
    """Yield the numbers of a nested sequence that has nothing else, and null as not measured."""
    if isinstance(value, str | bytes | Mapping) or not isinstance(value, Sequence):
        return
    for inner in value:
        if inner is None or (isinstance(inner, int | float) and not isinstance(inner, bool)):
            yield math.nan if inner is None else float(inner)
        elif isinstance(inner, Sequence) and not isinstance(inner, str):
            yield from _numbers(inner)
        else:
            return


def _summary(numbers: list[float]) -> dict[str, Any]:
    found = np.asarray(numbers)
    known = found[np.isfinite(found)]
    if not known.size:
        return {"numbers": found.size, "known": 0}
    marks = np.cos(np.arange(found.size))[np.isfinite(found)]
    return {
        "numbers": found.size,
        "known": known.size,
        "least": known.min(),
        "greatest": known.max(),
        "sum": known.sum(),
        "marked": marks @ known,
    }


def lines(value: Any, left_out: Sequence[str] = ()) -> Figures:
    """Return the figures of a case by name, as they are read back from a file.

    Parameters
    ----------
    value
        What the case gives.
    left_out : sequence of str
        Patterns of names of figures that do not count, such as times.
    """
    return {
        name: json.loads(json.dumps(one, default=float))
        for name, one in flat(value)
        if not any(fnmatch(name, pattern) for pattern in left_out)
    }


def write(path: Path, figures: Figures) -> None:
    """Write figures, a line each."""
    text = "".join(
        f"{name} = {json.dumps(value, ensure_ascii=False)}\n" for name, value in figures.items()
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def read(path: Path) -> Figures:
    """Return the figures that a file has."""
    rows = (line.partition(" = ") for line in path.read_text(encoding="utf-8").splitlines())
    return {name: json.loads(value) for name, _, value in rows}


def differences(before: Figures, after: Figures, bands: Mapping[str, float]) -> list[str]:
    """Return a line for each figure that differs: its name, what it was, and what it is.

    Parameters
    ----------
    before, after : dict
        Figures by name.
    bands : mapping
        Relative tolerance of figures by a pattern of their names; the first that matches counts.
    """
    told = []
    for name in dict.fromkeys([*before, *after]):
        if name not in after:
            told.append(f"{name}: {_shown(before[name])} -> gone")
        elif name not in before:
            told.append(f"{name}: new, {_shown(after[name])}")
        else:
            band = next((b for pattern, b in bands.items() if fnmatch(name, pattern)), CLOSE)
            if not _same(before[name], after[name], band):
                told.append(f"{name}: {_shown(before[name])} -> {_shown(after[name])}")
    return told


def _same(one: Any, other: Any, band: float) -> bool:
    if isinstance(one, dict) and isinstance(other, dict):
        size = max((abs(value) for value in one.values()), default=0.0)
        return one.keys() == other.keys() and all(
            abs(value - other[key]) <= band * size for key, value in one.items()
        )
    if isinstance(one, float | int) and isinstance(other, float | int):
        if isinstance(one, bool) or isinstance(other, bool):
            return one is other
        if isinstance(one, int) and isinstance(other, int) and band <= CLOSE:
            return one == other
        return math.isclose(one, other, rel_tol=band, abs_tol=1e-12)
    return bool(one == other)


def _shown(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 120 else f"{text[:117]}..."
