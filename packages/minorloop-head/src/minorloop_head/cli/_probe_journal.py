"""Scans of the probe in the journal of an inspection, from which it goes on."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from minorloop.errors import RecordError
from minorloop_head.cli._journal import NAME, step_rows, steps_of
from minorloop_head.cli._journal_checks import (
    AGAIN,
    FARTHEST,
    TURN,
    Limits,
    check,
    check_all,
    check_points,
    impossible,
)
from minorloop_head.cli._sweep_journal import Repeats, burst_of_values, burst_values

if TYPE_CHECKING:
    from collections.abc import Sequence

    from minorloop_head.procedures.probe_steps import ScannedRaster
    from minorloop_head.procedures.probing import Probing
    from minorloop_head.procedures.ring import Ring

_MOST_POINTS = 1000
_PLACE = (-FARTHEST, FARTHEST), (-2.0 * TURN, 2.0 * TURN)
_SCAN: dict[str, Limits] = {
    "reference": _PLACE,
    "point": ((0, _MOST_POINTS),),
    "onward": ((-1, 1),),
}
"""Least and largest of the numbers of a scan, advance and roll first."""
_SPOT = (-2.0 * TURN, 2.0 * TURN), (-FARTHEST, FARTHEST)
_HIGHEST = 1.0
"""Of the level of the water from the axis, in metres."""


def scan_line(name: str, scanned: ScannedRaster, known: int) -> dict[str, Any]:
    """Return the content of a line of a scan; the numbers of its bursts are exact.

    Parameters
    ----------
    name : str
    scanned : ScannedRaster
        So far.
    known : int
        Number of its bursts that are in lines before.
    """
    return {
        "name": name,
        "reference": scanned.reference.tolist(),
        "point": scanned.point,
        "onward": scanned.onward,
        "done": scanned.done,
        "steps": step_rows(scanned.steps),
        "bursts": [burst_values(burst) for burst in scanned.bursts[known:]],
    }


def ring_line(ring: Ring) -> dict[str, Any]:
    """Return the content of the line of the sweep round the pipe."""
    profile = {name: value.tolist() for name, value in asdict(ring.profile).items()}
    return {"profile": profile, "water": asdict(ring.water)}


def kept_probing(folder: Path, lines: Sequence[dict[str, Any]], probing: Probing) -> None:
    """Give a probe what the journal of its inspection has of it.

    Parameters
    ----------
    folder : path
        Of the inspection.
    lines : sequence of dict
        Of its journal.
    probing : Probing

    Raises
    ------
    RecordError
        If a line of a scan lacks something, or has an impossible value.
    """
    known: dict[str, Repeats] = {}
    for number, line in enumerate(lines, 1):
        where = f"line {number} of {folder / NAME}"
        try:
            if line["what"] == "scan":
                name = line["name"]
                for burst in line["bursts"]:
                    known.setdefault(name, Repeats()).check(where, burst)
                probing.scans[name] = _scan_of(where, line, probing.scans.get(name))
            elif line["what"] == "ring":
                probing.ring = _ring_of(where, line)
        except RecordError:
            raise
        except (KeyError, TypeError, ValueError):
            raise RecordError(f"{where} is not the whole line of a scan; {AGAIN}") from None


def _scan_of(where: str, line: dict[str, Any], before: ScannedRaster | None) -> ScannedRaster:
    """Return a scan by its lines so far and the next one."""
    import numpy as np

    from minorloop_head.procedures.probe_steps import ScannedRaster

    check_all(where, line, _SCAN)
    if not isinstance(line["done"], bool):
        raise impossible(where, "done", line["done"], "true or false")
    bursts = tuple(burst_of_values(where, values) for values in line["bursts"])
    return ScannedRaster(
        reference=np.array(line["reference"]),
        bursts=bursts if before is None else (*before.bursts, *bursts),
        point=line["point"],
        onward=line["onward"],
        done=line["done"],
        steps=steps_of(line["steps"], line["t"]),
    )


def _ring_of(where: str, line: dict[str, Any]) -> Ring:
    """Return the sweep round the pipe of a line."""
    import numpy as np

    from minorloop_head.procedures.ring import Ring
    from minorloop_head.reconstruction.depth_map import WaterLine
    from minorloop_head.ultrasound.profile import Profile

    check_points(where, "spots", line["profile"]["spots"], _SPOT)
    water = line["water"]
    if water["seen"]:
        check(where, "height", water["height"], ((-_HIGHEST, _HIGHEST),))
        check(where, "sd", water["sd"], ((0.0, _HIGHEST),))
    profile = {name: np.array(value) for name, value in line["profile"].items()}
    return Ring(Profile(**profile), WaterLine(**water))
