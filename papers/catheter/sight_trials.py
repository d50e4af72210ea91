"""A point picked by hand, and a hole found beside a reflection and then tracked (Fig 14).

Graded by the truth. All pixel figures are at the scale of a 320 by 240 image.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import BoolArray, FloatArray
from minorloop_head.control.head import HeadControl
from minorloop_head.geometry import Mount, wall_distance
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.centre import CentreState, Centring
from minorloop_head.procedures.focus import Focusing
from minorloop_head.procedures.go import Go
from minorloop_head.procedures.mark import aim_at
from minorloop_head.procedures.meter import Metering
from minorloop_head.procedures.rig import InspectionRig
from minorloop_head.procedures.steps import acquire, go, meter, search
from minorloop_head.procedures.values import Request
from minorloop_head.twins.catheter import Catheter
from minorloop_head.twins.head import Head
from minorloop_head.twins.pipe import Bore, Dent, Pipe
from minorloop_head.twins.rig import Rig, SimulatedTip
from minorloop_head.vision.reflectance_map import LitFrame
from minorloop_head.vision.tracking import TRACKED
from papers.catheter import scoring
from papers.catheter.inspection_servo import APPROACH, Scene, Swinging, within_stroke

CLICK = 5.0
"""Rms distance in pixels of 640 between a click and what it is meant for."""
AHEAD = (20e-3, 18.5e-3, 17e-3)
"""Distances of the hole ahead of the head in the three pictures of the insertion, in metres."""
AWAY = (25.0, 28.0)
"""Deflection of the head in the last of them, in degrees."""
BESIDE = (1.8e-3, 2.6e-3)
"""Distance of the reflection from the hole, in metres."""
SAME = 0.5e-3
"""Distance in metres from the hole, or from the bead, within which a finding is of it: half of the
hole."""
ATTITUDE_SECONDS, SNAPSHOTS = 6.0, (0.2, 0.5, 0.8)
"""Duration of the motion of the head, and when pictures are kept, as shares of it."""
_TICK = 0.04


@dataclass(frozen=True, eq=False)
class Picked:
    """A point picked by hand.

    ``clicked``, ``outlined`` and ``final`` are its distances in pixels from the true middle of the
    hole: as clicked, on the outline, and as it is tracked once it is centred and in focus; ``off``
    is that of the true middle from the middle of the image then. ``focus`` is the relative error of
    the distance that the autofocus found, NaN if it found none.
    """

    clicked: float
    outlined: float
    final: float
    off: float
    focus: float


@dataclass(frozen=True, eq=False)
class MarkedFrame:
    """A picture, the pixel (2,) where the hole is marked or NaN, and the true one (2,)."""

    image: npt.NDArray[np.uint8]
    marked: FloatArray
    true: FloatArray


@dataclass(frozen=True, eq=False)
class Insertion:
    """Fig 14: three pictures while the head is inserted, three while it turns, and the truth."""

    inserted: tuple[MarkedFrame, ...]
    turned: tuple[MarkedFrame, ...]
    told_apart: int
    """Pictures of the insertion in which the strongest finding is the hole."""
    reflections: int
    """Findings that are the reflection."""
    error: FloatArray
    """Shape (T,). Of the tracked point while the head turns, in pixels."""
    tracked: BoolArray


def run_pick(scene: Scene) -> Picked:
    """Click on a hole, put the point on its outline, centre, expose for it and focus on it."""
    rng = np.random.default_rng([scene.seed, 71])
    rig = scene.rig()
    tip = rig.tip
    assert isinstance(tip, SimulatedTip)
    assert isinstance(rig.plant, Rig)
    metering = Metering(calibration=rig.calibration)
    there = Go(still=math.inf, turning=APPROACH - metering.seconds)
    rig.run(there, there.begin(angles=scene.start))
    rig.run(metering, metering.begin())
    true = scoring.true_pixel(tip.camera, scene.hole.phi, scene.hole.z)
    click = true + CLICK / math.sqrt(2) * rng.standard_normal(2)
    centring = Centring(calibration=rig.calibration)
    frames = acquire(rig)
    pixel = centring.outlined(frames, click, rig.reading())
    camera = rig.calibration.camera_at(rig.place)
    place = camera.place(pixel, frames[-1].pan, frames[-1].tilt)
    state = rig.run(centring, centring.begin(place, pixel))
    meter(rig, state.place)
    lens = rig.calibration.lens
    focusing = Focusing(lens=lens)
    guess = metering.ahead(rig.reading())
    found = rig.run(focusing, focusing.begin(lens.centre, guess)).found
    assert found is not None
    reading = rig.reading(Request(frame=True))
    assert state.track is not None
    now = scoring.true_pixel(tip.camera, scene.hole.phi, scene.hole.z)
    track, _ = centring.follow(state.track, reading, reading.image)
    point = scoring.middle_of(
        scene.mount, rig.plant, (scene.hole.phi, scene.hole.z), scene.pipe.radius
    )
    sharp = found.verdict == "sharp"
    return Picked(
        clicked=0.5 * math.dist(click, true),
        outlined=0.5 * math.dist(pixel, true),
        final=0.5 * math.dist(track.pixel, now) if track.verdict == TRACKED else math.inf,
        off=0.5 * math.dist(now, lens.centre),
        focus=found.distance / float(point[2]) - 1 if sharp else math.nan,
    )


def run_insertion(seed: int, control: HeadControl) -> Insertion:
    """Insert the head into a metal pipe of 20 mm with a hole of 1 mm that shows white.

    Parameters
    ----------
    seed : int
        Of the head, which ``control`` was identified from, and of pipe and camera.
    control : HeadControl
    """
    rng = np.random.default_rng([seed, 72])
    aim, _ = within_stroke(control, rng, AWAY)
    mount = Mount(
        offset=tuple(rng.uniform(-0.2e-3, 0.2e-3, 2).tolist()), roll=float(rng.uniform(-3, 3))
    )
    pose = mount.pose(*aim.tolist())
    phi = math.atan2(pose.rotation[1, 2], pose.rotation[0, 2])
    hole = Bore(phi, 30e-3, 1e-3, inside="white", brightness=2.0)
    way, far = float(rng.uniform(0, 2 * np.pi)), float(rng.uniform(*BESIDE))
    radius = Pipe.radius
    glint = np.array([phi + far * math.cos(way) / radius, hole.z + far * math.sin(way)])
    bead = Dent(float(glint[0]), float(glint[1]), 0.25e-3, 0.2e-3)
    drawn = Pipe.draw(seed)
    pipe = replace(drawn, bores=(hole,), dents=(*drawn.dents, bead))
    plant = Rig(Head(seed, 0.05, seed, delay=_TICK), Catheter(seed, 0.02, seed))
    tip = SimulatedTip(pipe, mount=mount, specimen=seed, seed=seed)
    known = np.array(mount.offset) + 0.05e-3 * rng.standard_normal(2)
    calibration = HeadCalibration(
        lens=tip.camera.calibration,
        leds=tip.camera.leds,
        offset=(float(known[0]), float(known[1])),
        roll=mount.roll,
    )
    rig = InspectionRig(plant, tip, control, calibration)
    inserted, told, reflections = [], 0, 0
    place = np.array([hole.phi, hole.z])  # the operator steers to what he sees
    found = place
    for ahead in AHEAD:
        go(rig, place=(hole.z - ahead, 0.0))
        go(rig, angles=aim_at(calibration, place, rig.place, 0.9))
        meter(rig)
        holes = search(rig).holes
        reading = rig.reading(Request(frame=True))
        assert reading.image is not None
        true = scoring.true_pixel(tip.camera, hole.phi, hole.z)
        marked = np.full(2, np.nan)
        if holes:
            found = np.asarray(holes[0].place)
            camera = calibration.camera_at(reading.place)
            marked = np.asarray(camera.pixel(found, *reading.angles.tolist()))
            told += bool(wall_distance(found, (hole.phi, hole.z), radius) < SAME)
        reflections += sum(bool(wall_distance(h.place, glint, radius) < SAME) for h in holes)
        inserted.append(MarkedFrame(reading.image, marked, true))
    turned, error, tracked = _turned(rig, tip, hole, found, reading.angles)
    return Insertion(tuple(inserted), turned, told, reflections, error, tracked)


def _turned(
    rig: InspectionRig, tip: SimulatedTip, hole: Bore, found: FloatArray, aim: FloatArray
) -> tuple[tuple[MarkedFrame, ...], FloatArray, BoolArray]:
    """Track what was found while the head turns with that of the operator."""
    centring = Centring(calibration=rig.calibration, still=math.inf, patience=ATTITUDE_SECONDS)
    errors: list[float] = []
    seen: list[bool] = []
    shots: list[MarkedFrame] = []
    before = scoring.true_pixel(tip.camera, hole.phi, hole.z)

    def watch(state: CentreState) -> None:
        """Compare with the truth of the frame, which was taken before the tick."""
        nonlocal before
        then, before = before, scoring.true_pixel(tip.camera, hole.phi, hole.z)
        if not state.verdict or state.track is None or state.shown is None:
            return
        seen.append(state.verdict == TRACKED)
        errors.append(0.5 * math.dist(then, state.shown))
        share = len(seen) * _TICK / ATTITUDE_SECONDS
        if len(shots) < len(SNAPSHOTS) and share > SNAPSHOTS[len(shots)]:
            shots.append(MarkedFrame(state.track.before, state.shown, then))

    reading = rig.reading(Request(frame=True))
    assert reading.image is not None
    camera = rig.calibration.camera_at(reading.place)
    pixel = camera.pixel(found, *reading.angles.tolist())
    frame = LitFrame(reading.image, *reading.angles.tolist())
    picked = centring.begin(found, centring.outlined([frame], pixel, reading))
    rig.run(Swinging(centring, aim), picked, watch)
    return tuple(shots), np.array(errors), np.array(seen)


def sight_figures(picks: Sequence[Picked], insertions: Sequence[Insertion]) -> dict[str, Any]:
    """Return the figures of points picked by hand and of Fig 14."""
    known = [abs(one.focus) for one in picks if math.isfinite(one.focus)]
    errors = [one.error[one.tracked] for one in insertions]
    tracked = np.concatenate([one.tracked for one in insertions])
    return {
        "pick": {
            "click_px": float(np.median([one.clicked for one in picks])),
            "outline_px": max(one.outlined for one in picks),
            "final_error_px": max(one.final for one in picks),
            "final_median_px": float(np.median([one.final for one in picks])),
            "off_middle_px": max(one.off for one in picks),
            "focus_error_pct": 100 * max(known, default=math.nan),
            "focus_failed": len(picks) - len(known),
        },
        "fig14": {
            "told_apart": sum(one.told_apart for one in insertions) / len(AHEAD) / len(insertions),
            "reflections_taken": sum(one.reflections for one in insertions),
            "track_error_px_p95": float(np.quantile(np.concatenate(errors), 0.95)),
            "lost_fraction": float(np.mean(~tracked)),
        },
    }
