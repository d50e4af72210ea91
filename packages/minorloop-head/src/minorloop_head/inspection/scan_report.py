"""Output of ``minorloop head scan`` for a recorded scan: its flaws as a table, and a report."""

from __future__ import annotations

import json
import math
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.drawing.layout import new_figure
from minorloop.errors import counted
from minorloop.files import PathLike, new_folder, table_text, write_atomically
from minorloop.report import Picture, Report, Table
from minorloop_head.inspection.report import with_sd, written
from minorloop_head.reconstruction.findings import rounded
from minorloop_head.ultrasound.scan_flaws import ScanFlaw, ScanFlaws
from minorloop_head.ultrasound.scan_surfaces import Field, envelope, recorded_field

COLUMNS = (
    "no.",
    "grade",
    "layer",
    "x [mm]",
    "y [mm]",
    "width [mm]",
    "length [mm]",
    "size [mm]",
    "depth [mm]",
)
"""Columns of the table of flaws, with the names of the findings of an inspection where equal."""
_DIGITS = {"x [mm]": 1, "y [mm]": 1, "width [mm]": 1, "length [mm]": 1, "depth [mm]": 2}
_MEANING = (
    "x and y are counted from the first A-scan, depths from the top of the layer along its normal; "
    "the number after ± is one standard deviation at the stated speed of sound. Width and length "
    "are those at half the amplitude (6 dB drop) after focusing. A size is given where they are "
    "more than those of a point; others are at most (≤) as large. Confirmed is twice as loud as a "
    "flaw must be over noise and structure at its depth; probable is less."
)
_RANGE = 40.0
"""Drawn range in decibels below the loudest echo."""
_ROWS = 500
"""Number of depths of a picture."""


def _flaw_row(flaw: ScanFlaw) -> dict[str, Any]:
    """Return a flaw in mm; unknown values are None."""
    point = math.isnan(flaw.size)
    largest = float(np.nanmax([flaw.width, flaw.length]))
    bound = f"a point, at most {1e3 * largest:.1f} mm" if point else "larger than a point"
    lengths = {
        "x [mm]": flaw.x,
        "x_sd [mm]": flaw.place_sd,
        "y [mm]": flaw.y,
        "y_sd [mm]": flaw.place_sd if math.isfinite(flaw.y) else math.nan,
        "width [mm]": flaw.width,
        "length [mm]": flaw.length,
        "size [mm]": flaw.size,
        "depth [mm]": flaw.depth,
        "depth_sd [mm]": flaw.depth_sd,
        "below the probe [mm]": flaw.below,
    }
    return {
        "grade": flaw.grade,
        "kind": "flaw" if not flaw.why else "repeat",
        "layer": flaw.layer,
        **{name: rounded(1e3 * value, 3) for name, value in lengths.items()},
        "level [dB]": round(flaw.level, 1),
        "verdict": flaw.why or bound,
    }


def scan_content(found: ScanFlaws, source: str) -> dict[str, Any]:
    """Return the content of ``findings.json``."""
    scan, surfaces = found.scan, found.surfaces
    clipped = scan.clipped
    layers = [
        {
            "layer": each.number,
            "speed [m/s]": each.speed,
            "top [us]": round(1e6 * each.top, 3),
            "bottom [us]": round(1e6 * each.bottom, 3),
            "thickness [mm]": rounded(1e3 * each.thickness, 3),
        }
        for each in found.layers
    ]
    return {
        "scan": source,
        "A-scans": list(scan.traces.shape[1 : 3 if scan.traces.shape[2] > 1 else 2]),
        "samples": len(scan.traces),
        "rate [MHz]": round(1e-6 / scan.interval, 6),
        "band [MHz]": [round(1e-6 * each, 3) for each in scan.pulse_band],
        "clipped": clipped,
        "surfaces [us]": [round(1e6 * each, 3) for each in surfaces.times.tolist()],
        "tilt [deg]": rounded(math.degrees(found.tilt), 3),
        "layers": layers,
        "findings": [_flaw_row(each) for each in found.flaws],
        "repeats": [_flaw_row(each) for each in found.repeats],
        "advice": list(found.advice),
    }


