"""Set the gain of the camera for a middle grey, and the focus for the wall ahead."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from minorloop.errors import ParameterError
from minorloop.head.procedures.calibration import HeadCalibration
from minorloop.head.procedures.values import NOTHING, Reading, Request, passed
from minorloop.head.vision.calibrated_camera import Image
from minorloop.head.vision.jacobian import wall_depth


@dataclass(frozen=True, kw_only=True)
class LightLimits:
    """What camera and light are set to.

    Parameters
    ----------
    exposure : float
        Seconds that the shutter is open: short enough not to smear at 10 degrees a second.
    grey : float
        Mean grey level that the gain is set for: half of what saturates would leave no room for
        glints.
    least_gain, most_gain : float
        Limits of the gain.
    nearest, farthest : float
        Distances in metres that the focus is sent to: the camera's own limits, with a margin.
    """

    exposure: float = 0.01
    grey: float = 95.0
    least_gain: float = 0.1
    most_gain: float = 20.0
    nearest: float = 5e-3
    farthest: float = 55e-3

    def focus(self, distance: float) -> float:
        """A distance, or the nearest that the focus is sent to."""
        return float(np.clip(distance, self.nearest, self.farthest))


LIMITS = LightLimits()


@dataclass(frozen=True, kw_only=True)
class MeterState:
    """Gain; when metering began, a frame was metered last, and the focus was sent last."""

    gain: float = 1.0
    began: float | None = None
    metered: float = -math.inf
    focused: float = -math.inf
    done: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Metering:
    """The gain follows the brightness, and the focus the wall in front of the camera.

    Parameters
    ----------
    calibration : HeadCalibration
    limits : LightLimits
    share : float
        Exponent of grey wanted over grey seen, for each frame that is metered.
    every : float
        Seconds from one frame that is metered to the next.
    refocus : float
        Seconds from one sending of the focus to the next.
    focusing : bool
        Whether the focus is sent at all.
    seconds : float
        How long it takes; infinite for a loop that meters on and on. In 1 s the error of the
        gain falls below the noise, and the focus arrives.
    """

    calibration: HeadCalibration
    limits: LightLimits = LIMITS
    share: float = 0.7
    every: float = 0.16
    refocus: float = 0.2
    focusing: bool = True
    seconds: float = 1.0

    def begin(self, gain: float = 1.0) -> MeterState:
        """State of a camera whose gain is known."""
        return MeterState(gain=gain)

    def step(self, state: MeterState, reading: Reading) -> tuple[MeterState, Request]:
        """The next state, and the exposure and focus that are asked for."""
        if state.done:
            return state, NOTHING
        t = reading.t
        began = t if state.began is None else state.began
        state = replace(state, began=began)
        if passed(began, t, self.seconds):
            state = replace(state, done=True)
        exposure = focus = None
        if reading.image is not None and passed(state.metered, t, self.every):
            state = replace(state, gain=self._gain(state.gain, reading.image), metered=t)
            exposure = self.limits.exposure, state.gain
        if self.focusing and passed(state.focused, t, self.refocus):
            focus, state = self.ahead(reading), replace(state, focused=t)
        # A frame that will be metered at the next tick or later is asked for now.
        due = not state.done and passed(state.metered, t, self.every - 0.05)
        return state, Request(exposure=exposure, focus=focus, frame=due)

    def ahead(self, reading: Reading) -> float:
        """Distance of the wall in front of the camera, within the limits of the focus."""
        eye = self.calibration.eye_at(reading.place)
        try:
            far = wall_depth(eye, np.zeros(2), float(reading.angles[0]), float(reading.angles[1]))
        except ParameterError:
            far = self.limits.farthest
        return self.limits.focus(far)

    def _gain(self, gain: float, image: Image) -> float:
        mean = max(float(image[::4, ::4].mean()), 1.0)
        wanted = gain * (self.limits.grey / mean) ** self.share
        return float(np.clip(wanted, self.limits.least_gain, self.limits.most_gain))
