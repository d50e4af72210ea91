"""Findings: place, size and depth of defects with standard deviations, and their table."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from minorloop.files import check_writable, table_text, write_atomically

if TYPE_CHECKING:
    from minorloop_head.ultrasound.pits import PitDepth


@dataclass(frozen=True)
class Finding:
    """One defect of the wall; lengths in metres, angles in radians, NaN if unknown.

    ``kind``: ``pit``, ``hole``, ``crack`` or ``mark``; ``hole or pit`` if the echoes do not decide.
    ``verdict``: of the echoes, as in ``PitDepth``, with the places measured in an interrupted scan.
    ``phi``, ``z``, ``width``, ``length``, ``depth``: centre, extents around and along the pipe, and
    depth below the wall. ``phi_sd``, ``z_sd``, ``width_sd``, ``length_sd``, ``depth_sd``: standard
    deviations.
    """

    kind: str
    verdict: str
    phi: float
    phi_sd: float
    z: float
    z_sd: float
    width: float
    width_sd: float
    length: float
    length_sd: float
    depth: float
    depth_sd: float


PLACE_SD, _SIZE_SD = 0.085e-3, 0.08
"""Standard deviations by an outline: of the place in m, and relative of the diameter."""
DIGITS = {"phi [deg]": 1, "z [mm]": 2, "width [mm]": 2, "length [mm]": 2, "depth [mm]": 3}
"""Digits that tables show after the point."""
_UNITS = {"phi": "deg", "z": "mm", "width": "mm", "length": "mm", "depth": "mm"}
UNDECIDED = "hole or pit"
_KINDS = {
    "measured": "pit",
    "uneven floor": "pit",
    "disturbed": "pit",
    "ambiguous depth": "pit",
    "through-hole": "hole",
    "no pit": "mark",
}


def rounded(value: float, digits: int) -> float | None:
    """Return a number for JSON, None if it is not finite."""
    return round(value, digits) if math.isfinite(value) else None


def kind_of(verdict: str) -> str:
    """Return the kind of a round defect by the verdict of its echoes.

    ``verdict``: as in ``PitDepth``; for any other, the kind is ``hole or pit``.
    """
    return _KINDS.get(verdict, UNDECIDED)


def finding_of(pit: PitDepth, *, radius: float = 10e-3) -> Finding:
    """Return a measured pit as a finding, in a pipe of a radius in metres."""
    verdict = pit.verdict
    if pit.bursts < pit.planned:
        verdict += f" ({pit.bursts} of {pit.planned} places)"
    size, place_sd = (pit.diameter, pit.diameter_sd), pit.place_sd
    return Finding(
        kind_of(pit.verdict), verdict, pit.phi, place_sd / radius, pit.z, place_sd, *size, *size,
        pit.depth, pit.depth_sd,
    )  # fmt: skip


def outlined(phi: float, z: float, diameter: float, verdict: str, *, radius: float) -> Finding:
    """Return a round defect by its outline alone, without a depth.

    ``phi``, ``z``, ``diameter``: in radians and metres; ``verdict``: why there is no depth;
    ``radius``: of the pipe, in metres.
    """
    size = diameter, _SIZE_SD * diameter
    return Finding(
        UNDECIDED, verdict, phi, PLACE_SD / radius, z, PLACE_SD, *size, *size, math.nan, math.nan
    )


def finding_table(findings: Sequence[Finding]) -> str:
    """Return findings as CSV, in degrees and millimetres as the header says; empty if unknown."""
    names = [field.name for field in fields(Finding)]
    units = [_UNITS.get(name.removesuffix("_sd"), "") for name in names]
    header = [f"{n} [{unit}]" if unit else n for n, unit in zip(names, units, strict=True)]
    values = (zip(astuple(finding), units, strict=True) for finding in findings)
    rows = ((_cell(value, unit) for value, unit in row) for row in values)
    numbered = ([number, *row] for number, row in enumerate(rows, start=1))
    return table_text(["number", *header], numbered)


def save_findings(
    findings: Sequence[Finding], path: str | os.PathLike[str], *, force: bool = False
) -> Path:
    """Write the table of findings as CSV, and return its path.

    ``force``: whether a file that exists may be replaced. Raises an `OutputError` if the file
    exists and ``force`` is false, or it cannot be written.
    """
    place = check_writable(path, force=force)
    write_atomically(place, finding_table(findings))
    return place


def _cell(value: float | str, unit: str) -> str:
    if isinstance(value, str):
        return value
    scaled = np.degrees(value) if unit == "deg" else value * 1e3
    return f"{scaled:.4f}" if np.isfinite(value) else ""
