"""Take the frames under switched lights in which defects are searched, and outline a defect."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from minorloop_head.geometry import wall_distance
from minorloop_head.procedures.meter import LIMITS, LightLimits
from minorloop_head.procedures.values import NOTHING, LitCamera, Procedure, Reading, Request
from minorloop_head.vision.defects import SEQUENCE, Hole
from minorloop_head.vision.reflectance_map import ALONE, LitFrame

SAME = 1.5e-3
"""Farthest distance in metres between two views of one defect: more than views from two places
differ by, and less than the distance between two defects."""


@dataclass(frozen=True, eq=False, kw_only=True)
class AcquisitionState:
    """Gain under all lights, the frames so far, and whether the next one was requested."""

    gain: float
    frames: tuple[LitFrame, ...] = ()
    requested: bool = False
    done: bool = False


@dataclass(frozen=True, kw_only=True)
class Acquisition(Procedure[AcquisitionState]):
    """A frame under each light alone, one under none, and one under all.

    Parameters
    ----------
    limits : LightLimits
    """

    limits: LightLimits = LIMITS

    def begin(self, gain: float) -> AcquisitionState:
        """Return the state of a camera whose gain under all lights is known."""
        return AcquisitionState(gain=gain)

    def _next(self, state: AcquisitionState, reading: Reading) -> tuple[AcquisitionState, Request]:
        if state.requested and reading.image is None:
            return state, Request(frame=True)  # lights that are set again have to settle again
        if reading.image is not None and state.requested:
            pan, tilt = reading.angles.tolist()
            frame = LitFrame(reading.image, pan, tilt, SEQUENCE[len(state.frames)])
            state = replace(state, frames=(*state.frames, frame))
        if len(state.frames) == len(SEQUENCE):
            return replace(state, done=True), Request(exposure=self._exposure(True, state.gain))
        lights = SEQUENCE[len(state.frames)]
        exposure = self._exposure(all(lights), state.gain)
        return replace(state, requested=True), Request(lights=lights, exposure=exposure, frame=True)

    def _exposure(self, all_lit: bool, gain: float) -> tuple[float, float]:
        return self.limits.exposure * (1.0 if all_lit else ALONE), gain


def acquire(camera: LitCamera, angles: npt.ArrayLike, *, gain: float = 1.0) -> tuple[LitFrame, ...]:
    """Return the frames of an acquisition by a camera that does not move.

    Parameters
    ----------
    camera : LitCamera
        Its lights are all on afterwards.
    angles : (2,) array_like
        Pan and tilt as measured, in radians.
    gain : float
        Under all lights.
    """
    acquisition, request = Acquisition(), NOTHING
    state, still = acquisition.begin(gain), np.asarray(angles, dtype=np.float64)
    while not state.done:
        image = camera.frame().image if request.frame else None
        state, request = acquisition.step(state, Reading(t=0.0, angles=still, image=image))
        if request.lights is not None:
            camera.switch(request.lights)
        if request.exposure is not None:
            camera.expose(*request.exposure)
    return state.frames


def nearest(
    holes: Sequence[Hole], place: npt.ArrayLike, radius: float, reach: float = SAME
) -> Hole | None:
    """Return the hole nearest to phi and z (2,) in a pipe of a radius; None beyond the reach."""
    off = [float(wall_distance(hole.place, place, radius)) for hole in holes]
    best = min(range(len(holes)), key=off.__getitem__, default=None)
    return None if best is None or off[best] > reach else holes[best]
