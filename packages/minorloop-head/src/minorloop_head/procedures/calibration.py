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
from minorloop_head.geometry import Mount, Pinhole, Probe, Tool
from minorloop_head.ultrasound.field import CalibratedProbe
from minorloop_head.vision.calibrated_camera import CalibratedCamera
from minorloop_head.vision.lens_calibration import FARTHEST

ROOM_TEMPERATURE = 20.0
"""Assumed temperature of the water in a flooded pipe, in degrees Celsius."""
THICKNESS_SD = 0.017
"""Relative standard deviation of a thickness measured by a caliper: that of errors up to 3 %."""
_LONGEST_LATENCY = 5.0
_LONGEST_PIPE = 1e5
_TURN = math.pi
_BOUNDS = {
    "radius": (1e-4, 1.0, "m"),
    "thickness": (1e-5, 0.1, "m"),
    "lever": (0.0, 1.0, "m"),
    "offset": (-1.0, 1.0, "m"),
    "temperature": (0.0, 100.0, "degrees Celsius"),
    "roll": (-_TURN, _TURN, "rad"),
    "straight": (-_TURN, _TURN, "rad"),
    "squint": (-_TURN / 2, _TURN / 2, "rad"),
    "camera_roll": (-_TURN, _TURN, "rad"),
}
"""Least and largest values of pipes and heads that a calibration and the command line accept. They
refuse millimetres that were entered as metres, and degrees as radians."""
STRAIGHT = math.radians(30.0)
"""Default pan and tilt of the joints at which the camera looks along the pipe. A wire pulls in one
direction only: half of its stroke is on either side."""


@dataclass(frozen=True, kw_only=True, eq=False)
class HeadCalibration:
    """Calibration of camera and probe, and of how they are mounted on the head.

    Raises a `ParameterError` if the lights are not (N, 3) finite numbers, or a number is beyond
    what pipes and heads can have.
    """

    lens: Pinhole
    leds: FloatArray
    """Shape (N, 3). Positions of the lights in camera coordinates, in metres."""
    offset: tuple[float, float] = (0.0, 0.0)
    """Offset of the pivot from the axis of the pipe, in metres."""
    roll: float = 0.0
    """Roll of the head about the axis of the pipe where the catheter's roll reads 0, in radians."""
    lever: float = 8e-3
    """Distance from the pivot of the head to the lens, in metres."""
    probe: Probe = field(default_factory=Probe)
    radius: float = 10e-3
    thickness: float = 2e-3
    """Radius of the pipe and thickness of its wall, in metres."""
    temperature: float = ROOM_TEMPERATURE
    """Temperature of the water with which the pipe is flooded, in degrees Celsius."""
    straight: tuple[float, float] = (STRAIGHT, STRAIGHT)
    """Pan and tilt that the joints read where they point along the pipe, in radians."""
    squint: float = 0.0
    camera_roll: float = 0.0
    """Rotation of the camera on the joints: sideways, then about its optical axis, in radians."""
    latency: float = 0.04
    """Longest time in seconds from the exposure of a picture to its arrival. Pictures that arrive
    within it after the lights were switched may show the lights before."""
    tool: Tool | None = None
    """The micro-tool beside the lens; None on a head without one."""
    length: float | None = None
    """Length of the pipe in metres, from where the advance of the catheter reads 0; or None."""

    def __post_init__(self) -> None:
        if self.leds.ndim != 2 or self.leds.shape[1] != 3 or not np.isfinite(self.leds).all():
            raise ParameterError(f"the leds have shape {self.leds.shape}; give (N, 3) numbers in m")
        far = np.linalg.norm(self.leds, axis=1).max(initial=0.0)
        if far > FARTHEST:
            raise ParameterError(
                f"an LED is {far:.4g} m from the lens; give its place in metres, within "
                f"{FARTHEST:g} m"
            )
        for name, (low, high, unit) in _BOUNDS.items():
            for value in np.atleast_1d(getattr(self, name)).tolist():
                if not low <= value <= high:
                    raise ParameterError(
                        f"{name} is {value:g} {unit}; give {low:g} to {high:g} {unit}"
                    )
        for value, size in zip(self.lens.centre, (self.lens.width, self.lens.height), strict=True):
            if not 0.0 <= value <= size:
                raise ParameterError(
                    f"the principal point of the lens is {list(self.lens.centre)} px; give one in "
                    f"the image of {self.lens.width} by {self.lens.height} pixels"
                )
        if self.length is not None and not 0.0 < self.length <= _LONGEST_PIPE:
            raise ParameterError(
                f"length is {self.length:g} m; give more than 0, up to {_LONGEST_PIPE:g} m, or None"
            )
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

        A probe without an azimuth is on the x axis: older files do not have this key.

        Raises a `ValueError` if a value is missing, unknown, of another type, or out of its range.
        """
        if isinstance(values.get("probe"), dict):
            values = {**values, "probe": {"azimuth": 0.0, **values["probe"]}}
        found = msgspec.convert(values, cls, dec_hook=lambda kind, value: np.array(value, float))
        _refuse_unknown(values, found.to_dict())
        return found

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


def _refuse_unknown(values: dict[str, Any], known: dict[str, Any]) -> None:
    """Refuse keys that a calibration does not have."""
    for name, value in values.items():
        if name not in known:
            raise ParameterError(
                f"the calibration has the unknown key {name!r}; there are {', '.join(known)}"
            )
        if isinstance(value, dict) and isinstance(known[name], dict):
            _refuse_unknown(value, known[name])
