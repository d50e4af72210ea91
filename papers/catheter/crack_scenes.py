"""Walls with and without a crack, beside marks that are no cracks, by seed.

Every wall has scratches, drawing marks, stains and dents, and two in five a weld. Some of them are
beside the crack. The form of a mark determines its look: grooves and beads deflect the light,
stains only dim it, and a crack reflects hardly any light of any lamp.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from minorloop.arrays import FloatArray
from minorloop_head.geometry import Pose, wall_lengths, wall_point
from minorloop_head.twins.camera import LENS
from minorloop_head.twins.pipe import Crack, Pipe, Scratch, Weld, draw_dent, draw_dirt, draw_finish
from minorloop_head.vision.reflectance_map import LEAST_SEEN
from papers.catheter.scene_view import Drawn, SceneView, aimed, first_view

WIDTHS, LENGTHS = (30e-6, 200e-6), (2e-3, 15e-3)
"""Range of the cracks in metres: that of the claim."""
FINE = 0.05e-3
"""Step of a true course in metres, in which its length is counted."""
_EDGE = 12.0
"""Pixels at the edge of the image that a map leaves out because of the errors of the pose."""


def draw_crack_view(seed: int, *, crack: bool, lit: bool = False) -> SceneView:
    """Draw a view of a wall with a crack, 30 to 200 um wide and 2 to 15 mm long, or without.

    A ``lit`` crack is a groove whose flanks return light. Raises a `ParameterError` if no view
    could be drawn, as of `first_view`.
    """
    rng = np.random.default_rng([seed, int(crack), 21])

    def view_of(head: Drawn) -> SceneView | None:
        mount, pan, tilt, place = head
        cracks, width = _cracks(rng, *place)
        if not _in_view(mount.pose(pan, tilt), cracks[0]):
            return None
        if lit:
            slope, albedo = math.exp(rng.uniform(*np.log((0.8, 6.0)))), rng.uniform(0.3, 1.0)
            cracks = tuple(replace(one, flanks=slope, albedo=albedo) for one in cracks)
        wall = _wall(rng, place, cracks, crack)
        camera, gain = aimed(rng, wall, mount, pan, tilt)
        if not 0.1 <= gain <= 20:
            return None
        camera.expose(0.01, gain)
        seen = width if crack else 0.0
        return SceneView(camera, mount, pan, tilt, gain, pipe=wall, width=seen)

    return first_view(seed, rng, view_of)


def fine_course(crack: Crack, radius: float) -> tuple[FloatArray, FloatArray]:
    """Return course (N, 2) and widths (N,) of a true crack, in steps of 50 um."""
    corners = np.array(crack.points)
    along = wall_lengths(corners, radius)
    fine = np.arange(0.0, along[-1], FINE)
    phi, z, widths = np.unwrap(corners[:, 0]), corners[:, 1], np.array(crack.widths)
    course = np.stack([np.interp(fine, along, phi), np.interp(fine, along, z)], axis=1)
    return course, np.interp(fine, along, widths)


def _in_view(pose: Pose, crack: Crack) -> bool:
    """Return whether at least 2 mm and half of a crack are in view with the resolution of a map."""
    course, _ = fine_course(crack, Pipe.radius)
    points = wall_point(course[:, 0], course[:, 1], Pipe.radius)
    local = pose.to_camera(points)
    pixels = LENS.project(local)
    way = points - pose.position
    out = way[:, 0] * np.cos(course[:, 0]) + way[:, 1] * np.sin(course[:, 0])
    fine = LENS.focal * out >= LEAST_SEEN * (way**2).sum(axis=1)
    inside = (pixels > _EDGE) & (pixels < np.array([LENS.width, LENS.height]) - _EDGE)
    seen = fine & inside.all(axis=1) & (local[:, 2] > 0)
    return bool(seen.mean() >= 0.5 and seen.sum() * FINE >= LENGTHS[0])


def _cracks(rng: np.random.Generator, phi: float, z: float) -> tuple[tuple[Crack, ...], float]:
    """Return a crack about a place, perhaps with a branch, and its width."""
    width = math.exp(rng.uniform(*np.log(WIDTHS)))
    length, heading = rng.uniform(*LENGTHS), rng.uniform(0, 2 * np.pi)
    look = {"depth": rng.uniform(0.2e-3, 1.5e-3), "albedo": rng.uniform(0.02, 0.12)}
    way, ways = _way(rng, length, heading)
    way = way - way[len(way) // 2] + rng.normal(0, 0.3e-3, 2)
    found = [_crack(rng, way, width, (phi, z), look)]
    if rng.random() < 0.3:
        at = int(rng.integers(len(way) // 4, 3 * len(way) // 4 + 1))
        turn = float(rng.choice([-1, 1]) * rng.uniform(0.5, 1.0))
        start = ways[min(at, len(ways) - 1)] + turn
        side, _ = _way(rng, max(length * rng.uniform(0.2, 0.5), 1e-3), start)
        thin = width * rng.uniform(0.6, 0.9)
        found.append(_crack(rng, side + way[at], thin, (phi, z), look))
    return tuple(found), width


def _way(rng: np.random.Generator, length: float, heading: float) -> tuple[FloatArray, FloatArray]:
    """Return corners (N, 2) in metres from (0, 0), and the N - 1 headings between them."""
    count = max(round(length / 0.4e-3), 2)  # about the size of grains that turn a crack
    ways = heading + np.cumsum(rng.normal(0, 0.12, count)) + rng.normal(0, 0.3, count)
    steps = length / count * np.stack([np.cos(ways), np.sin(ways)], axis=1)
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)]), ways


def _crack(
    rng: np.random.Generator,
    way: FloatArray,
    width: float,
    place: tuple[float, float],
    look: dict[str, float],
) -> Crack:
    """Return a crack on corners (N, 2) about a place, narrower at its tips."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))])
    tip = np.minimum(along, along[-1] - along) / 0.6e-3
    widths = width * np.exp(rng.normal(0, 0.1, len(way))) * np.clip(0.3 + tip, 0.3, 1.0)
    points = np.array(place) + way / [Pipe.radius, 1.0]
    return Crack(tuple((float(phi), float(z)) for phi, z in points), tuple(widths.tolist()), **look)


