"""Tracking by the camera of the head, compared with the truth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from minorloop.arrays import BoolArray, FloatArray
from minorloop.report import Table
from minorloop_head.control.head import HeadControl
from minorloop_head.geometry import Mount, wall_distance
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.centre import Centred, Centring
from minorloop_head.procedures.focus import focus
from minorloop_head.procedures.mark import aim_at
from minorloop_head.procedures.meter import wall_ahead
from minorloop_head.procedures.rig import InspectionRig
from minorloop_head.procedures.steps import go, meter, search
from minorloop_head.procedures.values import Request
from minorloop_head.twins.catheter import Catheter
from minorloop_head.twins.head import Head
from minorloop_head.twins.pipe import Bore, Dent, Pipe
from minorloop_head.twins.rig import Rig, SimulatedTip
from minorloop_head.vision.calibrated_camera import Image
from minorloop_head.vision.reflectance_map import LitFrame
from minorloop_head.vision.tracking import TRACKED
from papers.catheter import scoring
from papers.catheter.inspection_servo import Scene, clicked, swinging, within_stroke
from papers.catheter.tracking_trials import WALLS, run_tracking, tracking_figures
from papers.claims import cell
from papers.drawing import draw, panel, photo
from papers.harness import Results, median

AHEAD = (20e-3, 18.5e-3, 17e-3)
"""Distances of the hole ahead of the head in the three pictures of the insertion, in metres."""
SAME = 0.5e-3
"""Distance in metres from the hole, or from the bead, within which a finding is of it: half of the
hole."""
ATTITUDE_SECONDS, SNAPSHOTS = 6.0, (0.2, 0.5, 0.8)
"""Duration of the motion of the head, and times of the kept pictures, as shares of it."""
_TICK = 0.04


def run_pick(scene: Scene) -> dict[str, float]:
    """Click on a hole, put the point on its outline, centre, expose for it and focus on it.

    ``final`` is the distance in pixels of the point from the true middle of the hole, tracked once
    it is centred and in focus. ``focus`` is the relative error of the distance by the autofocus,
    NaN if it failed.
    """
    rig = scene.rig()
    tip, hole = rig.tip, scene.hole
    assert isinstance(tip, SimulatedTip)
    assert isinstance(rig.plant, Rig)
    seen = partial(scoring.true_pixel, tip.camera, hole.phi, hole.z)
    picked, centring = clicked(scene, rig, seen), Centring(calibration=rig.calibration)
    state = rig.run(centring.centre(picked))
    meter(rig, state.place)
    lens = rig.calibration.lens
    found = rig.run(focus(lens, lens.centre, wall_ahead(rig.calibration, rig.reading())))
    reading = rig.reading(Request(frame=True))
    assert state.track is not None
    now = seen()
    track, _ = centring.follow(state.track, reading, reading.image)
    point = scoring.middle_of(scene.mount, rig.plant, (hole.phi, hole.z), scene.pipe.radius)
    sharp = found.verdict == "sharp"
    return {
        "final": 0.5 * math.dist(track.pixel, now) if track.verdict == TRACKED else math.inf,
        "focus": found.distance / float(point[2]) - 1 if sharp else math.nan,
    }


def run_insertion(seed: int, control: HeadControl) -> Results:
    """Insert the head into a metal pipe of 20 mm with a hole of 1 mm that shows white.

    The seed is that of the head, whose control it is, and of pipe and camera. ``shots`` are
    pictures with the pixel (2,) where the hole is marked, or NaN: three while the head is inserted,
    three while it turns. In ``told_apart`` of the first the strongest finding is the hole, and
    ``reflections`` findings are the reflection. ``error`` (T,) is that of the tracked point while
    the head turns, in pixels, and ``tracked`` (T,) whether it counted as tracked.
    """
    rng = np.random.default_rng([seed, 72])
    aim, _ = within_stroke(control, rng, (25.0, 28.0))
    mount = Mount(
        offset=tuple(rng.uniform(-0.2e-3, 0.2e-3, 2).tolist()), roll=float(rng.uniform(-3, 3))
    )
    pose = mount.pose(*aim.tolist())
    phi = math.atan2(pose.rotation[1, 2], pose.rotation[0, 2])
    hole = Bore(phi, 30e-3, 1e-3, inside="white", brightness=2.0)
    way, far = float(rng.uniform(0, 2 * np.pi)), float(rng.uniform(1.8e-3, 2.6e-3))
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
    told = reflections = 0
    shots: list[tuple[Image, FloatArray]] = []
    place = np.array([hole.phi, hole.z])  # the operator steers by the picture
    found = place
    for ahead in AHEAD:
        go(rig, place=(hole.z - ahead, 0.0))
        go(rig, angles=aim_at(calibration, place, rig.place, 0.9))
        meter(rig)
        holes = search(rig).holes
        reading = rig.reading(Request(frame=True))
        assert reading.image is not None
        marked = np.full(2, np.nan)
        if holes:
            found = np.asarray(holes[0].place)
            camera = calibration.camera_at(reading.place)
            marked = np.asarray(camera.pixel(found, *reading.angles.tolist()))
            told += bool(wall_distance(found, (hole.phi, hole.z), radius) < SAME)
        reflections += sum(bool(wall_distance(h.place, glint, radius) < SAME) for h in holes)
        shots.append((reading.image, marked))
    turned, error, tracked = _turned(rig, tip, hole, found, reading.angles)
    return Results(
        shots=(*shots, *turned), told_apart=told, reflections=reflections, error=error,
        tracked=tracked,
    )  # fmt: skip


def _turned(
    rig: InspectionRig, tip: SimulatedTip, hole: Bore, found: FloatArray, aim: FloatArray
) -> tuple[list[tuple[Image, FloatArray]], FloatArray, BoolArray]:
    """Track a found hole while the head follows the operator's head."""
    centring = Centring(calibration=rig.calibration, still=math.inf, patience=ATTITUDE_SECONDS)
    errors: list[float] = []
    seen: list[bool] = []
    shots: list[tuple[Image, FloatArray]] = []
    where = partial(scoring.true_pixel, tip.camera, hole.phi, hole.z)
    before = where()

    def watch() -> None:
        """Compare with the truth of the frame, which was taken before the tick."""
        nonlocal before
        then, before = before, where()
        if not point.verdict or point.track is None or point.shown is None:
            return
        seen.append(point.verdict == TRACKED)
        errors.append(0.5 * math.dist(then, point.shown))
        share = len(seen) * _TICK / ATTITUDE_SECONDS
        if len(shots) < len(SNAPSHOTS) and share > SNAPSHOTS[len(shots)]:
            shots.append((point.track.before, point.shown))

    reading = rig.reading(Request(frame=True))
    assert reading.image is not None
    camera = rig.calibration.camera_at(reading.place)
    angles = reading.angles.tolist()
    outline = centring.outlined(
        [LitFrame(reading.image, *angles)], camera.pixel(found, *angles), reading
    )
    point = Centred(place=found, shown=outline)
    rig.run(swinging(centring.centre(point), aim), watch)
    return shots, np.array(errors), np.array(seen)


