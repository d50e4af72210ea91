"""``python -m benchmarks.inspections --seed S``: unattended inspections of simulated pipes.

Dry, partly and fully flooded pipes in turn, at 5 to 40 degrees, are inspected from three places.
Counted are pits, holes and cracks in the searched wall that are found; those under water that are
measured, if the wires reach a raster in this water, and otherwise those whose finding says so;
findings that are graded confirmed and are none; levels of the water in their 90 % bands; and
inspections that, cut off at a line of their journal, give other findings when they are resumed.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from minorloop.identification.bands import PER_DEVIATION
from minorloop_head.console.plant import open_tip
from minorloop_head.geometry import Probe, wall_distance
from minorloop_head.inspection.heads import Water, inspected_head
from minorloop_head.inspection.inspect_pipe import inspect
from minorloop_head.procedures.probe_steps import CONFIRMED
from minorloop_head.procedures.scan import RasterScan
from minorloop_head.procedures.steps import REFUSED
from minorloop_head.procedures.trace import SAME, one_course
from minorloop_head.twins.head import Head
from minorloop_head.twins.pipe import Bore, Pipe
from minorloop_head.twins.surroundings import Surroundings
from papers.catheter import scoring
from papers.catheter.crack_scenes import fine_course
from papers.catheter.mission import shown

ADVANCES = (4e-3, 8e-3, 12e-3)
"""Places of the catheter in metres: a pit and a crack are then within reach."""
MARGIN, SHARE = 0.5e-3, 0.8
"""Distance in metres from the ends of the wall that a report states as searched, and share of a
crack that is between them, within reach."""
DEEP, PROMISED = (1e-3, 2.5e-3), 3.0
"""Depth of the face of the probe and of the wall under water, in metres, where a depth is to be
measured; and standard deviations by which it may be off."""
RESUMED = 5
"""Pipes for each one that is cut off and resumed."""
KINDS = ("dry", "part", "full")


def scored(seed: int, kind: str, water: Water, content: dict[str, Any]) -> Counter[str]:
    """Return counts of an inspection by its ``findings.json``."""
    tip, view = open_tip("twin:pipe", specimen=seed, seed=seed, water=water.filling())
    pipe: Pipe = tip.pipe  # type: ignore[attr-defined]
    around, joints = water.filling().around(Surroundings()), RasterScan(calibration=view).joints
    reachable = scoring.reaches(Head(seed), around, joints)
    counts = Counter({"pipes": 1, "reports": int(content["ended"] == "finished")})
    found, radius = content["findings"], pipe.radius
    low, high = (1e-3 * z for z in (content["wall"] or {"z [mm]": (0.0, 0.0)})["z [mm]"])
    spots = [(math.radians(row["phi [deg]"]), 1e-3 * row["z [mm]"]) for row in found]
    right = [False] * len(found)
    for bore in pipe.bores:
        place = (bore.phi, bore.z)
        near = [n for n, spot in enumerate(spots) if wall_distance(spot, place, radius) < SAME]
        near = [n for n in near if found[n]["kind"] != "crack"]
        for n in near:
            right[n] = True
        if not low + MARGIN < bore.z < high - MARGIN:
            continue
        what = "hole" if bore.through else "pit"
        counts.update({f"{what}s": 1, f"{what}s found": int(bool(near))})
        if _under(bore, water.level, radius) and reachable:
            done = any(_measured(bore, found[n]) for n in near)
            counts.update({f"{what}s under water": 1, f"{what}s measured": int(done)})
        elif _under(bore, water.level, radius):
            said = any(found[n]["verdict"].startswith(REFUSED) for n in near)
            counts.update({f"{what}s out of reach": 1, f"{what}s said to be": int(said)})
    for crack in pipe.cracks:
        course, _ = fine_course(crack, radius)
        same = [
            n
            for n, row in enumerate(found)
            if row["kind"] == "crack" and one_course(np.array(row["course"]), course, radius)
        ]
        for n in same:
            right[n] = True
        if ((low < course[:, 1]) & (course[:, 1] < high)).mean() >= SHARE:
            counts.update({"cracks": 1, "cracks found": int(bool(same))})
    for row, one in zip(found, right, strict=True):
        counts["false"] += not one
        counts["false confirmed"] += not one and row["grade"] == CONFIRMED
    stated = content.get("water above the axis [mm]")
    if kind == "part" and stated:
        off = abs(stated[0] - float(water.level))
        counts.update({"levels": 1, "in their band": int(off <= PER_DEVIATION * stated[1])})
    counts["surfaces that are none"] += bool(kind != "part" and stated)
    return counts


def _under(bore: Bore, level: str, radius: float) -> bool:
    """Return whether probe and wall at a bore are well under water."""
    if level == "dry":
        return False
    height = -radius if level == "full" else -1e-3 * float(level)
    down = math.sin(bore.phi)
    return level == "full" or (
        Probe().face * down > height + DEEP[0] and radius * down > height + DEEP[1]
    )


def _measured(bore: Bore, row: dict[str, Any]) -> bool:
    if bore.through:
        return shown(row, "through-hole")
    off = abs(1e-3 * (row["depth [mm]"] or math.inf) - bore.depth)
    return bool(shown(row, "measured") and off <= PROMISED * 1e-3 * row["depth_sd [mm]"])


def inspected(seed: int, kind: str, folder: Path) -> tuple[Counter[str], dict[str, Any], str]:
    """Inspect a pipe, resume it if its turn has come, and return counts, content and level."""
    rng = np.random.default_rng([seed, 51])
    level = f"{rng.uniform(-2.0, 9.5):.2f}" if kind == "part" else kind
    water = Water(level=level, temperature=round(float(rng.uniform(5.0, 40.0)), 1))

    def run(resume: bool) -> dict[str, Any]:
        head = inspected_head("twin:pipe", specimen=seed, seed=seed, water=water)
        inspect(head, folder, ADVANCES, resume=resume)
        content: dict[str, Any] = json.loads((folder / "findings.json").read_text())
        return content

    content = run(False)
    counts = scored(seed, kind, water, content)
    if seed % RESUMED == 0:
        journal = folder / "journal.jsonl"
        lines = journal.read_text().splitlines(keepends=True)
        journal.write_text("".join(lines[: int(rng.integers(1, len(lines)))]))
        kinds = [[row["kind"] for row in each["findings"]] for each in (content, run(True))]
        counts.update({"resumed": 1, "resumed alike": int(kinds[0] == kinds[1])})
    return counts, content, level


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.inspections", description=__doc__)
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--pipes", type=int, default=40)
    parser.add_argument("--out", type=Path, default=Path("build/inspections"))
    asked = parser.parse_args()
    total: Counter[str] = Counter()
    for n, seed in enumerate(range(asked.seed, asked.seed + asked.pipes)):
        folder = asked.out / str(seed)
        shutil.rmtree(folder, ignore_errors=True)
        folder.parent.mkdir(parents=True, exist_ok=True)
        try:
            counts, content, level = inspected(seed, KINDS[n % len(KINDS)], folder)
        except Exception as error:
            print(f"{seed}: ended by {error!r}", file=sys.stderr, flush=True)
            total["pipes"] += 1
            continue
        total.update(counts)
        print(
            f"{seed} water {level}, said {content.get('water level')}: {dict(counts)}",
            file=sys.stderr,
            flush=True,
        )
    for name, count in total.items():
        print(f"{name}: {count}")


if __name__ == "__main__":
    main()
