"""What the pages are told of the seat: findings, and the introduction."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from minorloop.arrays import FloatArray
from minorloop.head.console import messages
from minorloop.head.console.modes import TeleopConfig
from minorloop.head.console.plant import MIDDLE, PlantView
from minorloop.head.reconstruction import findings as tables
from minorloop.head.reconstruction.findings import UNDECIDED, kind_of

_PLACE_SD = (
    0.085  # mm, of an outline in a picture, and share of its diameter: what the fit starts from
)
_SIZE_SD = 0.08
NOT_HEARD = "not heard"


@dataclass(frozen=True, kw_only=True)
class ReportedFinding:
    """A defect that was measured; in mm and degrees, None where not known.

    Parameters
    ----------
    number : int
        From 1.
    t : float
        When, in seconds since the session began.
    kind : str
        ``pit``, ``hole`` or ``mark``; ``hole or pit`` where echoes have not decided.
    verdict : str
        Of the echoes; ``not heard`` before there are any.
    phi, z : float
        Where on the wall.
    diameter, depth : float
    phi_sd, z_sd, diameter_sd, depth_sd : float
        Standard deviations.
    evidence : float
        Logarithm of the odds by the camera that it is a hole or a pit.
    patch : dict, optional
        Depths about it in mm, ``rows`` by ``columns`` from ``phi`` and ``z`` by ``step``; None
        where not known, and where there is no floor: ``through`` lists the latter.
    """

    number: int
    t: float
    kind: str
    verdict: str
    phi: float
    phi_sd: float
    z: float
    z_sd: float
    diameter: float
    diameter_sd: float
    depth: float | None
    depth_sd: float | None
    evidence: float
    patch: dict[str, Any] | None = None


def camera_finding(
    number: int, t: float, hole: Mapping[str, float], radius: float
) -> ReportedFinding:
    """A finding by its outline alone."""
    diameter = 1e3 * hole["diameter"]
    return ReportedFinding(
        number=number,
        t=t,
        kind=UNDECIDED,
        verdict=NOT_HEARD,
        phi=round(math.degrees(hole["phi"]) % 360.0, 3),
        phi_sd=round(math.degrees(1e-3 * _PLACE_SD / radius), 3),
        z=round(1e3 * hole["z"], 4),
        z_sd=_PLACE_SD,
        diameter=round(diameter, 4),
        diameter_sd=round(_SIZE_SD * diameter, 4),
        depth=None,
        depth_sd=None,
        evidence=round(hole["evidence"], 2),
    )


def sounded(finding: ReportedFinding, told: Mapping[str, Any], radius: float) -> ReportedFinding:
    """The finding with what its echoes told; what they did not tell stays as the camera saw it."""
    changed: dict[str, Any] = {"verdict": told["verdict"], "kind": kind_of(told["verdict"])}
    if told.get("diameter") is not None:
        changed |= {
            "phi": round(math.degrees(told["phi"]) % 360.0, 4),
            "phi_sd": round(math.degrees(told["place_sd"] / radius), 4),
            "z": round(1e3 * told["z"], 4),
            "z_sd": round(1e3 * told["place_sd"], 4),
            "diameter": round(1e3 * told["diameter"], 4),
            "diameter_sd": round(1e3 * told["diameter_sd"], 4),
        }
    for name in ("depth", "depth_sd"):
        value = told.get(name)
        changed[name] = None if value is None else round(1e3 * value, 4)
    return replace(finding, patch=told.get("patch"), **changed)


def table_of(rows: Sequence[Mapping[str, Any]]) -> str:
    """Findings as the pages are told of them, as CSV, under the numbers that the pages show."""
    header, *lines = tables.finding_table([_as_library(row) for row in rows]).splitlines()
    numbered = (
        f"{row['number']},{line.split(',', 1)[1]}" for row, line in zip(rows, lines, strict=True)
    )
    return "\n".join([header, *numbered, ""])


def _as_library(row: Mapping[str, Any]) -> tables.Finding:
    def m(name: str) -> float:
        value = row[name]
        return math.nan if value is None else 1e-3 * value

    return tables.Finding(
        row["kind"],
        row["verdict"],
        math.radians(row["phi"]),
        math.radians(row["phi_sd"]),
        m("z"),
        m("z_sd"),
        m("diameter"),
        m("diameter_sd"),
        m("diameter"),
        m("diameter_sd"),
        m("depth"),
        m("depth_sd"),
    )


def introduction(
    interval: float, view: PlantView, seat: TeleopConfig, wires: Iterable[Any]
) -> bytes:
    """What the pages are told once: camera, cone, and the planes of the wires."""
    lens = view.lens
    return messages.encode(
        "hello",
        interval=interval,
        view={
            "width": lens.width,
            "height": lens.height,
            "focal": lens.focal,
            "centre": lens.centre,
            "lever": view.lever,
            "radius": view.radius,
        },
        known=view.told(),
        cone=seat.gaze.cone,
        middle=MIDDLE,
        stick=[seat.stick.advance, seat.stick.roll],
        planes=[{"levels": wire.levels.tolist(), "weights": _rows(wire.weights)} for wire in wires],
    )


def rounded(values: Any, digits: int = 3) -> list[float | None]:
    """Numbers for a message; None for what is none."""
    return [round(float(x), digits) if math.isfinite(x) else None for x in values]


def _rows(rows: FloatArray) -> list[list[float]]:
    return [[round(float(x), 4) for x in row[: k + 1]] for k, row in enumerate(rows)]
