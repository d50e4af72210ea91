"""Random views of a wall with a hole or pit of 0.4 to 3 mm, or none, beside slots and corrosion."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np

from minorloop.errors import ParameterError
from minorloop_head.twins import pipe as drawing
from minorloop_head.twins.pipe import Bore, Crack, Dirt, Pipe
from papers.catheter.scene_view import SceneView, aimed, draw_head, draw_place, minor_axis

DIAMETERS = (0.4e-3, 3e-3)
"""Diameters of the mouths, in metres, equally likely on a logarithmic scale; required."""
LEAST_AXIS = 7.0
"""Least minor axis in the image, in pixels of a 320 by 240 image: of a hole of 0.6 mm where the
wall is seen as well as the search asks for one of that size, with a sixth to spare."""
_TRIES = 400
"""Most views drawn for a scene: each of 250 seeds needed fewer."""
_DARK = 0.4
"""Albedo of corrosion relative to the metal, at most; other dirt is brighter."""
_CLEAR = 0.4e-3
"""Least distance from the rim to a slot or corrosion, in metres: what touches a rim hides it."""


def draw_sized_view(seed: int, *, hole: bool) -> SceneView:
    """Draw a view with a hole or a pit, or the same kind of wall without.

    Raises
    ------
    ParameterError
        If no view could be drawn.
    """
    rng = np.random.default_rng([seed, int(hole), 17])
    bore = _bore(rng)
    for _ in range(_TRIES):
        mount, pan, tilt = draw_head(rng)
        phi, z = draw_place(rng, mount.pose(pan, tilt))
        bore = replace(bore, phi=phi, z=z)
        if minor_axis(mount.pose(pan, tilt), bore) < LEAST_AXIS:
            continue
        wall = _wall(rng, bore, hole)
        camera, gain = aimed(rng, wall, mount, pan, tilt)
        camera.expose(0.01, float(np.clip(gain, 0.1, 20.0)))
        slots = [_middle(slot) for slot in wall.cracks]
        marks = [(mark.phi, mark.z) for mark in wall.dirt if mark.albedo < _DARK]
        about = (camera, mount, pan, tilt, gain, False, (phi, z), bore if hole else None)
        return SceneView(*about, marks=(*slots, *marks))
    raise ParameterError(f"no view found for seed {seed} in {_TRIES} tries; give another seed")


def _bore(rng: np.random.Generator) -> Bore:
    """Draw a hole or, as often, a pit, of any size."""
    wide = math.exp(rng.uniform(*np.log(DIAMETERS)))
    draw = drawing.draw_pit if rng.random() < 0.5 else drawing.draw_hole
    bore = draw(rng, 0.0, 0.0)
    # An edge is broken by up to a tenth of a small mouth.
    return replace(bore, diameter=wide, chamfer=min(bore.chamfer, 0.1 * wide))


def _wall(rng: np.random.Generator, bore: Bore, hole: bool) -> Pipe:
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
    """Return phi and z within 10 mm of a bore; what reaches that far stays clear of its rim."""
    while True:
        x, y = rng.uniform(-10e-3, 10e-3, 2)
        if not reach or math.hypot(x, y) > bore.diameter / 2 + reach + _CLEAR:
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


def _middle(slot: Crack) -> tuple[float, float]:
    (a, b), (c, d) = slot.points
    return 0.5 * (a + c), 0.5 * (b + d)
