"""Hold a point of the wall in the middle of the image while flow sways the head.

A servo that integrates small rates is too slow for that. Each frame gives the joint angles at which
the point would be in the middle. They move as the sway does, and are predicted by the delay of the
wires.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_finite
from minorloop.errors import ParameterError
from minorloop.head.vision.servo import (
    AT_CONE,
    NO_TARGET,
    SINGULAR,
    TURNING,
    Servo,
    ServoStep,
    _shortened,
)


@dataclass(frozen=True, eq=False)
class HoldState:
    """State of a hold.

    ``angles`` (2,) are the joint angles that would centre the point, in radians, ``rates`` (2,)
    their rates, ``integral`` (2,) that of the angular error, in radian seconds; the point has not
    been seen for ``missed`` seconds.
    """

    angles: FloatArray
    rates: FloatArray
    integral: FloatArray
    missed: float = 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class PointHold:
    """Joint angles that keep a point in the middle, predicted by ``lead``.

    Parameters
    ----------
    servo : Servo
        Gives camera, interval and cone; its gain is not used.
    lead : float
        Delay of the wires, in seconds.
    share, slope_share : float
        Weight of a new frame in the angles and in their rates, above 0 and up to 1.
    patience : float
        Time in seconds for which the motion continues while the point is not seen.

    Raises
    ------
    ParameterError
        If a number is out of its range.

    References
    ----------
    Benedict and Bordner, Synthesis of an optimal set of radar track-while-scan smoothing
    equations, IRE Trans. Automatic Control 7, 1962: the filter of place and rate.
    """

    servo: Servo
    lead: float = 0.35
    integral_gain: float = 0.0
    near: float = math.radians(2.0)
    share: float = 0.5
    slope_share: float = 0.15
    patience: float = 0.4

    def __post_init__(self) -> None:
        for name, most in (("share", 1.0), ("slope_share", 1.0)):
            if not 0 < as_finite(name, getattr(self, name)) <= most:
                raise ParameterError(f"{name} is {getattr(self, name)}; give more than 0, up to 1")
        for name in ("lead", "patience"):
            if not 0 <= as_finite(name, getattr(self, name)) <= 10:
                raise ParameterError(f"{name} is {getattr(self, name)} s; give 0 to 10 s")

    def begin(self, angles: npt.ArrayLike) -> HoldState:
        """Return the state of a hold that starts at (2,) angles in radians."""
        start = np.nan_to_num(np.asarray(angles, dtype=np.float64))
        return HoldState(self.servo.cone.clip(start), np.zeros(2), np.zeros(2))

    def step(
        self, state: HoldState, pixel: npt.ArrayLike | None, angles: npt.ArrayLike
    ) -> tuple[ServoStep, HoldState]:
        """Return the next joint angles and state; a lost point gives a verdict, not an error.

        Parameters
        ----------
        state : HoldState
        pixel : (2,) array_like, optional
            Place of the point in the image; None or NaN while it is lost.
        angles : (2,) array_like
            Pan and tilt as measured when the image was taken, in radians.
        """
        interval, cone = self.servo.interval, self.servo.cone
        predicted = state.angles + interval * state.rates
        seen = np.full(2, np.nan) if pixel is None else np.asarray(pixel, dtype=np.float64)
        measured = np.asarray(angles, dtype=np.float64)
        error, pixels, verdict = None, math.nan, NO_TARGET
        if np.isfinite(seen).all() and np.isfinite(measured).all():
            point = self.servo.camera.lens.normalised(seen)
            pixels = float(self.servo.camera.lens.focal * np.hypot(*point))
            error = self.servo.angular_error(point, point, measured)
            verdict = SINGULAR if error is None else TURNING
        if error is None:
            missed = state.missed + interval
            rates = state.rates if missed <= self.patience else np.zeros(2)
            angles = predicted if missed <= self.patience else state.angles
            new, error = HoldState(angles, rates, state.integral, missed), np.zeros(2)
        else:
            innovation = measured - error - predicted
            rates = state.rates + self.slope_share / interval * innovation
            far = float(np.hypot(*error)) > self.near
            integral = state.integral + (0.0 if far else interval) * error
            new = HoldState(predicted + self.share * innovation, rates, integral)
            error = _shortened(error, self.near)
        wanted = new.angles + self.lead * new.rates
        wanted = wanted - self.integral_gain * (new.integral + self.lead * error)
        inside = cone.clip(wanted)
        if verdict == TURNING and np.abs(inside - wanted).max() > 1e-12:
            verdict, new = AT_CONE, replace(new, integral=state.integral)
        return ServoStep(inside, new.rates, pixels, verdict), new
