"""The tracker compared with the truth: a hole and plain wall, on walls that are hard to track.

A head on a swaying base turns before a wall. The tracker uses the pictures and the readings of the
joints; the distance of the tracked point from the true one is computed afterwards. All pixel
figures are at the scale of a 320 by 240 image.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import SignalError
from minorloop_head.geometry import Mount, meet_wall
from minorloop_head.procedures.meter import LIMITS
from minorloop_head.twins.camera import LENS, Camera
from minorloop_head.twins.pipe import Bore, Dirt, Pipe
from minorloop_head.vision.calibrated_camera import CalibratedCamera
from minorloop_head.vision.tracking import TRACKED, PatchTracker
from papers.catheter import scoring
from papers.catheter.inspection_servo import CLICK
from papers.catheter.scan_trials import PHASES, SWAY
from papers.harness import Results, mean, quantile

WALLS: Mapping[str, str] = {
    "drawn": "usual texture",
    "poor": "hardly any texture",
    "repeated": "equal spots at equal distances",
    "polished": "reflections that move with the lights",
    "blurred": "out of focus",
    "lights": "lights switched and dimmed on the way",
}
"""Kinds of walls, and words for them."""
FRAMES, INTERVAL = 60, 0.04
"""Number of frames of a sequence, and the time between them in seconds."""
POINTS = 5
"""Number of tracked points of plain wall beside the hole."""
PITCH = 2.0e-3
"""Distance of equal spots in metres: less than a patch, so that it always shows some."""
GRADED = 2.0
"""Error in pixels of 320 beyond which a point that counts as tracked has drifted."""


def wall_of(kind: str, seed: int, hole: Bore) -> Pipe:
    """Return a pipe whose wall is of one of the ``WALLS``."""
    pipe = replace(Pipe.draw(seed), bores=(hole,))
    if kind in ("poor", "repeated"):
        dull = replace(pipe.finish, stain=0.02, streak=0.01, brush=0.01)
        pipe = replace(pipe, finish=dull, dents=(), scratches=(), dirt=())
    if kind == "repeated":
        places = [
            (hole.phi + PITCH * i / pipe.radius, hole.z + PITCH * j)
            for i, j in product(range(-8, 9), repeat=2)
            if (i, j) != (0, 0) and 0 < hole.z + PITCH * j < pipe.length
        ]
        spots = tuple(Dirt(*place, 0.35e-3, 0.5, 0.1e-3, 0.0) for place in places)
        pipe = replace(pipe, dirt=spots)
    if kind == "polished":
        smooth = replace(pipe.finish, roughness_around=0.08, roughness_along=0.05)
        pipe = replace(pipe, finish=replace(smooth, diffuse=0.3, specular=0.6))
    return pipe


def draw_sequence(kind: str, seed: int) -> Results:
    """Draw one of the ``WALLS``, a motion of the head and the pictures by seed.

    ``images`` (T, height, width) are the pictures and ``angles`` (T, 2) pan and tilt measured by
    the joints with these; ``camera`` is the known one; ``picked`` (P, 2) are pixels of the first
    frame, a click on the hole first, and ``true`` (T, P, 2) the true pixels of these points, for
    scoring only.
    """
    rng = np.random.default_rng([seed, 52, list(WALLS).index(kind)])
    away, way = math.radians(rng.uniform(20.0, 27.0)), float(rng.uniform(0, 2 * np.pi))
    aim = away * np.array([math.cos(way), math.sin(way)])
    x, y = rng.uniform(-0.2e-3, 0.2e-3, 2).tolist()
    mount = Mount(offset=(x, y), roll=float(rng.uniform(-np.pi, np.pi)))
    known = replace(mount, offset=(x + rng.normal(0, 0.05e-3), y + rng.normal(0, 0.05e-3)))
    pose = mount.pose(*aim.tolist())
    phi, z, length = meet_wall(pose.position, pose.rotation[:, 2], Pipe.radius).tolist()
    pipe = wall_of(kind, seed, Bore(phi, z, 1e-3))
    camera = Camera(pipe, mount, specimen=seed, seed=seed)
    _expose(camera, aim, 8e-3 if kind == "blurred" else length)
    joints, base = _motion(rng, aim)
    images = []
    true = np.empty((FRAMES, POINTS + 1, 2))
    picked = np.array(LENS.centre) + 120.0 * rng.standard_normal((POINTS + 1, 2))
    picked = np.clip(picked, 110, (530, 370))
    places = np.empty((POINTS + 1, 2))
    for n in range(FRAMES):
        now = joints[n] + base[n]
        ahead = joints[n + 1] + base[n + 1]
        rates = (ahead - now) / INTERVAL if n else np.zeros(2)
        camera.look(*now.tolist(), rates=(float(rates[0]), float(rates[1])))
        if kind == "lights":  # four times a second
            lights = [(True, True, True), (True, False, True), (False, True, True)]
            camera.switch([*lights, (True, True, False)][n // 6 % 4])
        if n == 0:
            click = CLICK / math.sqrt(2) * rng.standard_normal(2)
            picked[0] = scoring.true_pixel(camera, phi, z) + click
            view = CalibratedCamera(scoring.true_lens(camera), mount, camera.leds)
            places = view.place(picked, *now.tolist())
        true[n] = scoring.true_pixel(camera, *places.T)
        images.append(camera.frame().image)
    read = joints[:FRAMES] + math.radians(0.05) * rng.standard_normal((FRAMES, 2))
    seen = CalibratedCamera(camera.calibration, known, camera.leds)
    return Results(
        wall=kind, images=np.array(images), angles=read, camera=seen, picked=picked, true=true
    )


def follow(sequence: Results) -> list[Results]:
    """Track the points of a sequence, except those that the tracker refuses to pick.

    Of each, ``error`` (T,) is in pixels of 320, ``tracked`` (T,) whether it counted as tracked, and
    ``shown`` (T,) whether the frame showed its patch: a point nearer to the edge than 60 pixels of
    640, about half a patch, cannot be tracked.
    """
    tracker, border = PatchTracker(sequence.camera), 60.0
    edge = np.array(sequence.images.shape[:0:-1]) - border
    found = []
    for k, pixel in enumerate(sequence.picked):
        error, tracked = np.zeros(len(sequence.images)), np.ones(len(sequence.images), bool)
        try:
            _, state = tracker.begin(sequence.images[0], pixel, *sequence.angles[0].tolist())
        except SignalError:
            continue
        for n in range(1, len(sequence.images)):
            track, state = tracker.step(state, sequence.images[n], *sequence.angles[n].tolist())
            error[n] = 0.5 * math.dist(track.pixel, sequence.true[n, k])
            tracked[n] = track.verdict == TRACKED
        true = sequence.true[1:, k]
        shown = np.asarray(((true > border) & (true < edge)).all(axis=-1))
        about = {"wall": sequence.wall, "hole": k == 0, "shown": shown}
        found.append(Results(error=error[1:], tracked=tracked[1:], **about))
    return found


def run_tracking(seed: int) -> list[Results]:
    """Follow the points of one sequence of each wall."""
    return [each for kind in WALLS for each in follow(draw_sequence(kind, seed))]


def tracking_figures(followed: Sequence[Results]) -> dict[str, Any]:
    """Return the errors of holes, and those of plain wall while it counted as tracked."""
    holes = [each for each in followed if each.hole]
    walls = [each for each in followed if not each.hole]

    def joined(points: Sequence[Results], name: str, where: str) -> FloatArray:
        parts = (getattr(each, name)[getattr(each, where)] for each in points)
        return np.concatenate([np.empty(0), *parts])

    return {
        "true_error_px_p95": quantile(joined(holes, "error", "tracked"), 0.95),
        "lost_fraction": 1.0 - mean(joined(holes, "tracked", "shown")),
        "texture_error_px_p99": quantile(joined(walls, "error", "tracked"), 0.99),
        "texture_lost_fraction": 1.0 - mean(joined(walls, "tracked", "shown")),
        "texture_drifted": sum(bool((each.error[each.tracked] > GRADED).any()) for each in walls),
        "texture_points": len(walls),
    }


def _expose(camera: Camera, aim: FloatArray, focus: float) -> None:
    """Set focus and gain as metering does; the focus arrives meanwhile."""
    camera.look(*aim.tolist())
    camera.focus_at(LIMITS.focus(focus))
    gain = 1.0
    for _ in range(8):
        camera.expose(LIMITS.exposure, gain)
        mean = max(float(camera.frame().image.mean()), 1.0)
        gain = float(np.clip(gain * (LIMITS.grey / mean) ** 0.7, 0.1, LIMITS.most_gain))


def _motion(rng: np.random.Generator, aim: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return angles (T + 1, 2) of the joints about an aim, and the turns (T + 1, 2) of the base.

    The joints swing by up to 10 degrees, at up to 20 degrees a second, the limit of the servo.
    """
    t = INTERVAL * np.arange(FRAMES + 1)
    begin = float(rng.uniform(0, PHASES))
    shares, signs = rng.uniform(0.5, 1.0, 2), rng.choice([-1, 1], 2)
    swing = math.radians(10.0)
    phases = math.radians(20.0) / swing * t[:, None] * np.array([1.0, 0.7])
    joints = aim + swing * shares * signs * np.sin(phases)
    base = np.array([SWAY.at(begin + now) for now in t])
    return joints, base
