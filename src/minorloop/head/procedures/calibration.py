"""Calibration of camera and probe, and of how they are mounted on the head."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError
from minorloop.head.geometry import Mount, Pinhole, Probe, Tool
from minorloop.head.ultrasound.field import CalibratedProbe
from minorloop.head.vision.calibrated_camera import CalibratedCamera

ROOM_TEMPERATURE = 20.0
"""Assumed temperature of the water in a flooded pipe, in degrees Celsius."""
_LONGEST_LATENCY = 5.0
STRAIGHT = math.radians(30.0)
"""Pan and tilt of the joints at which the camera looks along the pipe, where they are not
calibrated. A wire pulls in one direction only, so that half of its stroke is on either side."""


@dataclass(frozen=True, kw_only=True, eq=False)
class HeadCalibration:
    """Calibration of camera and probe, and of how they are mounted on the head.

    Parameters
    ----------
    lens : Pinhole
    leds : (N, 3) array
        Positions of the lights in camera coordinates, in metres.
    offset : (float, float)
        Offset of the pivot from the axis of the pipe, in metres.
    roll : float
        Roll of the head about the axis of the pipe where the catheter's roll reads 0, in radians.
    lever : float
        Distance from the pivot of the head to the lens, in metres.
    probe : Probe
    radius, thickness : float
        Of the pipe and its wall, in metres.
    temperature : float
        Of the water with which the pipe is flooded, in degrees Celsius.
    straight : (float, float)
        Pan and tilt that the joints read where they point along the pipe, in radians.
    squint, camera_roll : float
        Of the camera on the joints: sideways, then about its optical axis, in radians.
    latency : float
        Longest time in seconds from the exposure of a picture to its arrival. Pictures that arrive
        within it after the lights were switched may show the lights before.
    tool : Tool, optional
        The micro-tool beside the lens; None on a head without one.

    Raises
    ------
    ParameterError
        If the lights are not (N, 3) finite numbers, a length is not positive, or the latency is
        not 0 to 5 s.
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
    straight: tuple[float, float] = (STRAIGHT, STRAIGHT)
    squint: float = 0.0
    camera_roll: float = 0.0
    latency: float = 0.04
    tool: Tool | None = None

    def __post_init__(self) -> None:
        if self.leds.ndim != 2 or self.leds.shape[1] != 3 or not np.isfinite(self.leds).all():
            raise ParameterError(f"the leds have shape {self.leds.shape}; give (N, 3) numbers in m")
        for name in ("radius", "thickness"):
            if not getattr(self, name) > 0:
                raise ParameterError(f"{name} is {getattr(self, name)} m; give a positive length")
        if not 0.0 <= self.latency <= _LONGEST_LATENCY:
            raise ParameterError(
                f"latency is {self.latency} s; give 0 to {_LONGEST_LATENCY:g} s, one interval "
                "between two pictures where it is not known"
            )

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, for messages and files."""
        plain: dict[str, Any] = msgspec.to_builtins(self, enc_hook=lambda value: value.tolist())
        return plain

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> HeadCalibration:
        """Return the calibration that `to_dict` gave these values.

        A probe without an azimuth is of a file before there was one: it was on the x axis.

        Raises
        ------
        ValueError
            If a value is missing, unknown, or of another type.
        """
        if isinstance(values.get("probe"), dict):
            values = {**values, "probe": {"azimuth": 0.0, **values["probe"]}}
        return msgspec.convert(values, cls, dec_hook=lambda kind, value: np.array(value, float))

    def joints(self, angles: npt.ArrayLike) -> FloatArray:
        """Return pan and tilt (2,) of the joints in degrees, for a line of sight in radians."""
        return np.asarray(np.degrees(np.asarray(angles) + self.straight))

    def line_of_sight(self, joints: npt.ArrayLike) -> FloatArray:
        """Return pan and tilt (2,) along the pipe for those of the joints, in radians."""
        return np.asarray(np.asarray(joints) - self.straight)

    def mount_at(self, place: npt.ArrayLike) -> Mount:
        """Return the mount of the head at an advance and a roll (2,) of the catheter."""
        advance, roll = np.asarray(place, dtype=np.float64).tolist()
        return Mount(
            lever=self.lever,
            offset=self.offset,
            roll=self.roll + roll,
            advance=advance,
            squint=self.squint,
            camera_roll=self.camera_roll,
        )

    def camera_at(self, place: npt.ArrayLike) -> CalibratedCamera:
        """Return the camera at an advance and a roll (2,) of the catheter."""
        return CalibratedCamera(self.lens, self.mount_at(place), self.leds, self.radius)

    def probe_at(self, place: npt.ArrayLike) -> CalibratedProbe:
        """Return the probe at an advance and a roll (2,) of the catheter."""
        return CalibratedProbe(
            self.probe,
            self.mount_at(place),
            radius=self.radius,
            thickness=self.thickness,
            temperature=self.temperature,
        )
