"""Scans of the probe in the journal of an inspection, from which it goes on."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from minorloop.cli._journal import NAME, step_rows, steps_of
from minorloop.cli._sweep_journal import burst_of_values, burst_values
from minorloop.errors import RecordError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from minorloop.head.procedures.probe_steps import ScannedRaster
    from minorloop.head.procedures.probing import Probing
    from minorloop.head.procedures.ring import Ring


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
    for number, line in enumerate(lines, 1):
        try:
            if line["what"] == "scan":
                where, name = f"line {number} of {folder / NAME}", line["name"]
                probing.scans[name] = _scan_of(where, line, probing.scans.get(name))
            elif line["what"] == "ring":
                probing.ring = _ring_of(line)
        except RecordError:
            raise
        except (KeyError, TypeError, ValueError):
            raise RecordError(
                f"line {number} of {folder / NAME} is not the whole line of a scan; inspect into a "
                "new folder"
            ) from None


def _scan_of(where: str, line: dict[str, Any], before: ScannedRaster | None) -> ScannedRaster:
    """Return a scan by its lines so far and the next one."""
    import numpy as np

    from minorloop.head.procedures.probe_steps import ScannedRaster

    bursts = tuple(burst_of_values(where, values) for values in line["bursts"])
    return ScannedRaster(
        reference=np.array(line["reference"]),
        bursts=bursts if before is None else (*before.bursts, *bursts),
        point=line["point"],
        onward=line["onward"],
        done=line["done"],
        steps=steps_of(line["steps"], line["t"]),
    )


def _ring_of(line: dict[str, Any]) -> Ring:
    import numpy as np

    from minorloop.head.procedures.ring import Ring
    from minorloop.head.reconstruction.depth_map import WaterLine
    from minorloop.head.ultrasound.profile import Profile

    profile = {name: np.array(value) for name, value in line["profile"].items()}
    return Ring(Profile(**profile), WaterLine(**line["water"]))
