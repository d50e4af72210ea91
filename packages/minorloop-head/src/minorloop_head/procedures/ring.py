"""The pipe once round: a sweep of the probe for profile and water line."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from minorloop_head.geometry import Probe
from minorloop_head.procedures.rig import InspectionRig
from minorloop_head.procedures.scan import RasterScan
from minorloop_head.procedures.steps import go
from minorloop_head.procedures.values import Request
from minorloop_head.reconstruction.depth_map import WaterLine, find_water
from minorloop_head.ultrasound.echoes import average
from minorloop_head.ultrasound.wall_echoes import Profile, centred, joined, wall_profile

TURNS, SHOTS = 48, 4
"""Places of the sweep round the pipe for water line and profile, and shots at each."""
_ASTRAY = 0.4e-3
"""Distance in metres from the wall beyond which an echo is ignored for the water level: of a beam
above the water, some sound returns from the wall beside. Dents and pits are nearer."""
_PLACE_SD = 0.1e-3
"""Standard deviation in metres of the heights of wall and probe: 0.05 mm from their place in the
pipe, the rest from sway and from the width of the beam, of which the part under water answers. It
predicts the errors of the level on 28 simulated pipes."""


@dataclass(frozen=True, eq=False)
class Ring:
    """Profile of the wall once round the pipe, and the water line in it."""

    profile: Profile
    water: WaterLine


def ring_scan(rig: InspectionRig) -> RasterScan:
    """Return the scan of one point that has the angles of the sweep in the present water."""
    return RasterScan(calibration=rig.calibration, points=1).in_water(rig.control)


def ring_sweep(rig: InspectionRig) -> Ring:
    """Roll the catheter once round in the flooded pipe, and measure profile and water line.

    Places at which the camera does not see the turn of the base are skipped.
    """
    view, profiles = rig.calibration, []
    go(rig, angles=ring_scan(rig).perpendicular)
    # Each picture is matched with those before it; cables are wound up by half a turn at most.
    start, way = float(rig.place[1]), -1.0 if rig.place[1] > 0 else 1.0
    for k in range(TURNS):
        go(rig, place=(rig.place[0], start + way * 2 * np.pi * k / TURNS))
        now = rig.reading(Request(shots=SHOTS, frame=True))
        if np.isfinite(now.base).all():
            angles = np.tile(now.line_of_sight, (SHOTS, 1))
            burst = average(now.shots, angles, np.zeros(SHOTS))
            profiles.append(wall_profile([burst], view.probe_at(now.place)))
    profile = centred(joined(profiles))
    answers = profile.detected & (np.abs(profile.depths) < _ASTRAY)
    phi, face, offset = profile.spots[:, 0], Probe().face, view.offset[1]
    water = find_water(phi, answers, view.radius, face=face, offset=offset, place_sd=_PLACE_SD)
    words = f"{profile.detected.sum()} of {len(profiles)} places answer"
    skipped = TURNS - len(profiles)
    words += f"; {skipped} more not used: no view of the turn of the base" if skipped else ""
    rig.say("water line", f"{water.words}; {words}", succeeded=water.seen or water.full)
    return Ring(profile, water)
