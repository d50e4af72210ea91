"""Take the frames under switched lights in which defects are looked for, and outline one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy.typing as npt

from minorloop.geometry import wall_distance
from minorloop.procedures.meter import LIMITS, LightLimits
from minorloop.procedures.values import NOTHING, Reading, Request
from minorloop.vision.defects import ALONE, SEQUENCE, Hole
from minorloop.vision.wallmap import Look

SAME = 1.5e-3
"""Farthest from where it was picked that a defect is the same one when it is seen again, in metres:
what the looks from two places may differ by, and less than the distance of two defects."""


@dataclass(frozen=True, eq=False, kw_only=True)
class AcquisitionState:
    """Frames so far.

    Parameters
    ----------
    gain : float
        Of the camera under all lights.
    looks : tuple of Look
    asked : bool
        Whether the next frame has been asked for.
    done : bool
    """

    gain: float
    looks: tuple[Look, ...] = ()
    asked: bool = False
    done: bool = False

    @property
    def all_lit(self) -> bool:
        """Whether the next frame is under all lights."""
        return not self.asked or all(SEQUENCE[len(self.looks)])


@dataclass(frozen=True, kw_only=True)
class Acquisition:
    """A frame under each light alone, one under none, and one under all.

    Parameters
    ----------
    limits : LightLimits
    """

    limits: LightLimits = LIMITS

    def begin(self, gain: float) -> AcquisitionState:
        """State of a camera whose gain under all lights is known."""
        return AcquisitionState(gain=gain)

    def step(self, state: AcquisitionState, reading: Reading) -> tuple[AcquisitionState, Request]:
        """The next state, and the lights, exposure and frame that are asked for."""
        if state.done:
            return state, NOTHING
        if state.asked and reading.image is not None:
            pan, tilt = reading.angles.tolist()
            look = Look(reading.image, pan, tilt, SEQUENCE[len(state.looks)])
            state = replace(state, looks=(*state.looks, look))
        if len(state.looks) == len(SEQUENCE):
            return replace(state, done=True), Request(exposure=self._exposure(True, state.gain))
        lights = SEQUENCE[len(state.looks)]
        exposure = self._exposure(all(lights), state.gain)
        return replace(state, asked=True), Request(lights=lights, exposure=exposure, frame=True)

    def _exposure(self, all_lit: bool, gain: float) -> tuple[float, float]:
        return self.limits.exposure * (1.0 if all_lit else ALONE), gain


def nearest(
    holes: Sequence[Hole], place: npt.ArrayLike, radius: float, reach: float = SAME
) -> Hole | None:
    """The hole nearest to phi and z (2,) in a pipe of a radius, if it is within some metres."""
    off = [float(wall_distance(hole.place, place, radius)) for hole in holes]
    best = min(range(len(holes)), key=off.__getitem__, default=None)
    return None if best is None or off[best] > reach else holes[best]
