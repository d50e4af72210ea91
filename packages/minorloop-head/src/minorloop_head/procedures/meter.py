"""Set the gain of the camera for a middle grey, the focus for the wall ahead, and the lights.

An acquisition is the frames under switched lights in which defects are searched.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.values import (
    NOW,
    LitCamera,
    Procedure,
    Reading,
    Request,
    Running,
    passed,
)
from minorloop_head.vision.calibrated_camera import Image
from minorloop_head.vision.defects import SEQUENCE
from minorloop_head.vision.reflectance_map import ALONE, LitFrame
from minorloop_head.vision.servo import wall_depth

_EVERY, _REFOCUS = 0.24, 0.2
"""Seconds between metered frames, and between settings of the focus."""
_AROUND = 2.4e-3
"""Half size, in metres around and along the wall, of the part that is metered about a place: the
tracked wall without the corners."""


@dataclass(frozen=True, kw_only=True)
class _LightLimits:
    """Settings of camera and light, and their limits."""

    exposure: float = 0.01
    """Exposure time in seconds: short enough not to smear at 10 degrees a second."""
    grey: float = 95.0
    """Mean grey level for which the gain is set. Half of full scale would leave no room for
    glints."""
    least_gain: float = 0.1
    most_gain: float = 20.0
    """Limits of the gain."""
    nearest: float = 5e-3
    farthest: float = 55e-3
    """Limits of the focus in metres: those of the camera, with a margin."""

    def focus(self, distance: float) -> float:
        """Return a distance, clipped to the limits of the focus."""
        return float(np.clip(distance, self.nearest, self.farthest))

    def gain(self, before: float, image: Image) -> float:
        """Return the next gain after an image, by 0.7 of the way on a logarithmic scale."""
        mean = max(float(image[::4, ::4].mean()), 1.0)
        wanted = before * (self.grey / mean) ** 0.7
        return float(np.clip(wanted, self.least_gain, self.most_gain))


LIMITS = _LightLimits()


@dataclass(kw_only=True, eq=False)
class Light:
    """Gain of a camera, and the place and focus that determine it."""

    gain: float = 1.0
    """Gain, which `meter` sets."""
    place: FloatArray | None = None
    """Shape (2,). Phi and z of the metered wall; the whole picture is metered if this is None or
    not in view."""
    focusing: bool = True
    """Whether the focus follows the wall ahead."""

    @property
    def exposure(self) -> tuple[float, float]:
        """Exposure time in seconds under all lights, and the gain."""
        return LIMITS.exposure, self.gain


def meter(
    calibration: HeadCalibration, light: Light, seconds: float = 1.0, *, last: Request = NOW
) -> Procedure[None]:
    """Let the gain follow the brightness, and the focus the wall ahead.

    ``light``: its gain is set; its other fields may change meanwhile. ``seconds``: duration;
    infinite for a loop that meters all the time. In 1 s the error of the gain falls below the
    noise, and the focus arrives. ``last``: further requests with the last setting.
    """
    metered = focused = -math.inf
    now = yield NOW
    began = now.t
    while True:
        exposure = focus = None
        if now.image is not None and passed(metered, now.t, _EVERY):
            light.gain = LIMITS.gain(light.gain, _about(calibration, light.place, now, now.image))
            metered, exposure = now.t, light.exposure
        if light.focusing and passed(focused, now.t, _REFOCUS):
            focus, focused = wall_ahead(calibration, now), now.t
        if passed(began, now.t, seconds):
            yield replace(last, exposure=exposure, focus=focus)
            return
        # A frame that is metered at the next tick or later is requested now.
        due = passed(metered, now.t, _EVERY - 0.05)
        now = yield Request(exposure=exposure, focus=focus, frame=due)


def wall_ahead(calibration: HeadCalibration, reading: Reading) -> float:
    """Return the distance of the wall ahead in metres, within the limits of the focus."""
    camera = calibration.camera_at(reading.place)
    try:
        distance = wall_depth(camera, np.zeros(2), *reading.angles.tolist())
    except ParameterError:
        distance = LIMITS.farthest
    return LIMITS.focus(distance)


def _about(
    calibration: HeadCalibration, place: FloatArray | None, reading: Reading, image: Image
) -> Image:
    """Return the part of an image about a place; all of it if the place is not in it."""
    if place is None:
        return image
    camera = calibration.camera_at(reading.place)
    metres = np.array([camera.radius, 1.0])
    corners = place + _AROUND * np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)]) / metres
    pixels = np.asarray(camera.pixel(corners, *reading.angles.tolist()))
    if not np.isfinite(pixels).all():
        return image
    left, top = np.maximum(pixels.min(axis=0).astype(int), 0)
    right, bottom = np.maximum(pixels.max(axis=0).astype(int), 0)
    part = image[top:bottom, left:right]
    return part if part.size else image


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
