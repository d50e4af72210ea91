"""Camera and probe as calibrated, and how they sit on the head."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.head.geometry import Mount, Pinhole, Probe
from minorloop.head.ultrasound.field import CalibratedProbe
from minorloop.head.vision.calibrated_camera import CalibratedCamera

ROOM_TEMPERATURE = 20.0
"""Of the water in a flooded pipe, in degrees Celsius, where nothing else is known."""
STRAIGHT = math.radians(30.0)
"""Pan and tilt of the joints at which the camera looks along the pipe; a wire pulls one way."""


@dataclass(frozen=True, kw_only=True, eq=False)
class HeadCalibration:
    """Camera and probe as calibrated, and how they sit on the head.

    Parameters
    ----------
    lens : Pinhole
    leds : (N, 3) array
        Places of the lights in the camera, in metres.
    offset : (float, float)
        Of the pivot off the axis of the pipe, in metres.
    roll : float
        Of the head about the axis of the pipe where the catheter's roll reads 0, in radians.
    lever : float
        From the pivot of the head to the lens, in metres.
    probe : Probe
    radius, thickness : float
        Of the pipe and its wall, in metres.
    temperature : float
        Of the water that it is flooded with, in degrees Celsius.
    """

    lens: Pinhole
    leds: FloatArray
    offset: tuple[float, float] = (0.0, 0.0)
    roll: float = 0.0
    lever: float = 8e-3
    probe: Probe = field(default_factory=Probe)
    radius: float = 10e-3
    thickness: float = 2e-3
    temperature: float = ROOM_TEMPERATURE

    def mount_at(self, place: npt.ArrayLike) -> Mount:
        """How the head sits in the pipe at an advance and a roll of the catheter (2,)."""
        advance, roll = np.asarray(place, dtype=np.float64).tolist()
        return Mount(lever=self.lever, offset=self.offset, roll=self.roll + roll, advance=advance)

    def eye_at(self, place: npt.ArrayLike) -> CalibratedCamera:
        """The camera at an advance and a roll (2,)."""
        return CalibratedCamera(self.lens, self.mount_at(place), self.leds, self.radius)

    def ear_at(self, place: npt.ArrayLike) -> CalibratedProbe:
        """The probe at an advance and a roll (2,)."""
        return CalibratedProbe(
            self.probe,
            self.mount_at(place),
            radius=self.radius,
            thickness=self.thickness,
            temperature=self.temperature,
        )
