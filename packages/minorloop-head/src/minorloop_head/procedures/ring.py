"""The pipe once round: a sweep of the probe for profile and water line, and the map of all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from minorloop_head.geometry import Probe
from minorloop_head.procedures.probe_steps import resampled
from minorloop_head.procedures.rig import InspectionRig
from minorloop_head.procedures.scan import RasterScan
from minorloop_head.procedures.steps import go
from minorloop_head.procedures.values import Request
from minorloop_head.reconstruction.depth_map import (
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
from minorloop_head.ultrasound.echoes import average
from minorloop_head.ultrasound.profile import Profile, centred, joined, wall_profile
from minorloop_head.vision.reflectance_map import ReflectanceMap

TURNS, SHOTS = 48, 4
"""Places of the sweep round the pipe for water line and profile, and shots at each."""
LENGTH, MARGIN = 9.6e-3, 1e-3
"""Least length of the map round the pipe, and margin about a finding, in metres."""
_ASTRAY = 0.4e-3
"""Distance from the wall in metres of an echo that does not count for the level of the water: of a
beam that meets the wall above it, some sound comes back from the wall beside. Dents and pits are
nearer."""


@dataclass(frozen=True, eq=False)
class Ring:
    """Profile of the wall once round the pipe, and the water line that it shows."""

    profile: Profile
    water: WaterLine


def ring_sweep(rig: InspectionRig) -> Ring:
    """Roll the catheter once round in the flooded pipe, and measure profile and water line.

    Places at which the camera does not see the turn of the base are skipped.
    """
    radius = rig.calibration.radius
    go(rig, angles=RasterScan(calibration=rig.calibration).perpendicular)
    profiles = []
    for k in range(TURNS):
        go(rig, place=(rig.place[0], np.radians(-180.0 + 360.0 * k / TURNS)))
        now = rig.reading(Request(shots=SHOTS, frame=True))
        if not np.isfinite(now.base).all():
            continue
        angles = np.tile(now.line_of_sight, (SHOTS, 1))
        burst = average(now.shots, angles, np.zeros(SHOTS))
        profiles.append(wall_profile([burst], rig.calibration.probe_at(now.place)))
    profile = centred(joined(profiles))
    answers = profile.detected & (np.abs(profile.depths) < _ASTRAY)
    water = find_water(profile.spots[:, 0], answers, radius, face=Probe().face)
    words = f"{profile.detected.sum()} of {len(profiles)} places answer"
    skipped = TURNS - len(profiles)
    words += f"; {skipped} more not used: no view of the turn of the base" if skipped else ""
    rig.say("water line", f"{water.words}; {words}", succeeded=water.seen or water.full)
    return Ring(profile, water)


def ring_of(
    profile: Profile,
    views: Sequence[ReflectanceMap],
    parts: Sequence[DepthMap],
    radius: float = 10e-3,
) -> DepthMap:
    """Map the pipe once round: camera, profile and findings."""
    low, high = _span(parts)
    rows, columns = int((high - low) / STEP) + 1, int(2 * np.pi * radius / STEP)
    patch = Patch(-np.pi, low, rows, columns, radius)
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
    return min(low - MARGIN, middle - 0.5 * LENGTH), max(high + MARGIN, middle + 0.5 * LENGTH)