def gather_sight(found: Sequence[Results]) -> dict[str, Any]:
    """Return the figures over all points, picks and pictures of Fig 14 of several specimens."""
    picks, insertions = [one.pick for one in found], [one.insertion for one in found]
    each = {key: [one[key] for one in picks] for key in picks[0]}
    known = [abs(focus) for focus in each["focus"] if math.isfinite(focus)]
    errors = [one.error[one.tracked] for one in insertions]
    tracked = np.concatenate([one.tracked for one in insertions])
    return {
        "tracking": tracking_figures([one for run in found for one in run.followed]),
        "pick": {
            "final_error_px": max(each["final"]),
            "final_median_px": median(each["final"]),
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


def run_sight(seed: int, control: HeadControl) -> Results:
    """Track, pick, insert and touch with the head of a seed, under its own control."""
    return Results(
        followed=run_tracking(seed),
        pick=run_pick(Scene(seed)),
        insertion=run_insertion(seed, control),
    )


def walls_table(followed: Sequence[Results]) -> Table:
    """Return the errors of tracked points on each wall."""
    forms = {
        "true_error_px_p95": ("hole: error, 95th percentile, px of 320", ".2f"),
        "lost_fraction": ("hole: frames lost", ".0%"),
        "texture_error_px_p99": ("plain wall: error, 99th percentile, px of 320", ".2f"),
        "texture_lost_fraction": ("plain wall: frames given up", ".0%"),
    }
    rows = []
    for wall, words in WALLS.items():
        own = tracking_figures([each for each in followed if each.wall == wall])
        cells = (cell(own[key], form) for key, (_, form) in forms.items())
        rows.append((words, *cells, f"{own['texture_drifted']} of {own['texture_points']}"))
    columns = ("wall", *(said for said, _ in forms.values()), "plain wall: points that drifted")
    return Table(columns, rows)


def draw_insertion(insertion: Results) -> Any:
    """Draw Fig 14: the six pictures with squares, in the form of the paper."""
    # Half the side of the square is 15 pixels of 640, about that of a hole of 1 mm.
    x, y = 15.0 * np.array([[-1, 1, 1, -1, -1], [-1, -1, 1, 1, -1]])
    panels = [
        photo(image, f"({name})", (marked[0] + x, marked[1] + y, "C3 - 1.2"))
        for (image, marked), name in zip(insertion.shots, "abcdef", strict=False)
    ]
    return draw(*panels, columns=3, height=5.4)


def draw_followed(followed: Sequence[Results]) -> Any:
    """Draw the errors of points while they counted as tracked."""
    colours = {wall: f"C{number}" for number, wall in enumerate(WALLS)}
    words: list[Any] = [([], [], colours[wall], words) for wall, words in WALLS.items()]
    panels = []
    for hole, title in ((True, "holes"), (False, "plain wall")):
        errors: list[Any] = words if hole else []
        for each in (one for one in followed if one.hole == hole):
            error = np.where(each.tracked, np.maximum(each.error, 1e-2), np.nan)
            errors = [*errors, (np.arange(error.size), error, f"{colours[each.wall]} - 0.8")]
        y = "off the true point [px of 320]" if hole else ""
        frame = {"title": title, "yscale": "log"}
        panels.append(panel("frame", y, *errors, legend={"ncols": 2}, **frame))
    return draw(*panels, columns=2, height=3.4, sharey=True)
