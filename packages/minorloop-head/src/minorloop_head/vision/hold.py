"""Bring a point of the wall to the middle of the image and hold it there while flow sways the head.

Each frame gives the joint angles at which the point would be in the middle. They move as the sway
does, and are predicted by the delay of the wires. An integral of the error removes what is left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_finite
from minorloop.errors import ParameterError
from minorloop_head.vision.servo import (
    AT_CONE,
    AT_RATE,
    NO_TARGET,
    SINGULAR,
    TURNING,
    Servo,
    ServoStep,
    shortened,
)

_STABLE = 0.9
"""Bound of integral gain times delay; with a pure delay the loop is stable below 0.94."""


@dataclass(frozen=True, eq=False)
class _HoldState:
    """State of a hold.

    ``angles`` (2,) are the joint angles that would centre the point, in radians, ``rates`` (2,)
    their rates, ``integral`` (2,) that of the angular error, in radian seconds; ``followed`` (2,)
    are the angles at which joints are that follow, ``wanted`` (2,) the last ones asked for. The
    point has not been seen for ``missed`` seconds.
    """

    angles: FloatArray
    rates: FloatArray
    integral: FloatArray
    followed: FloatArray
    wanted: FloatArray
    missed: float = 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class PointHold:
    """Joint angles that keep a point in the middle, predicted by ``lead``, with an integral.

    Raises a `ParameterError` if integral gain times delay is not below 0.9.

    Notes
    -----
    The angles are those that centre the point minus k (integral of e dt + lead e), with the
    angular error e: Boudjabi, Ferreira and Krupa, Proc. IEEE ICRA 2003, Eq. (10), with the sign of
    the integral that is stable.

    References
    ----------
    Benedict and Bordner, Synthesis of an optimal set of radar track-while-scan smoothing
    equations, IRE Trans. Automatic Control 7, 1962: the filter of place and rate.
    """

    servo: Servo
    """Gives camera, interval, cone and rate limit; its gains are not used."""
    lead: float = 0.35
    """Delay of the wires, in seconds."""
    integral_gain: float = 2.0
    """In 1/s; 0 is without the integral."""
    near: float = math.radians(2.0)
    """Angular error in radians above which nothing is integrated: the head is on its way."""
    slip: float = math.radians(0.5)
    """Distance in radians of a joint from where it should be by now, above which its error is not
    integrated: its wire is at a limit, or cools as fast as it can."""
    share: float = 0.5
    slope_share: float = 0.15
    """Weight of a new frame in the angles and in their rates, above 0 and up to 1."""
    patience: float = 0.4
    """Time in seconds for which the motion continues while the point is not seen."""

    def __post_init__(self) -> None:
        most = _STABLE / (self.lead + self.servo.interval)
        if not 0 <= as_finite("integral_gain", self.integral_gain) < most:
            raise ParameterError(
                f"integral_gain is {self.integral_gain} 1/s; give 0 to below {most:.3g} 1/s, or "
                "the loop would ring with its delay"
            )

    def begin(self, angles: npt.ArrayLike) -> _HoldState:
        """Return the state of a hold that starts at (2,) angles in radians."""
        start = self.servo.cone.clip(np.nan_to_num(np.asarray(angles, dtype=np.float64)))
        return _HoldState(start, np.zeros(2), np.zeros(2), start, start)

    def step(
        self, state: _HoldState, pixel: npt.ArrayLike | None, angles: npt.ArrayLike
    ) -> tuple[ServoStep, _HoldState]:
        """Return the next joint angles and state; a lost point gives a verdict, not an error.

        ``pixel`` (2,): place of the point in the image; None or NaN while it is lost. ``angles``
        (2,): pan and tilt as measured when the image was taken, in radians.
        """
        seen = np.full(2, np.nan) if pixel is None else np.asarray(pixel, dtype=np.float64)
        measured = np.asarray(angles, dtype=np.float64)
        error, pixels, verdict = None, math.nan, NO_TARGET
        if np.isfinite(seen).all() and np.isfinite(measured).all():
            point = self.servo.camera.lens.normalised(seen)
            pixels = self.servo.camera.lens.off_axis(point)
            error = self.servo.angular_error(point, measured)
            verdict = SINGULAR if error is None else TURNING
        new = self._waited(state) if error is None else self._seen(state, error, measured)
        wanted = new.angles + self.lead * new.rates + self.correction(new.integral, error)
        inside = self.servo.cone.clip(wanted)
        if verdict == TURNING and np.abs(inside - wanted).max() > 1e-12:
            verdict = AT_CONE
        move = shortened(inside - state.wanted, self.servo.rate_limit * self.servo.interval)
        if verdict == TURNING and (move != inside - state.wanted).any():
            verdict = AT_RATE
        inside = state.wanted + move
        if verdict in (AT_CONE, AT_RATE):
            new = replace(new, integral=state.integral)
        pace = self.servo.interval / (self.lead + self.servo.interval)
        followed = new.followed + pace * (inside - new.followed)
        new = replace(new, followed=followed, wanted=inside)
        return ServoStep(inside, new.rates, pixels, verdict), new

    def correction(self, integral: FloatArray, error: FloatArray | None) -> FloatArray:
        """Return what the integral adds to the angles (2,), with its lead if there is an error."""
        ahead = np.zeros(2) if error is None else self.lead * shortened(error, self.near)
        return np.asarray(-self.integral_gain * (integral + ahead))

    def _waited(self, state: _HoldState) -> _HoldState:
        """Return the state after a frame without the point."""
        missed = state.missed + self.servo.interval
        if missed > self.patience:
            return replace(state, rates=np.zeros(2), missed=missed)
        moved = state.angles + self.servo.interval * state.rates
        return replace(state, angles=moved, missed=missed)

    def _seen(self, state: _HoldState, error: FloatArray, measured: FloatArray) -> _HoldState:
        """Return the state after a frame with an angular error (2,) at measured angles."""
        interval = self.servo.interval
        predicted = state.angles + interval * state.rates
        innovation = measured - error - predicted
        follows = np.abs(measured - state.followed) < self.slip
        near = float(np.hypot(*error)) <= self.near
        return _HoldState(
            predicted + self.share * innovation,
            state.rates + self.slope_share / interval * innovation,
            state.integral + interval * error * (follows & near),
            state.followed,
            state.wanted,
        )
