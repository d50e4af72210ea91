"""Take the frames under switched lights in which defects are searched, and outline a defect."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from minorloop_head.geometry import wall_distance
from minorloop_head.procedures.meter import LIMITS
from minorloop_head.procedures.values import LitCamera, Procedure, Reading, Request, Running
from minorloop_head.vision.defects import SEQUENCE, Hole
from minorloop_head.vision.reflectance_map import ALONE, LitFrame

SAME = 1.5e-3
"""Largest distance in metres between two views of one defect: more than the error between views
from two places, and less than the distance between two defects."""


def acquisition(gain: float) -> Procedure[tuple[LitFrame, ...]]:
    """Take a frame under each light alone, one under none, and one under all, at a gain."""
    frames: list[LitFrame] = []
    for lights in SEQUENCE:
        exposure = LIMITS.exposure * (1.0 if all(lights) else ALONE), gain
        now = yield Request(lights=lights, exposure=exposure, frame=True)
        while now.image is None:  # lights that are set again have to settle again
            now = yield Request(frame=True)
        pan, tilt = now.angles.tolist()
        frames.append(LitFrame(now.image, pan, tilt, lights))
    yield Request(exposure=(LIMITS.exposure, gain), now=True)
    return tuple(frames)


def acquire(camera: LitCamera, angles: npt.ArrayLike, *, gain: float = 1.0) -> tuple[LitFrame, ...]:
    """Return the frames of an acquisition by a camera that does not move.

    ``camera``: its lights are all on afterwards; ``angles`` (2,): measured pan and tilt, in
    radians; ``gain``: under all lights.
    """

    def carry_out(request: Request) -> None:
        if request.lights is not None:
            camera.switch(request.lights)
        if request.exposure is not None:
            camera.expose(*request.exposure)

    running, still = Running(acquisition(gain), carry_out), np.asarray(angles, dtype=np.float64)
    running.advance(Reading(t=0.0, angles=still))
    while not running.done:
        running.advance(Reading(t=0.0, angles=still, image=camera.frame().image))
    return running.result


def nearest(holes: Sequence[Hole], place: npt.ArrayLike, radius: float) -> Hole | None:
    """Return the hole nearest to phi and z (2,) in a pipe of a radius; None beyond `SAME`."""
    off = [float(wall_distance(hole.place, place, radius)) for hole in holes]
    best = min(range(len(holes)), key=off.__getitem__, default=None)
    return None if best is None or off[best] > SAME else holes[best]
