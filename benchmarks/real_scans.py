"""Flaws in scans that others recorded, and in simulated ones with holes that were drawn.

``python -m benchmarks.real_scans`` prints the figures; ``--seeds 5000 20`` scores twenty simulated
blocks from seed 5000 on instead of those from 0, and ``--rasters`` four rasters.
"""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path

import numpy as np

from benchmarks._layered_scans import drawn_block, matched
from benchmarks._timing import Row
from minorloop_head.ultrasound.recorded_scan import RecordedScan, read_scan
from minorloop_head.ultrasound.scan_flaws import ScanFlaw, ScanFlaws, scan_flaws
from minorloop_head.ultrasound.scan_surfaces import envelope, recorded_field

FOLDER = Path(__file__).parents[2] / "shared" / "data" / "real" / "scans"
STEPS = {1: (20.0, 5.0), 2: (20.0, 6.0), 3: (20.0, 10.0)}
"""Of the targets in each of three layers, along the scan and in depth, in mm."""


def three_layers(found: ScanFlaws) -> list[Row]:
    """Score four targets in each of three layers, whose steps are known and whose first is not."""
    hits, false, places, depths, adjacent = 0, 0, [], [], []
    for layer, (along, deep) in STEPS.items():
        own = [each for each in found.flaws if each.layer == layer]
        hits, false = hits + min(len(own), 4), false + max(len(own) - 4, 0)
        if len(own) == 4:
            n = np.arange(4)
            for values, step, errors in (
                ([1e3 * each.x for each in own], along, places),
                ([1e3 * each.depth for each in own], deep, depths),
            ):
                off = np.array(values) - step * n
                errors.append(np.abs(off - off.mean()).max())
            adjacent.append(np.abs(np.diff([1e3 * each.depth for each in own]) - deep).max())
    deepest = next((e for e in found.flaws if e.layer == 2 and 20e-3 < e.depth < 27e-3), None)
    rows = [
        Row("three layers: targets found", 0.0, required="12", met=hits == 12, accuracy=f"{hits}"),
        Row("three layers: false", 0.0, required="<= 1", met=false <= 1, accuracy=f"{false}"),
        _errors("three layers: places off their steps", places, 1.5),
        _errors("three layers: depths off their steps", depths, 0.7),
        _errors("three layers: one step of depth", adjacent, 0.7),
    ]
    if deepest is not None:
        before = recorded_width(found.scan, deepest)
        rows.append(
            Row(
                "a hole of 1.6 mm at 24 mm in acrylic: width at -6 dB",
                0.0,
                required="<= 4 mm",
                met=deepest.width <= 4e-3,
                accuracy=f"{1e3 * deepest.width:.1f} mm, {1e3 * before:.1f} mm as recorded",
            )
        )
    return rows


def _errors(what: str, errors: list[float], most: float) -> Row:
    each = ", ".join(f"{error:.2f}" for error in errors)
    met = len(errors) == len(STEPS) and max(errors) <= most
    return Row(what, 0.0, required=f"<= {most:g} mm", met=met, accuracy=f"{each} mm by layer")


def recorded_width(scan: RecordedScan, flaw: ScanFlaw) -> float:
    """Return how wide a flaw is drawn at half its amplitude without focusing, in metres."""
    loud = envelope(recorded_field(scan), flaw.time + np.arange(-20, 21) * 0.02e-6)[:, :, 0]
    loud = loud.max(axis=0)
    n = round(flaw.x / scan.steps[0])
    high = np.flatnonzero(loud < 0.5 * loud[n])
    return float(scan.steps[0] * (high[high > n].min() - high[high < n].max()))


def tilted_block(found: ScanFlaws) -> list[Row]:
    """Score a tilted block with holes on a slanted row: equal steps tell whether one is missing."""
    tilt, count = math.degrees(found.tilt), len(found.flaws)
    x = 1e3 * np.array([each.x for each in found.flaws])
    depths = 1e3 * np.array([each.depth for each in found.flaws])
    line = [np.polyval(np.polyfit(np.arange(count), v, 1), np.arange(count)) for v in (x, depths)]
    off = [float(np.abs(v - w).max()) for v, w in zip((x, depths), line, strict=True)]
    return [
        Row("copper: tilt", 0.0, required="2 +- 0.3 degrees", met=abs(tilt - 2) <= 0.3,
            accuracy=f"{tilt:.2f} degrees"),
        Row("copper: holes of a row of equal steps", 0.0, required="all", met=max(off) < 1.5,
            accuracy=f"{count}; off their row by {off[0]:.2f} and {off[1]:.2f} mm at most"),
    ]  # fmt: skip


def simulated(first: int, count: int, *, raster: bool = False) -> list[Row]:
    """Score blocks with drawn holes: another way of making scans than that of focusing them."""
    hits, missed, false, errors, tilts = 0, 0, 0, [], []
    began = time.perf_counter()
    for seed in range(first, first + count):
        block = drawn_block(seed, raster=raster)
        found = scan_flaws(block.scan)
        error, lost, wrong = matched(block, found)
        hits, missed, false = hits + len(error), missed + lost, false + wrong
        errors.append(error)
        tilts.append(abs(math.degrees(found.tilt - abs(block.tilt))))
    place, depth = np.quantile(1e3 * np.vstack(errors), 0.95, axis=0)
    what = f"{count} simulated {'rasters' if raster else 'lines'} from seed {first}"
    return [
        Row(
            what,
            (time.perf_counter() - began) / count,
            required="found >= 0.95, false <= 0.1 a scan",
            met=hits >= 0.95 * (hits + missed) and false <= 0.1 * count,
            accuracy=f"{hits} of {hits + missed} holes, {false} false; 95 % within {place:.2f} mm "
            f"of place and {depth:.2f} mm of depth; tilt within {max(tilts):.2f} degrees",
        )
    ]


def rows(quick: bool = False) -> list[Row]:
    """Return the rows of the report; of the recorded scans those that are there."""
    found = []
    for name, score in (
        ("LineScan2D_PinsPlexiAluSDH.mat", three_layers),
        ("CopperBlock_2degtTilt.mat", tilted_block),
    ):
        if (FOLDER / name).exists():
            found += score(scan_flaws(read_scan(FOLDER / name)))
        else:
            print(f"SKIPPED: {FOLDER / name} is not there")
    return found if quick else [*found, *simulated(0, 20)]


def main() -> None:
    """Print the figures."""
    options = sys.argv[1:]
    if "--rasters" in options:
        measured = simulated(0, 4, raster=True)
    elif "--seeds" in options:
        first, count = (int(each) for each in options[options.index("--seeds") + 1 :][:2])
        measured = simulated(first, count)
    else:
        measured = rows("--quick" in options)
    for row in measured:
        met = "ok  " if row.met else "MISS"
        print(f"{met} {row.what}: {row.accuracy} (required: {row.required})")


if __name__ == "__main__":
    main()