def scan_cells(content: dict[str, Any]) -> list[list[str]]:
    """Return the flaws as cells of `COLUMNS`; the size of a point is an upper limit."""
    cells = []
    for number, row in enumerate(content["findings"], 1):
        known = {"x_sd [mm]": None, "width_sd [mm]": None, "length_sd [mm]": None, **row}
        numbers = {name: with_sd(known, name, digits) for name, digits in _DIGITS.items()}
        most = max(row["width [mm]"] or 0.0, row["length [mm]"] or 0.0)
        numbers["size [mm]"] = f"{'≤ ' if row['size [mm]'] is None else ''}{most:.1f}"
        shown = {**row, **numbers, "no.": number}
        cells.append([str(shown[name]) for name in COLUMNS])
    return cells


def scan_summary(content: dict[str, Any]) -> str:
    """Return a sentence on the found flaws."""
    grades = Counter(row["grade"] for row in content["findings"])
    each = ", ".join(f"{count} {grade}" for grade, count in grades.items())
    found = counted(len(content["findings"]), "flaw") + (f" ({each})" if each else "")
    count = math.prod(content["A-scans"])
    said = f"{found} in {counted(len(content['layers']), 'layer')}, {counted(count, 'A-scan')}"
    repeats = content["repeats"]
    said += f"; {counted(len(repeats), 'echo')} that others explain left out" if repeats else ""
    if content["tilt [deg]"] is not None:
        said += f"; the first surface is tilted by {content['tilt [deg]']:.2f} degrees"
    return said.replace("echos", "echoes")


def keep_scan(found: ScanFlaws, out: PathLike, source: str) -> dict[str, Any]:
    """Write findings and report into a new or empty folder, and return the findings.

    Raises an `OutputError` if the folder is not empty, or cannot be written.
    """
    content = scan_content(found, source)
    with new_folder(out) as folder:
        rows = content["findings"]
        names = list(_flaw_row(found.flaws[0])) if rows else []
        listed = ([number, *row.values()] for number, row in enumerate(rows, 1))
        write_atomically(folder / "findings.csv", table_text(["number", *names], listed))
        write_atomically(folder / "findings.json", json.dumps(content, indent=1) + "\n")
        written(lambda: scan_report(found, content), folder / "report.html")
    return content


def scan_report(found: ScanFlaws, content: dict[str, Any]) -> Report:
    """Return the report on a scan with its content of ``findings.json``."""
    report = Report(f"Scan {Path(content['scan']).name}", scan_summary(content))
    report.add(
        "Flaws",
        text=_MEANING,
        table=Table(COLUMNS, scan_cells(content)),
        notes=content["advice"],
    )
    recorded = recorded_field(found.scan).earlier(found.surfaces.offsets)
    for line in _lines(found):
        caption = (
            f"B-scan{_at(found, line)}: as recorded, level with the first surface, and focused "
            "through the layers, without what most places have in common and where echoes of "
            "surfaces hide others. Dashed lines are surfaces, numbers those of the table."
        )
        report.add("B-scan", pictures=[Picture(_draw_b_scan(found, recorded, line), caption)])
    if found.scan.traces.shape[2] > 1:
        caption = "C-scan: the loudest echo over each place of a layer, focused."
        report.add("C-scan", pictures=[Picture(_draw_c_scan(found), caption)])
    table = Table(tuple(content["layers"][0]), [_texts(row) for row in content["layers"]])
    report.add("Layers", table=table)
    if content["repeats"]:
        names = ("layer", "x [mm]", "y [mm]", "depth [mm]", "level [dB]", "verdict")
        rows = [_texts({name: row[name] for name in names}) for row in content["repeats"]]
        text = "These echoes are no flaws of their own, because other echoes explain them."
        report.add("Repeats", text=text, table=Table(names, rows))
    return report


def _texts(row: dict[str, Any]) -> list[str]:
    return ["-" if value is None else str(value) for value in row.values()]