def _wall(
    rng: np.random.Generator, place: tuple[float, float], cracks: tuple[Crack, ...], crack: bool
) -> Pipe:
    """Return a wall with marks about a place, some of them beside the course of the crack."""
    course = np.array(cracks[0].points)

    def somewhere() -> tuple[float, float]:
        if rng.random() < 0.4:
            corner = course[int(rng.integers(len(course)))]
            phi, z = corner + rng.normal(0, 0.7e-3, 2) / [Pipe.radius, 1.0]
        else:
            phi = place[0] + rng.uniform(-1.0, 1.0)
            z = place[1] + rng.uniform(-9e-3, 9e-3)
        return float(phi), float(z)

    welds = [_weld(rng, *somewhere())] if rng.random() < 0.4 else []
    return Pipe(
        finish=draw_finish(rng),
        cracks=cracks if crack else (),
        dents=tuple(draw_dent(rng, *somewhere()) for _ in range(rng.integers(1, 5))),
        scratches=(
            *(_scratch(rng, *somewhere()) for _ in range(rng.integers(3, 9))),
            *(_drawing_mark(rng, *somewhere()) for _ in range(rng.integers(3, 9))),
        ),
        dirt=tuple(draw_dirt(rng, *somewhere(), (0.3e-3, 3e-3)) for _ in range(rng.integers(2, 7))),
        welds=tuple(welds),
    )


def _scratch(rng: np.random.Generator, phi: float, z: float) -> Scratch:
    """Draw a scratch of 1 to 10 mm, straight or bent, clean or with dirt in it."""
    angle, length, width = (
        rng.uniform(*each) for each in ((0, np.pi), (1e-3, 10e-3), (0.06e-3, 0.2e-3))
    )
    slope, albedo = rng.uniform(0.1, 0.8), rng.uniform(0.5, 1.3)
    return Scratch(phi, z, angle, length, width, slope, albedo, rng.normal(0, 15.0))


def _drawing_mark(rng: np.random.Generator, phi: float, z: float) -> Scratch:
    """Draw a groove of the drawing die: along the pipe, long and shallow."""
    angle, length = np.pi / 2 + rng.normal(0, 0.01), rng.uniform(6e-3, 30e-3)
    width, slope, albedo = (
        rng.uniform(*each) for each in ((0.05e-3, 0.15e-3), (0.1, 0.5), (0.7, 1.1))
    )
    return Scratch(phi, z, angle, length, width, slope, albedo)


def _weld(rng: np.random.Generator, phi: float, z: float) -> Weld:
    """Draw a weld round or along the pipe; its ripples have sharp valleys."""
    angle = float(rng.choice([0.0, np.pi / 2])) + rng.normal(0, 0.02)
    length, width, height, pitch, ripple = (
        rng.uniform(*each)
        for each in (
            (10e-3, 30e-3), (1.5e-3, 4e-3), (0.05e-3, 0.2e-3), (0.3e-3, 1e-3), (0.05, 0.3)
        )
    )  # fmt: skip
    return Weld(phi, z, angle, length, width, height=height, pitch=pitch, ripple=ripple)
