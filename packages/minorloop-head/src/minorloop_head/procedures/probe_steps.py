"""Steps with the probe of a rig: scan a place of the flooded wall, and measure the defect there."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from scipy.ndimage import map_coordinates

from minorloop.arrays import FloatArray
from minorloop_head.procedures.rig import InspectionRig
from minorloop_head.procedures.scan import NO_COUPLING, RasterScan, ScannedRaster, has_coupling
from minorloop_head.procedures.steps import REFUSED
from minorloop_head.procedures.trace import widest
from minorloop_head.procedures.values import Request
from minorloop_head.reconstruction.depth_map import DepthMap, Patch
from minorloop_head.reconstruction.fusion import wall_about
from minorloop_head.ultrasound.crack_depth import CrackDepth, crack_depth
from minorloop_head.ultrasound.field import CalibratedProbe
from minorloop_head.ultrasound.pits import (
    ASTRAY,
    DEEPER,
    DISTURBED,
    HOLE,
    MEASURED,
    NO_PIT,
    SILENT,
    UNEVEN,
    PitDepth,
    measure_pit,
)
from minorloop_head.vision.cracks import TracedCrack
from minorloop_head.vision.defects import Hole
from minorloop_head.vision.reflectance_map import ReflectanceMap

CONFIRMED, _PROBABLE, _LOOK_AGAIN = "confirmed", "probable", "look again"
"""Grades of findings."""
_LIKELY = math.log(20.0)
"""Least evidence of a probable hole: odds of 20 to 1."""
SEEN_BEFORE = 2
"""Number of views on the way round that confirm a crack without an echo of its depth."""
AGAIN = (DISTURBED, SILENT, ASTRAY)
"""Verdicts after which a raster is scanned again, displaced by half a pitch: they depend on the
positions of the points, and on the turn of the head by the flow at each."""


Scan: TypeAlias = Callable[[InspectionRig, tuple[float, float], float], ScannedRaster]
"""Scans a raster about phi and z, displaced by some pitches, such as `scan`."""


def reach_words(rig: InspectionRig) -> tuple[str, bool]:
    """Return whether the probe reaches the wall in water, as a sentence and a flag."""
    said = RasterScan(calibration=rig.calibration).out_of_reach(rig.control)
    water = f"the probe is within reach in water of {rig.calibration.temperature:.0f} C"
    return said or water, not said


def scan(
    rig: InspectionRig,
    place: tuple[float, float],
    shift: float = 0.0,
    *,
    before: ScannedRaster | None = None,
    told: Callable[[ScannedRaster], None] | None = None,
) -> ScannedRaster:
    """Bring the probe over a place in the drained pipe, flood it, and scan a raster in the flow.

    ``rig``: the water flows until `drain`. ``place``: phi and z in the middle of the raster.
    ``shift``: displacement of the raster in pitches, in both directions. ``before``: the same scan
    as far as it was made before an interruption; the rest is made. ``told``: called with the scan
    so far at its beginning and after each point.
    """
    scanning = RasterScan(calibration=rig.calibration)
    if refused := scanning.out_of_reach(rig.control):
        rig.say("reach", refused, succeeded=False)
        return ScannedRaster(reference=rig.place, refused=refused)
    drain(rig)
    made, last = before or ScannedRaster(), -1

    def each() -> None:
        nonlocal last
        if told is not None and made.point != last:
            last = made.point
            told(made)

    rig.run(scanning.scan(made, place, shift, rig.light), each)
    late, bursts, planned = rig.trouble, made.bursts, scanning.points**2
    words = f"{len(bursts)} of {planned} points{late and '; '}{late}"
    words += f"; rolled back {made.again} x to a row that it had jumped past" if made.again else ""
    rig.say("scan", words, succeeded=len(bursts) == planned and not late)
    coupled = has_coupling(bursts)
    answer = "the wall answers" if coupled else "no echo: camera only"
    rig.say("modality", answer, succeeded=coupled)
    return made


def drain(rig: InspectionRig) -> None:
    """Drain the pipe."""
    rig.reading(Request(water=False))


def scanned_pit(
    rig: InspectionRig, hole: Hole, scan: Scan = scan
) -> tuple[PitDepth, ScannedRaster]:
    """Return the depth of a hole or a pit, and the scan that gave it.

    The scan is repeated once if its verdict depends on the points.

    ``hole``: by the camera.
    """
    place = (float(hole.place[0]), float(hole.place[1]))
    first = scan(rig, place, 0.0)
    if first.refused:
        return PitDepth(REFUSED, *place, hole.diameter), first
    pit = _measured(rig, first, hole, "measure")
    if pit.verdict not in AGAIN:
        return pit, first
    second = scan(rig, place, 0.5)
    other = _measured(rig, second, hole, "measure again")
    return (other, second) if other.measured else (pit, first)


def _measured(rig: InspectionRig, scanned: ScannedRaster, hole: Hole, step: str) -> PitDepth:
    """Measure the pit of a hole from a scan."""
    place = (float(hole.place[0]), float(hole.place[1]))
    probe = probe_of(rig, scanned)
    pit = rig.compute(lambda: measure_pit(scanned.bursts, probe, place, hole.diameter))
    said = f"{pit.bursts} of {len(scanned.bursts)} places; {pit.verdict}"
    rig.say(step, said, succeeded=shown_by_echoes(pit) or pit.verdict == NO_PIT)
    return pit


def scanned_crack(
    rig: InspectionRig, traced: TracedCrack, scan: Scan = scan
) -> tuple[CrackDepth, ScannedRaster]:
    """Scan across a crack where it is widest, and return its depth there.

    ``traced``: in a near view.
    """
    where, width = widest(traced)
    scanned = scan(rig, (float(where[0]), float(where[1])), 0.0)
    if scanned.refused:
        return CrackDepth(REFUSED), scanned
    drain(rig)
    if not has_coupling(scanned.bursts):
        found = CrackDepth(NO_COUPLING)
    else:
        bursts, probe = scanned.bursts, probe_of(rig, scanned)
        found = rig.compute(lambda: crack_depth(bursts, probe, traced.places, width))
    deep = f", {1e3 * found.depth:.2f} mm deep" if np.isfinite(found.depth) else ""
    rig.say("measure", f"{found.verdict}{deep}", succeeded=shown_by_echoes(found))
    return found, scanned


def counts_as_crack(views: int, found: CrackDepth) -> bool:
    """Whether a line that was traced again is a crack.

    It is a crack if two views on the way round showed it, or echoes give its depth.
    """
    return views >= SEEN_BEFORE or shown_by_echoes(found)


def shown_by_echoes(found: PitDepth | CrackDepth) -> bool:
    """Whether echoes alone show that there is a defect: by its floor, or as a through-hole."""
    return found.verdict in (MEASURED, DEEPER, UNEVEN, HOLE)


def grade_of(probed: PitDepth | CrackDepth | None, evidence: float) -> str:
    """Return the grade of a finding: `CONFIRMED`, `_PROBABLE` or `_LOOK_AGAIN`.

    ``probed``: depth by the echoes; only they confirm, since a spot of dirt looks like a hole.
    ``evidence``: of a `Hole`; NaN for a crack, whose line was traced twice.
    """
    if probed is not None and shown_by_echoes(probed):
        return CONFIRMED
    refuted = probed is not None and probed.verdict == NO_PIT
    return _LOOK_AGAIN if refuted or evidence < _LIKELY else _PROBABLE


def probe_of(rig: InspectionRig, scanned: ScannedRaster) -> CalibratedProbe:
    """Return the probe at the reference place of the angles of a scan."""
    return rig.calibration.probe_at(scanned.reference)


def fused_wall(
    scanned: ScannedRaster,
    probe: CalibratedProbe,
    pit: PitDepth,
    hole: Hole,
    view: ReflectanceMap | None,
) -> DepthMap:
    """Fuse echoes and the near view to a map about a pit."""
    centre = (float(hole.place[0]), float(hole.place[1]))
    seen = None if view is None else lambda patch: resampled(view, patch)
    return wall_about(pit, scanned.bursts, probe, centre, hole.diameter, seen=seen)


def resampled(view: ReflectanceMap, patch: Patch) -> FloatArray:
    """Resample a view of the camera on a patch (rows, columns); NaN where nothing is seen."""
    x, y = np.moveaxis(view.window.texels(patch.places, patch.radius), -1, 0)
    whole = np.asarray(view.whole, dtype=np.float64)
    return np.asarray(map_coordinates(whole, [y, x], order=1, mode="constant", cval=np.nan))
