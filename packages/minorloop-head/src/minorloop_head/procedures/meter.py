"""Set the gain of the camera for a middle grey, and the focus for the wall ahead."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.values import Procedure, Reading, Request, passed
from minorloop_head.vision.calibrated_camera import Image
from minorloop_head.vision.jacobian import wall_depth

_AROUND = 2.4e-3
"""Metres around and along the wall from a place to the edge of what is exposed for: the wall by
which it is tracked, but for the corners."""


@dataclass(frozen=True, kw_only=True)
class LightLimits:
    """Settings of camera and light, and their limits.

    Parameters
    ----------
    exposure : float
        Exposure time in seconds: short enough not to smear at 10 degrees a second.
    grey : float
        Mean grey level for which the gain is set. Half of full scale would leave no room for
        glints.
    least_gain, most_gain : float
        Limits of the gain.
    nearest, farthest : float
        Limits of the focus in metres: those of the camera, with a margin.
    """

    exposure: float = 0.01
    grey: float = 95.0
    least_gain: float = 0.1
    most_gain: float = 20.0
    nearest: float = 5e-3
    farthest: float = 55e-3

    def focus(self, distance: float) -> float:
        """Return a distance, clipped to the limits of the focus."""
        return float(np.clip(distance, self.nearest, self.farthest))

    def gain(self, before: float, image: Image, share: float = 0.7) -> float:
        """Return the next gain after an image, by a share of the way on a logarithmic scale."""
        mean = max(float(image[::4, ::4].mean()), 1.0)
        wanted = before * (self.grey / mean) ** share
        return float(np.clip(wanted, self.least_gain, self.most_gain))


LIMITS = LightLimits()


@dataclass(frozen=True, kw_only=True)
class MeterState:
    """Gain, and the times at which metering began, metered last and set the focus last.

    The picture is metered about ``place`` (2,), phi and z, if there is one.
    """

    gain: float = 1.0
    place: FloatArray | None = None
    began: float | None = None
    metered: float = -math.inf
    focused: float = -math.inf
    done: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Metering(Procedure[MeterState]):
    """Gain that follows the brightness, and focus that follows the wall ahead.

    Parameters
    ----------
    calibration : HeadCalibration
    limits : LightLimits
    share : float
        Exponent of the wanted grey level over the measured one, for each metered frame.
    every : float
        Seconds between metered frames.
    refocus : float
        Seconds between settings of the focus.
    focusing : bool
        Whether the focus is set at all.
    seconds : float
        Duration; infinite for a loop that meters all the time. In 1 s the error of the gain
        falls below the noise, and the focus arrives.
    """

    calibration: HeadCalibration
    limits: LightLimits = LIMITS
    share: float = 0.7
    every: float = 0.24
    refocus: float = 0.2
    focusing: bool = True
    seconds: float = 1.0

    def begin(self, gain: float = 1.0, place: npt.ArrayLike | None = None) -> MeterState:
        """Return the state of a camera whose gain is known, and phi and z (2,) to expose for."""
        return MeterState(gain=gain, place=None if place is None else np.asarray(place))

    def _next(self, state: MeterState, reading: Reading) -> tuple[MeterState, Request]:
        t = reading.t
        began = t if state.began is None else state.began
        state = replace(state, began=began, done=passed(began, t, self.seconds))
        exposure = focus = None
        if reading.image is not None and passed(state.metered, t, self.every):
            shown = self._about(state.place, reading, reading.image)
            gain = self.limits.gain(state.gain, shown, self.share)
            state = replace(state, gain=gain, metered=t)
            exposure = self.limits.exposure, state.gain
        if self.focusing and passed(state.focused, t, self.refocus):
            focus, state = self.ahead(reading), replace(state, focused=t)
        # A frame that is metered at the next tick or later is requested now.
        due = not state.done and passed(state.metered, t, self.every - 0.05)
        return state, Request(exposure=exposure, focus=focus, frame=due)

    def _about(self, place: FloatArray | None, reading: Reading, image: Image) -> Image:
        """Return the part of an image about a place; all of it if the place is not in it."""
        if place is None:
            return image
        camera = self.calibration.camera_at(reading.place)
        metres = np.array([camera.radius, 1.0])
        corners = place + _AROUND * np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)]) / metres
        pixels = np.asarray(camera.pixel(corners, *reading.angles.tolist()))
        if not np.isfinite(pixels).all():
            return image
        left, top = np.maximum(pixels.min(axis=0).astype(int), 0)
        right, bottom = np.maximum(pixels.max(axis=0).astype(int), 0)
        part = image[top:bottom, left:right]
        return part if part.size else image

    def ahead(self, reading: Reading) -> float:
        """Return the distance of the wall ahead, within the limits of the focus."""
        camera = self.calibration.camera_at(reading.place)
        pan, tilt = reading.angles.tolist()
        try:
            distance = wall_depth(camera, np.zeros(2), pan, tilt)
        except ParameterError:
            distance = self.limits.farthest
        return self.limits.focus(distance)