def _lines(found: ScanFlaws) -> list[int]:
    """Return the lines along x to draw: those with the loudest flaw of each layer."""
    if found.scan.traces.shape[2] == 1:
        return [0]
    lines = []
    for layer in found.layers:
        own = [each for each in found.flaws if each.layer == layer.number]
        if own:
            lines.append(round(max(own, key=lambda one: one.level).y / found.scan.steps[1]))
    return sorted(set(lines)) or [found.scan.traces.shape[2] // 2]


def _at(found: ScanFlaws, line: int) -> str:
    single = found.scan.traces.shape[2] == 1
    return "" if single else f" at y = {1e3 * line * found.scan.steps[1]:.1f} mm"


def _draw_b_scan(found: ScanFlaws, recorded: Field, line: int = 0) -> Any:
    """Draw a line along x of a scan before and after focusing, with the flaws marked.

    ``recorded``: the field of the scan, level with its first surface.
    """
    scan = found.scan
    deepest = found.layers[-1].above + found.layers[-1].depths[-1]
    depths = np.linspace(found.layers[0].depths[0], deepest, _ROWS)
    times, focused = np.zeros(_ROWS), np.zeros((_ROWS, scan.traces.shape[1]))
    for layer in found.layers:
        below = depths - layer.above
        inside = below >= 0
        times[inside] = layer.top + 2 * below[inside] / layer.speed
        for column, picture in zip(focused.T, layer.picture[:, :, line].T, strict=True):
            column[inside] = np.interp(below[inside], layer.depths, picture, right=0.0)
    one = Field(recorded.spectrum[:, :, line : line + 1], recorded.omega, scan.steps)
    before = envelope(one, times)[:, :, 0]
    wide = 1e3 * scan.steps[0] * (scan.traces.shape[1] - 1)
    tall = 1e3 * (deepest - depths[0])
    beside = wide < tall  # narrow pictures stand side by side
    size = (6.6 * min(tall / wide / 2, 1.2)) if beside else 2 * 8.0 * tall / wide
    figure, axes = new_figure(
        *((1, 2) if beside else (2, 1)), height=min(max(size, 3.6), 11.0), grid=False,
        sharex=True, sharey=True,
    )  # fmt: skip
    extent = (0.0, wide, 1e3 * deepest, 1e3 * depths[0])
    for axis, picture, name in zip(axes, (before, focused), ("recorded", "focused"), strict=True):
        drawn = _decibels(axis, picture, float(np.nan_to_num(picture).max()), extent)
        axis.set_title(name)
        axis.set_xlabel("x [mm]")
        axis.set_ylabel("below the probe [mm]")
        for layer in found.layers[1:]:
            axis.axhline(1e3 * layer.above, color="w", lw=0.8, ls="--")
    figure.colorbar(drawn, ax=axes, label="dB below the loudest", shrink=0.8)
    y = line * scan.steps[1]
    for number, flaw in enumerate(found.flaws, 1):
        if scan.traces.shape[2] == 1 or abs(flaw.y - y) <= max(flaw.length, scan.steps[1]):
            _mark(axes[1], 1e3 * flaw.x, 1e3 * flaw.below, number)
    return figure


def _draw_c_scan(found: ScanFlaws) -> Any:
    """Draw the loudest echo over each place of each layer of a raster, with the flaws marked."""
    (_, nx, ny), (dx, dy) = found.scan.traces.shape, found.scan.steps
    figure, axes = new_figure(1, len(found.layers), 3.6, grid=False, squeeze=False)
    loudest = max(float(np.nan_to_num(layer.picture).max()) for layer in found.layers)
    for axis, layer in zip(axes[0], found.layers, strict=True):
        extent = (-500 * dx, 1e3 * (nx - 0.5) * dx, 1e3 * (ny - 0.5) * dy, -500 * dy)
        drawn = _decibels(axis, np.nan_to_num(layer.picture).max(axis=0).T, loudest, extent)
        axis.set_title(f"layer {layer.number}")
        axis.set_xlabel("x [mm]")
        for number, flaw in enumerate(found.flaws, 1):
            if flaw.layer == layer.number:
                _mark(axis, 1e3 * flaw.x, 1e3 * flaw.y, number)
    axes[0, 0].set_ylabel("y [mm]")
    figure.colorbar(drawn, ax=axes, label="dB below the loudest", shrink=0.8)
    return figure


def _decibels(axis: Any, picture: FloatArray, loudest: float, extent: tuple[float, ...]) -> Any:
    level = 20 * np.log10(np.maximum(picture / max(loudest, 1e-30), 1e-9))
    options = {"cmap": "viridis", "vmin": -_RANGE, "vmax": 0.0, "interpolation": "nearest"}
    return axis.imshow(level, extent=extent, aspect="equal", **options)


def _mark(axis: Any, x: float, y: float, number: int) -> None:
    axis.plot(x, y, "o", ms=11, mec="C1", mfc="none", mew=1.2)
    axis.annotate(str(number), (x, y), (8, 0), textcoords="offset points", color="C1", va="center")
