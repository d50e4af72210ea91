"""What a crew hears: rasters in the flow of the water, a sweep round the pipe, and maps of both."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import map_coordinates

from minorloop.arrays import FloatArray
from minorloop.geometry import Probe, wrapped
from minorloop.identification.bands import PER_DEVIATION
from minorloop.inspection.echoes import Burst, average, choose_modality
from minorloop.inspection.field import Ear
from minorloop.inspection.fusion import fuse, mean_depths, outline_of
from minorloop.inspection.pits import PitDepth, raster
from minorloop.inspection.profile import Profile, centred, joined, wall_profile
from minorloop.inspection.unrolled import (
    STEP,
    Patch,
    WallMap,
    WaterLine,
    blend,
    camera_map,
    find_water,
    paste,
    sonar_map,
)
from minorloop.studies.mission_crew import RADIUS, RASTER_TIME, SHOTS, SWAY, Crew, distance
from minorloop.twins.ultrasound import Ultrasound
from minorloop.vision.defects import Hole
from minorloop.vision.wallmap import WallMap as Shades

PATCH = 2.4e-3
"""Side of the map about a finding, in metres."""
TURNS, RING_SHOTS = 48, 4
"""Places of the sweep round the pipe for the water line and the profile, and shots at each."""
RING, MARGIN = 9.6e-3, 1e-3
"""Least length of the map once round the pipe, and what it shows beside a finding, in metres."""
PITCH = 0.32e-3
"""Of a raster, in metres."""


def scan(
    crew: Crew, place: tuple[float, float], *, shift: float = 0.0
) -> tuple[Ultrasound, Ear, list[Burst]]:
    """Bring the probe square to a place, let water in, and scan a raster in its flow.

    Parameters
    ----------
    crew : Crew
        Where it is; the water flows on afterwards, until ``crew.head.sway`` is None.
    place : (float, float)
        Phi and z in the middle of the raster.
    shift : float
        By how much of its pitch the raster is moved, both ways.
    """
    phi, z = place
    crew.travel(1e3 * z, float(np.degrees(wrapped(phi))))
    probe, ear = crew.probe(), crew.ear
    off = shift * PITCH
    targets = raster(ear, (phi + off / RADIUS, z + off), pitch=PITCH)
    crew.turn(targets[0])
    crew.head.sway = SWAY
    bursts = []
    for k, target in enumerate(targets):
        crew.turn(target, RASTER_TIME)
        shots = crew.shots(probe, SHOTS)
        if k == 0:
            way = choose_modality(shots, RADIUS - ear.probe.face, ear.speed)
            crew.say("modality", "the wall is heard" if way == "sonar" else "no echo: camera only")
        angles = crew.sight
        spot, wanted = ear.spots(np.array([angles, target]))[:, :2]
        away = distance(spot, wanted)
        bursts.append(
            average(shots, np.tile(angles, (SHOTS, 1)), np.full(SHOTS, away), most_off=0.8e-3)
        )
    return probe, ear, bursts


def rebuilt(
    bursts: Sequence[Burst],
    ear: Ear,
    pit: PitDepth,
    hole: Hole,
    view: Shades | None,
) -> WallMap:
    """Echoes and the nearest view fused to a map about a pit."""
    phi, z = hole.place.tolist()
    patch = Patch.around(phi, z, size=PATCH)
    heard = mean_depths(bursts, ear, patch, pit)
    image = None if view is None else laid(view, patch)
    outline = None if image is None else outline_of(image, patch, (phi, z), hole.diameter)
    return fuse(pit, heard, patch, image=image, outline=outline)


def sweep(crew: Crew, probe: Ultrasound, place: tuple[float, float]) -> tuple[Profile, WaterLine]:
    """Roll the catheter once round: where the wall answers, and how far it is."""
    crew.turn(raster(crew.ear, place, points=1)[0])
    profiles = []
    for k in range(TURNS):
        crew.travel(float(crew.place[0]), -180.0 + 360.0 * k / TURNS)
        crew.carry(probe)
        shots = crew.shots(probe, RING_SHOTS)
        angles = np.tile(crew.sight, (RING_SHOTS, 1))
        profiles.append(wall_profile([average(shots, angles, np.zeros(RING_SHOTS))], crew.ear))
    profile = joined(profiles)
    water = find_water(profile.spots[:, 0], profile.heard, RADIUS, face=Probe().face)
    band = f"+- {1e3 * PER_DEVIATION * water.sd:.1f} mm (90 %)"
    words = f"{1e3 * water.height:+.1f} {band} from the axis"
    crew.say("water line", f"{words}; {profile.heard.sum()} of {TURNS} places heard")
    return centred(profile), water


def ring_of(profile: Profile, views: Sequence[Shades], parts: Sequence[WallMap]) -> WallMap:
    """Once round the pipe: what the camera saw, the profile, and the findings in one map."""
    low, high = _span(parts)
    rows, columns = int((high - low) / STEP) + 1, int(2 * np.pi * RADIUS / STEP)
    patch = Patch(-np.pi, low, rows, columns)
    seen = np.zeros((rows, columns), dtype=bool)
    for view in views:
        seen |= np.isfinite(laid(view, patch))
    spoken = sonar_map(patch, profile.spots, profile.depths, profile.sds, footprint=0.35e-3)
    ring = blend(camera_map(patch, seen, np.zeros(seen.shape)), spoken)
    for part in parts:
        ring = paste(ring, part)
    return ring


def _span(parts: Sequence[WallMap]) -> tuple[float, float]:
    """From where to where along the pipe a ring with these parts goes, in metres."""
    ends = [(part.patch.z, part.patch.z + part.patch.rows * part.patch.step) for part in parts]
    middle = 0.5 * sum(ends[0])
    low, high = min(low for low, _ in ends), max(high for _, high in ends)
    return min(low - MARGIN, middle - 0.5 * RING), max(high + MARGIN, middle + 0.5 * RING)


def laid(view: Shades, patch: Patch) -> FloatArray:
    """What a view of the camera shows on a patch (rows, columns); NaN where it saw nothing."""
    window, places = view.window, patch.places
    half = 0.5 * (window.columns - 1)
    middle = window.phi + half * window.step / patch.radius
    x = wrapped(places[..., 0] - middle) * patch.radius / window.step + half
    y = (places[..., 1] - window.z) / window.step
    laid: FloatArray = map_coordinates(
        np.asarray(view.whole, dtype=np.float64), [y, x], order=1, mode="constant", cval=np.nan
    )
    return laid
