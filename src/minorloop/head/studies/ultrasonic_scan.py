"""Ultrasonic scans of a mission: rasters in flowing water, a sweep round the pipe, and maps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import map_coordinates

from minorloop.arrays import FloatArray
from minorloop.head.geometry import Probe
from minorloop.head.procedures.measure import has_coupling, wall_about
from minorloop.head.procedures.meter import Metering
from minorloop.head.procedures.rig import InspectionRig
from minorloop.head.procedures.scan import RasterScan
from minorloop.head.procedures.steps import go
from minorloop.head.procedures.values import Request
from minorloop.head.reconstruction.depth_map import (
    STEP,
    DepthMap,
    Patch,
    WaterLine,
    blend,
    camera_map,
    echo_map,
    find_water,
    paste,
)
from minorloop.head.studies.mission_scene import RADIUS
from minorloop.head.ultrasound.echoes import Burst, average
from minorloop.head.ultrasound.field import CalibratedProbe
from minorloop.head.ultrasound.pits import PitDepth
from minorloop.head.ultrasound.profile import Profile, centred, joined, wall_profile
from minorloop.head.vision.defects import Hole
from minorloop.head.vision.reflectance_map import ReflectanceMap
from minorloop.identification.bands import PER_DEVIATION

REFUSED = "out of reach"
"""Verdict of a place that the probe does not reach in the water."""
TURNS, RING_SHOTS = 48, 4
"""Places of the sweep round the pipe for water line and profile, and shots at each."""
RING, MARGIN = 9.6e-3, 1e-3
"""Least length of the map round the pipe, and margin about a finding, in metres."""


def scan(
    rig: InspectionRig, place: tuple[float, float], *, shift: float = 0.0
) -> tuple[CalibratedProbe, list[Burst]]:
    """Bring the probe over a place in the drained pipe, flood it, and scan a raster in the flow.

    Parameters
    ----------
    rig : InspectionRig
        The water flows until `drain`.
    place : (float, float)
        Phi and z in the middle of the raster.
    shift : float
        Displacement of the raster in pitches, in both directions.
    """
    view = rig.calibration
    scanning = RasterScan(calibration=view, metering=Metering(calibration=view))
    begun = scanning.begin(place, shift=shift, control=rig.control, gain=rig.gain)
    if begun.refused:
        rig.say("reach", begun.refused, succeeded=False)
        return rig.calibration.probe_at(rig.place), []
    drain(rig)
    state, late = rig.run(scanning, begun), rig.trouble
    rig.gain = state.meter.gain
    bursts, planned = state.bursts, scanning.points**2
    words = f"{len(bursts)} of {planned} points{late and '; '}{late}"
    words += f"; rolled back {state.again} x for a row that was passed" if state.again else ""
    rig.say("scan", words, succeeded=len(bursts) == planned and not late)
    coupled = has_coupling(bursts)
    answer = "the wall answers" if coupled else "no echo: camera only"
    rig.say("modality", answer, succeeded=coupled)
    return rig.calibration.probe_at(state.reference), list(bursts)


def refused(rig: InspectionRig) -> bool:
    """Return whether the last scan was refused because the water puts it out of reach."""
    return rig.log[-1].what == "reach" and not rig.log[-1].succeeded


def drain(rig: InspectionRig) -> None:
    """Drain the pipe."""
    rig.reading(Request(water=False))


def fused_wall(
    bursts: Sequence[Burst],
    probe: CalibratedProbe,
    pit: PitDepth,
    hole: Hole,
    view: ReflectanceMap | None,
) -> DepthMap:
    """Fuse echoes and the near view to a map about a pit."""
    centre = (float(hole.place[0]), float(hole.place[1]))
    seen = None if view is None else lambda patch: resampled(view, patch)
    return wall_about(pit, bursts, probe, centre, hole.diameter, seen=seen)


def sweep(rig: InspectionRig, place: tuple[float, float]) -> tuple[Profile, WaterLine]:
    """Roll the catheter once round, and measure profile and water line."""
    go(rig, angles=RasterScan(calibration=rig.calibration).perpendicular)
    profiles = []
    for k in range(TURNS):
        go(rig, place=(rig.place[0], np.radians(-180.0 + 360.0 * k / TURNS)))
        now = rig.reading(Request(shots=RING_SHOTS, frame=True))
        if not np.isfinite(now.base).all():
            continue
        angles = np.tile(now.line_of_sight, (RING_SHOTS, 1))
        burst = average(now.shots, angles, np.zeros(RING_SHOTS))
        profiles.append(wall_profile([burst], rig.calibration.probe_at(now.place)))
    profile = joined(profiles)
    water = find_water(profile.spots[:, 0], profile.detected, RADIUS, face=Probe().face)
    band = f"+- {1e3 * PER_DEVIATION * water.sd:.1f} mm (90 %)"
    words = f"{1e3 * water.height:+.1f} {band} from the axis"
    rig.say("water line", f"{words}; {profile.detected.sum()} of {len(profiles)} places answer")
    return centred(profile), water


def ring_of(
    profile: Profile, views: Sequence[ReflectanceMap], parts: Sequence[DepthMap]
) -> DepthMap:
    """Map the pipe once round: camera, profile and findings."""
    low, high = _span(parts)
    rows, columns = int((high - low) / STEP) + 1, int(2 * np.pi * RADIUS / STEP)
    patch = Patch(-np.pi, low, rows, columns)
    seen = np.zeros((rows, columns), dtype=bool)
    for view in views:
        seen |= np.isfinite(resampled(view, patch))
    echoes = echo_map(patch, profile.spots, profile.depths, profile.sds, footprint=0.35e-3)
    ring = blend(camera_map(patch, seen, np.zeros(seen.shape)), echoes)
    for part in parts:
        ring = paste(ring, part)
    return ring


def _span(parts: Sequence[DepthMap]) -> tuple[float, float]:
    """Return the range along the pipe of a ring with these parts, in metres."""
    ends = [(part.patch.z, part.patch.z + part.patch.rows * part.patch.step) for part in parts]
    middle = 0.5 * sum(ends[0])
    low, high = min(low for low, _ in ends), max(high for _, high in ends)
    return min(low - MARGIN, middle - 0.5 * RING), max(high + MARGIN, middle + 0.5 * RING)


def resampled(view: ReflectanceMap, patch: Patch) -> FloatArray:
    """Resample a view of the camera on a patch (rows, columns); NaN where nothing is seen."""
    x, y = np.moveaxis(view.window.texels(patch.places, patch.radius), -1, 0)
    whole = np.asarray(view.whole, dtype=np.float64)
    return np.asarray(map_coordinates(whole, [y, x], order=1, mode="constant", cval=np.nan))
