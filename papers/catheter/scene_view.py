"""Random views of a place with or without a hole, for scoring the detector.

A view is a camera that looks at a place of the wall. Around the place are dents, beads, scratches
and dirt, and at least one LED is mirrored to saturation within 3 mm of the place but not within
0.2 mm of the rim, with and without a hole. A plain view has none of these: a dark hole with a sharp
edge in a brushed wall. Views of all sizes have a hole or a pit of 0.4 to 3 mm, or none, beside
slots and corrosion.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TypeAlias

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError
from minorloop_head.geometry import Mount, Pinhole, Pose, meet_wall, wall_point, wrapped
from minorloop_head.twins import pipe as drawing
from minorloop_head.twins.camera import LENS, Camera, led_positions
from minorloop_head.twins.pipe import Bore, Crack, Dent, Dirt, Pipe
from minorloop_head.twins.turbid_water import TurbidWater

LEAST_AXIS = 9.0
"""Least minor axis of a hole in the image, in pixels of a 320 by 240 image."""
DIAMETERS = (0.4e-3, 3e-3)
"""Diameters of the mouths of all sizes, in metres, equally likely on a logarithmic scale; required.
"""
LEAST_OF_SIZES = 7.0
"""Their least minor axis, in the same pixels: that of a hole of 0.6 mm at the resolution that the
search requires for this size, with a sixth to spare."""
_CLEAR, _REACH = 0.2e-3, 3e-3
"""Least distance of a glint from the rim, and largest from the place, in metres."""
_DARK = 0.4
"""Albedo of corrosion relative to the metal, at most; other dirt is brighter."""
_TRIES = 400
"""Most views drawn for a scene: each of 250 seeds needed fewer."""
Drawn: TypeAlias = tuple[Mount, float, float, tuple[float, float]]
"""Mount, pan and tilt in radians, and phi and z of a place in view."""


@dataclass(frozen=True, eq=False)
class SceneView:
    """A camera in place, and the truth of its view."""

    camera: Camera
    """Camera exposed for all LEDs on, at the pose of the head."""
    mount: Mount
    """True place of the head."""
    pan: float
    tilt: float
    """Angles of the head, in radians."""
    gain: float
    """Gain of the exposure with all LEDs on."""
    flooded: bool = False
    """Whether the pipe is full of water."""
    place: tuple[float, float] = (np.nan, np.nan)
    """Phi and z of the place in question. For scoring only, as the rest."""
    hole: Bore | None = None
    """The hole at that place, or None."""
    marks: tuple[tuple[float, float], ...] = ()
    """Phi and z of slots and of corrosion."""
    pipe: Pipe = field(default_factory=Pipe)
    """The wall with a crack."""
    width: float = 0.0
    """Width of the crack away from tips and branches, in metres; 0 without a crack."""


def draw_view(
    seed: int,
    *,
    hole: bool,
    inside: str | None = None,
    plain: bool = False,
    flooded: bool = False,
) -> SceneView:
    """Draw a view by seed, with a hole or without.

    The gain varies by 4 to 1 about the metered one. The diameter of the hole is 0.85 to 1.15 mm,
    its minor axis at least 9 pixels of a 320 by 240 image.

    ``inside`` of the hole is "dark", "backlit" or "white", and drawn if not given. A ``plain`` view
    has no dents, beads, scratches, dirt, chamfer of the hole, and no saturated pixel within 3 mm of
    the place; the hole is dark. A ``flooded`` pipe is full of water, clear or turbid.

    Raises a `ParameterError` if no view could be drawn, as of `first_view`.
    """
    rng, lens = np.random.default_rng([seed, int(hole)]), LENS.in_water() if flooded else LENS

    def view_of(head: Drawn) -> SceneView | None:
        mount, pan, tilt, place = head
        bore, pose = drawing.draw_hole(rng, *place), mount.pose(pan, tilt)
        shown = "dark" if plain else inside
        if shown is not None:
            bright = {"dark": 0.0, "white": 2.0}.get(shown, 1.0)
            bore = replace(bore, inside=shown, brightness=bright)
        if plain:
            bore = replace(bore, chamfer=0.0)
        if minor_axis(pose, bore, lens) < LEAST_AXIS:
            return None
        wall = _wall(rng, bore, pose, hole)
        if plain:
            wall = replace(wall, dents=(), scratches=(), dirt=())
        water = TurbidWater.draw(rng) if flooded else None
        camera, gain = aimed(rng, wall, mount, pan, tilt, water)
        if not 0.1 <= gain <= 20:
            return None
        camera.expose(0.01, gain)
        view = SceneView(camera, mount, pan, tilt, gain, flooded, place, bore if hole else None)
        bright_spots, rim = _saturated(view, bore), bore.diameter / 2 + bore.chamfer
        near = bright_spots < _REACH
        glint = (bright_spots > rim + _CLEAR).all() and near.sum() >= 4
        return view if (not near.any() if plain else glint) else None

    return first_view(seed, rng, view_of, lens)


def draw_sized_view(seed: int, *, hole: bool) -> SceneView:
    """Draw a view with a hole or, as often, a pit of any size, or the same kind of wall without.

    Raises a `ParameterError` if no view could be drawn, as of `first_view`.
    """
    rng = np.random.default_rng([seed, int(hole), 17])
    wide = math.exp(rng.uniform(*np.log(DIAMETERS)))
    drawn = (drawing.draw_pit if rng.random() < 0.5 else drawing.draw_hole)(rng, 0.0, 0.0)
    # An edge is broken by up to a tenth of a small mouth.
    drawn = replace(drawn, diameter=wide, chamfer=min(drawn.chamfer, 0.1 * wide))

    def view_of(head: Drawn) -> SceneView | None:
        mount, pan, tilt, place = head
        bore = replace(drawn, phi=place[0], z=place[1])
        if minor_axis(mount.pose(pan, tilt), bore) < LEAST_OF_SIZES:
            return None
        wall = _marked_wall(rng, bore, hole)
        camera, gain = aimed(rng, wall, mount, pan, tilt)
        camera.expose(0.01, float(np.clip(gain, 0.1, 20.0)))
        slots = [tuple(np.mean(slot.points, axis=0).tolist()) for slot in wall.cracks]
        marks = [(mark.phi, mark.z) for mark in wall.dirt if mark.albedo < _DARK]
        about = (camera, mount, pan, tilt, gain, False, place, bore if hole else None)
        return SceneView(*about, marks=(*slots, *marks))

    return first_view(seed, rng, view_of)


def first_view(
    seed: int,
    rng: np.random.Generator,
    view_of: Callable[[Drawn], SceneView | None],
    lens: Pinhole = LENS,
) -> SceneView:
    """Return the first possible view of drawn heads and places.

    The head turns 18 to 30 degrees from the axis of the pipe, its pivot is up to 1 mm off it, and
    the place is away from the edges of the picture. Raises a `ParameterError` if no view is
    possible in 400 tries, which is so for fewer than one seed in 100,000.
    """
    for _ in range(_TRIES):
        away, way = np.deg2rad(rng.uniform(18, 30)), rng.uniform(0, 2 * np.pi)
        off, side = rng.uniform(0, 1e-3), rng.uniform(0, 2 * np.pi)
        offset = (off * np.cos(side), off * np.sin(side))
        roll, advance = rng.uniform(-np.pi, np.pi), rng.uniform(0, 4e-3)
        mount = Mount(offset=offset, roll=roll, advance=advance)
        pan, tilt = float(away * np.cos(way)), float(away * np.sin(way))
        pose = mount.pose(pan, tilt)
        pixel = rng.uniform([70, 70], [lens.width - 70, lens.height - 70])
        phi, z, _ = meet_wall(pose.position, pose.rotation @ lens.rays(pixel), 10e-3)
        view = view_of((mount, pan, tilt, (float(phi), float(np.clip(z, 0.0, 50e-3)))))
        if view is not None:
            return view
    raise ParameterError(f"no view found for seed {seed} in {_TRIES} tries; give another seed")


def minor_axis(pose: Pose, bore: Bore, lens: Pinhole = LENS) -> float:
    """Return the minor axis of the image of the mouth, in pixels of a 320 by 240 image.

    It is 0 if the mouth is not wholly in view.
    """
    angles = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    edge = bore.diameter / 2 / 10e-3
    rim = wall_point(
        bore.phi + edge * np.cos(angles), bore.z + bore.diameter / 2 * np.sin(angles), 10e-3
    )
    pixels = lens.project(pose.to_camera(rim))
    inside = (pixels > 20) & (pixels < [lens.width - 20, lens.height - 20])
    if not inside.all():
        return 0.0
    spread = np.linalg.svd(pixels - pixels.mean(axis=0), compute_uv=False)
    return float(2 * spread[1] / np.sqrt(8) / 2)


def _wall(rng: np.random.Generator, bore: Bore, pose: Pose, hole: bool) -> Pipe:
    """Return a wall with clutter, and a bead that mirrors an LED beside the place."""
    low, high = bore.z - 10e-3, bore.z + 10e-3

    def somewhere() -> tuple[float, float]:
        return bore.phi + rng.uniform(-1.0, 1.0), float(np.clip(rng.uniform(low, high), 0, 51e-3))

    return Pipe(
        finish=drawing.draw_finish(rng),
        bores=(bore,) if hole else (),
        dents=(
            *(drawing.draw_dent(rng, *somewhere()) for _ in range(rng.integers(3, 10))),
            *(_mirror(rng, bore, pose) for _ in range(rng.integers(1, 3))),
        ),
        scratches=tuple(
            drawing.draw_scratch(rng, *somewhere()) for _ in range(rng.integers(2, 10))
        ),
        dirt=tuple(drawing.draw_dirt(rng, *somewhere()) for _ in range(rng.integers(2, 10))),
    )


def _mirror(rng: np.random.Generator, bore: Bore, pose: Pose) -> Dent:
    """Return a bead or dent beside the rim whose flank mirrors one LED into the lens."""
    way, far = rng.uniform(0, 2 * np.pi), rng.uniform(bore.diameter / 2 + _CLEAR + 1e-4, 2.5e-3)
    phi, z = bore.phi + far * np.cos(way) / 10e-3, bore.z + far * np.sin(way)
    point = wall_point(phi, z, 10e-3)
    led = pose.to_pipe(led_positions()[rng.integers(3)])
    slopes = -_half_slopes(point, led, pose.position)
    steep = float(np.hypot(*slopes))
    raised = bool(rng.random() < 0.6)
    size = rng.uniform(0.12e-3, 0.35e-3) if raised else rng.uniform(0.3e-3, 0.9e-3)
    # A Gaussian of this height is steepest, 0.607 height / size, at one size from its middle.
    height = size * steep / 0.607 * rng.uniform(1.05, 2.0)
    ratio = steep * size / height
    offsets = np.linspace(0, 1, 200)
    offset = size * float(offsets[np.argmin(np.abs(offsets * np.exp(-(offsets**2) / 2) - ratio))])
    uphill = slopes / max(steep, 1e-9)
    middle = offset * uphill if raised else -offset * uphill
    return Dent(
        float(phi + middle[0] / 10e-3), float(z + middle[1]), size, height if raised else -height
    )


def _half_slopes(point: FloatArray, led: FloatArray, lens: FloatArray) -> FloatArray:
    """Return the slopes (2,) of the wall, around and along, that mirror an LED into the lens."""
    to_led, to_lens = led - point, lens - point
    half = to_led / np.linalg.norm(to_led) + to_lens / np.linalg.norm(to_lens)
    normal = -np.array([point[0], point[1], 0.0]) / np.hypot(point[0], point[1])
    around = np.array([normal[1], -normal[0], 0.0])
    up = max(float(half @ normal), 0.05)
    return np.array([float(half @ around), float(half[2])]) / up


def aimed(
    rng: np.random.Generator,
    wall: Pipe,
    mount: Mount,
    pan: float,
    tilt: float,
    water: TurbidWater | None = None,
) -> tuple[Camera, float]:
    """Return a camera before a wall, in focus within 15 %, and a gain about the metered one."""
    seed, specimen = (int(rng.integers(2**31)) for _ in range(2))
    camera = Camera(wall, mount, seed=seed, specimen=specimen, flooded=water)
    camera.look(pan, tilt)
    pose = mount.pose(pan, tilt)
    _, _, length = meet_wall(pose.position, pose.rotation[:, 2], 10e-3)
    camera.focus_at(float(np.clip(length * rng.uniform(0.85, 1.15), 4e-3, 60e-3)))
    while abs(camera.focus * camera._focus_wanted - 1) > 1e-9:
        camera._advance(camera.sensor.interval)
    camera.expose(0.01, 1.0)
    # Metered for a middle grey of the brighter parts of the image.
    metered = 70.0 / max(float(np.percentile(camera.frame().image, 60)), 2.0)
    return camera, metered * float(np.exp(rng.uniform(np.log(0.5), np.log(2.0))))


def _saturated(view: SceneView, bore: Bore) -> FloatArray:
    """Return the distances of saturated pixels outside the rim from the place."""
    v, u = np.nonzero(view.camera.frame().image == 255)
    pose = view.mount.pose(view.pan, view.tilt)
    rays = view.camera._optics.rays(np.stack([u, v], axis=1)) @ pose.rotation.T
    phi, z, _ = np.moveaxis(meet_wall(pose.position, rays, 10e-3), -1, 0)
    off = np.hypot(10e-3 * wrapped(phi - bore.phi), z - bore.z)
    rim = bore.diameter / 2 + bore.chamfer
    return np.asarray(off[off > rim])


def _marked_wall(rng: np.random.Generator, bore: Bore, hole: bool) -> Pipe:
    """Return a wall with clutter, slots and corrosion."""
    somewhere = partial(_beside, rng, bore, 0.0)
    return Pipe(
        finish=drawing.draw_finish(rng),
        bores=(bore,) if hole else (),
        cracks=tuple(_slot(rng, bore) for _ in range(rng.integers(1, 4))),
        dents=tuple(drawing.draw_dent(rng, *somewhere()) for _ in range(rng.integers(2, 8))),
        scratches=tuple(
            drawing.draw_scratch(rng, *somewhere()) for _ in range(rng.integers(2, 10))
        ),
        dirt=(
            *(drawing.draw_dirt(rng, *somewhere()) for _ in range(rng.integers(2, 8))),
            *(_corrosion(rng, bore) for _ in range(rng.integers(1, 4))),
        ),
    )


def _beside(rng: np.random.Generator, bore: Bore, reach: float) -> tuple[float, float]:
    """Return phi and z within 10 mm of a bore, so that a mark of a reach is clear of its rim."""
    while True:  # what touches a rim hides it
        x, y = rng.uniform(-10e-3, 10e-3, 2)
        if not reach or math.hypot(x, y) > bore.diameter / 2 + reach + 0.4e-3:
            return bore.phi + float(x) / Pipe.radius, float(np.clip(bore.z + y, 0, 51e-3))


def _slot(rng: np.random.Generator, bore: Bore) -> Crack:
    """Draw a milled slot: 0.3 to 0.8 mm wide and 2.5 to 6 times as long, with round ends."""
    width = rng.uniform(0.3e-3, 0.8e-3)
    length, angle = width * rng.uniform(1.5, 5.0), rng.uniform(0, np.pi)
    phi, z = _beside(rng, bore, 0.5 * (length + width))
    x, y = 0.5 * length * math.cos(angle) / Pipe.radius, 0.5 * length * math.sin(angle)
    ends = ((phi - x, z - y), (phi + x, z + y))
    return Crack(ends, (width, width), albedo=rng.uniform(0.02, 0.12))


def _corrosion(rng: np.random.Generator, bore: Bore) -> Dirt:
    """Draw a dark patch with lobes, as pitting leaves it."""
    size = math.exp(rng.uniform(math.log(0.2e-3), math.log(1.5e-3)))
    return Dirt(
        *_beside(rng, bore, 2.0 * size),
        size,
        rng.uniform(0.1, _DARK),
        softness=rng.uniform(0.05e-3, 0.15e-3),
        raggedness=rng.uniform(0.8, 1.3),
        seed=int(rng.integers(2**31)),
    )
