"""Unattended inspections of flooded pipes by the product, scored: section 5.2 of the paper.

Each pipe has a pit and a crack. The head is in water that cools its wires, refracts, absorbs and
scatters the light, and flows while the probe fires. ``minorloop_head.inspection.inspect`` does the
inspection; the truth is read after its end.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.identification.bands import PER_DEVIATION
from minorloop.threads import one_thread
from minorloop_head.control.head import head_control
from minorloop_head.geometry import Mount, wall_distance, wall_lengths
from minorloop_head.inspection.heads import InspectedHead
from minorloop_head.inspection.inspect_pipe import inspect
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.rig import InspectionRig
from minorloop_head.procedures.scan import RasterScan
from minorloop_head.procedures.seen_base import SeenBase
from minorloop_head.procedures.trace import SAME, one_course
from minorloop_head.procedures.values import LogEntry
from minorloop_head.twins.camera import LENS, Camera
from minorloop_head.twins.catheter import Catheter
from minorloop_head.twins.head import Head
from minorloop_head.twins.pipe import Bore, Crack, Pipe, draw_crack
from minorloop_head.twins.rig import Rig, SimulatedTip
from minorloop_head.twins.surroundings import FULL, Filling, Surroundings, Sway
from minorloop_head.twins.turbid_water import TurbidWater
from papers.catheter import scoring
from papers.catheter.crack_scenes import fine_course
from papers.catheter.inspection_servo import wires_of
from papers.harness import Results, Study, deviation, mean, median

RADIUS = 10e-3
ADVANCES = (4e-3, 8e-3, 12e-3)
"""Places of the catheter in metres from which the head looks round."""
CLASSES = {"30um": (30e-6, 50e-6), "50um": (50e-6, 100e-6), "100um": (100e-6, 300e-6)}
"""Classes of cracks by the width at their widest, in metres, which is equally likely on a
logarithmic scale: up to 100 um a crack counts as a micro-crack."""
TEMPERATURES = (10.0, 20.0, 30.0, 40.0)
"""Temperatures of the water in degrees Celsius for which the reach of a head is computed."""
PROMISED = 3.0
"""Largest error of a depth that counts as measured, in standard deviations: the 90 % band is scored
by its coverage, and excludes one in ten."""


def draw_mission(seed: int) -> tuple[InspectedHead, Results]:
    """Draw a head in a flooded pipe with a pit and a crack, and the truth, for scoring only.

    The truth has ``bore``, ``crack``, ``water`` and ``tip``, whether the wires reach a raster in
    this water, ``reachable``, and, once the head is opened, the ``log`` of its steps.
    """
    rng = np.random.default_rng([seed, 31])
    phi, z, wide, deep = (
        float(rng.uniform(*ends))
        for ends in ((-np.pi, np.pi), (19e-3, 30e-3), (0.9e-3, 1.1e-3), (0.3e-3, 0.8e-3))
    )
    bore = Bore(phi, z, wide, depth=deep, brightness=0.0, lining=0.08)
    crack = crack_beside(bore, np.random.default_rng([seed, 35]))
    pipe = replace(Pipe.draw(seed), bores=(bore,), cracks=(crack,))
    x, y = rng.uniform(-0.2e-3, 0.2e-3, 2).tolist()
    known_x, known_y = (np.array([x, y]) + rng.normal(0, 0.05e-3, 2)).tolist()
    about = np.random.default_rng([seed, 33])
    # In colder water wires that stay under water turn the camera too little. A sleeve whose bore is
    # 10 % wider or narrower differs by 4 % in its convection.
    water = Filling(
        level=FULL * RADIUS,
        temperature=float(about.uniform(30.0, 40.0)),
        sleeve=float(about.uniform(1 - 0.04, 1 + 0.04)),
        pressure=float(np.exp(about.uniform(*np.log((1e5, 2e6))))),
        sway=Sway(),
    )
    around, mount = water.around(Surroundings()), Mount(offset=(x, y))
    head = Head(seed, 0.05, seed, delay=0.04, surroundings=around)
    plant = Rig(head, Catheter(seed, 0.02, seed), flooded=water)
    options: dict[str, Any] = {"mount": mount, "specimen": seed, "seed": seed}
    tip = SimulatedTip(pipe, flooded=water, flow=plant.flood, **options)
    light = TurbidWater.draw(np.random.default_rng([seed, 36]))
    tip.camera = Camera(pipe, mount, specimen=seed, seed=seed, flooded=light)
    view = HeadCalibration(
        lens=tip.camera.calibration.in_water(),
        leds=tip.camera.leds,
        offset=(known_x, known_y),
        thickness=pipe.thickness * float(1 + 0.01 * about.normal()),
        temperature=water.temperature + 0.3 * float(about.normal()),
        tool=tip.tool.calibration,
    )

    @contextmanager
    def opened(told: Callable[[LogEntry], None]) -> Iterator[InspectionRig]:
        wires, coupling = wires_of(seed)
        control = head_control("observer", wires, coupling=coupling)
        rig = InspectionRig(plant, tip, control, view, base=SeenBase(view), told=told)
        truth.log = rig.log
        yield rig
        plant.safe()

    reachable = scoring.reaches(Head(seed), around, RasterScan(calibration=view).joints)
    truth = Results(bore=bore, crack=crack, water=water, tip=tip, reachable=reachable)
    begun = {
        "head": head.serial,
        "calibrated": None,
        "actuator": "a simulated head in water",
        "water [mm above the axis]": "full",
        "water [C]": round(water.temperature, 1),
    }
    return InspectedHead(begun, view, opened, ""), truth


def crack_beside(bore: Bore, rng: np.random.Generator) -> Crack:
    """Draw a crack of 30 to 300 um that the views reach, 3 mm or more away from the bore."""
    low, high = 18e-3, 31e-3
    widest = float(np.exp(rng.uniform(*np.log((30e-6, 300e-6)))))
    while True:
        crack = draw_crack(rng, float(rng.uniform(-np.pi, np.pi)), float(rng.uniform(low, high)))
        z = [along for _, along in crack.points]
        place = bore.phi, bore.z
        off = min(float(wall_distance(corner, place, RADIUS)) for corner in crack.points)
        if low < min(z) and max(z) < high and off > 3e-3:
            widths = widest * np.array(crack.widths) / max(crack.widths)
            return replace(crack, widths=tuple(widths.tolist()))


@one_thread()
def run_mission(seed: int) -> Results:
    """Inspect one pipe; return its figures, the ``content`` of its findings, and its ``log``.

    ``files`` are bytes by their path in the folder of the inspection, the report among them.
    """
    began = time.process_time()
    head, truth = draw_mission(seed)
    with TemporaryDirectory() as folder:
        out = Path(folder) / "inspection"
        content = inspect(head, out, ADVANCES).content
        files = {
            path.relative_to(out).as_posix(): path.read_bytes()
            for path in out.rglob("*")
            if path.is_file()
        }
    figures = {**scored(content, truth), "processor_s": time.process_time() - began}
    return Results(figures, seed=seed, content=content, log=tuple(truth.log), files=files)


def scored(content: Mapping[str, Any], truth: Results) -> dict[str, Any]:
    """Return the errors of the findings of an inspection; NaN without a finding."""
    found, bore, log = content["findings"], truth.bore, truth.log
    holes = [row for row in found if row["kind"] not in ("crack", "mark")]
    off = [wall_distance(_place(row), (bore.phi, bore.z), RADIUS) for row in holes]
    near = [row for row, far in zip(holes, off, strict=True) if far < SAME]
    pit = next((row for row in near if shown(row, "measured")), None)
    touches = [scoring.apart(place, bore, RADIUS) for place in truth.tip.tool.touches]
    touched = min((touch for touch in touches if touch < 2 * SAME), default=math.nan)
    depth = band = position = wide = math.nan
    if pit is not None:
        depth = pit["depth [mm]"] - 1e3 * bore.depth
        band = pit["depth_sd [mm]"]
        position = 1e3 * float(wall_distance(_place(pit), (bore.phi, bore.z), RADIUS))
        wide = 100 * abs(1e-3 * pit["width [mm]"] / bore.diameter - 1)
    return {
        "found": bool(near),
        "measured": bool(abs(depth) <= PROMISED * band),
        "reachable": truth.reachable,
        "refused": any(one.what == "reach" and not one.succeeded for one in log),
        "false_holes": len(holes) - len(near),
        "marks": sum(row["kind"] == "mark" for row in found),
        "seconds": content["seconds"],
        "touch_mm": 1e3 * touched,
        "position_mm": position,
        "diameter_error_pct": wide,
        "depth_off_um": 1e3 * depth,
        "in_band": bool(abs(depth) <= PER_DEVIATION * band),
        **_crack_figures([row for row in found if row["kind"] == "crack"], truth.crack),
    }


def shown(row: Mapping[str, Any], verdict: str) -> bool:
    """Return whether echoes of all places or some give a verdict on a finding, and no step failed.

    ``row``: of the finding.
    """
    said: str = row["verdict"]
    return said.startswith(verdict) and "but failed" not in said


def _place(row: Mapping[str, Any]) -> tuple[float, float]:
    return math.radians(row["phi [deg]"]), 1e-3 * row["z [mm]"]


def _crack_figures(rows: Sequence[Mapping[str, Any]], truth: Crack) -> dict[str, Any]:
    """Return the errors of reported cracks; a crack that is not on the true one is false."""
    course, _ = fine_course(truth, RADIUS)
    right = [row for row in rows if one_course(np.array(row["course"]), course, RADIUS)]
    best = max(right, key=lambda row: float(row["length [mm]"]), default=None)
    errors = dict.fromkeys(("length_error_pct", "width_error_um", "depth_error_mm"), math.nan)
    deep = None if best is None else best["depth [mm]"]
    if best is not None:
        length = 1e3 * float(wall_lengths(course, RADIUS)[-1])
        errors["length_error_pct"] = 100 * abs(best["length [mm]"] / length - 1)
        middle = 1e6 * float(np.median(truth.widths))
        errors["width_error_um"] = abs(1e3 * best["width [mm]"] - middle)
    if deep is not None:
        errors["depth_error_mm"] = abs(deep - 1e3 * truth.depth)
    return {
        "crack_width": max(truth.widths),
        "crack_found": bool(right),
        "false_cracks": len(rows) - len(right),
        "crack_measured": deep is not None,
        **{f"crack_{name}": value for name, value in errors.items()},
    }


def gather(runs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return shares of all missions, and medians over those with a result."""
    within = [run for run in runs if run["reachable"]]
    beyond = [run for run in runs if not run["reachable"]]
    cracks = [run for run in runs if run["crack_found"]]
    touches = [run["touch_mm"] for run in runs if not math.isnan(run["touch_mm"])]
    deep = [run for run in runs if not math.isnan(run["depth_off_um"])]
    off = [run["depth_off_um"] for run in deep]
    found: dict[str, Any] = {
        "of": len(runs),
        "each": [dict(run) for run in runs],
        "pits_found": mean([run["found"] for run in runs]),
        "pits_measured": mean([run["measured"] for run in within]),
        "reachable": len(within),
        "unreachable_said": mean([run["refused"] for run in beyond]),
        "refused_in_vain": sum(run["refused"] for run in within),
        "touches": len(touches),
        "touched": mean(np.array(touches) <= 0.3),
        "in_band": mean([run["in_band"] for run in deep]),
        "depth_bias_um": mean(off),
        "depth_sd_um": deviation(off),
        "cracks_found": mean([run["crack_found"] for run in runs]),
        "crack_measured": mean([run["crack_measured"] for run in cracks]),
    }
    for name, (low, high) in CLASSES.items():
        own = [run["crack_found"] for run in runs if low <= run["crack_width"] < high]
        found |= {f"cracks_{name}": mean(own), f"cracks_{name}_of": len(own)}
    for name in ("false_holes", "marks", "false_cracks"):
        found[name] = sum(run[name] for run in runs) / len(runs)
    medians = (
        *("seconds", "processor_s", "position_mm", "diameter_error_pct"),
        *("crack_length_error_pct", "crack_width_error_um", "crack_depth_error_mm"),
    )
    for name in medians:
        found[name] = median([run[name] for run in runs if not math.isnan(run[name])])
    return {"mission": found}


def water(temperature: float) -> Surroundings:
    """Return the surroundings of sleeved wires in a flooded pipe at a temperature."""
    return Filling(level=FULL * RADIUS, temperature=temperature).around(Surroundings())


def needed() -> FloatArray:
    """Return the least and largest reading (2, 2) of the joints in a raster, in degrees.

    The head is the nominal one.
    """
    return RasterScan(calibration=HeadCalibration(lens=LENS, leds=np.empty((0, 3)))).joints


def reach_figures(seed: int) -> dict[str, float]:
    """Return, for each temperature of the water, whether a head reaches its raster (1 or 0).

    A reachable raster is reachable everywhere in the pipe: the catheter rolls and advances.
    """
    needs = needed()
    return {
        f"at_{temperature:.0f}_c": float(scoring.reaches(Head(seed), water(temperature), needs))
        for temperature in TEMPERATURES
    }


STUDY = Study("missions", "Unattended inspections of flooded pipes", run_mission, gather)
