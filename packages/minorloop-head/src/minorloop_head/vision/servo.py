"""Turn the head until a point of the wall is at a wanted place in the image.

A servo is frozen configuration; each step takes a state and returns the next one::

    servo = Servo(camera, cone=Cone(half=np.deg2rad(30)))
    state = servo.begin(angles)
    while ...:
        step, state = servo.step(state, pixel, angles)
        head.aim(step.angles)
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_finite
from minorloop.errors import ParameterError
from minorloop_head.vision.calibrated_camera import CalibratedCamera
from minorloop_head.vision.jacobian import pan_tilt_jacobian, rates_for, wall_depth

TURNING, AT_CONE, AT_RATE, NO_TARGET, SINGULAR = (
    "turning",
    "at the cone",
    "at the rate limit",
    "no target",
    "singular",
)
"""Verdicts of a step."""


@dataclass(frozen=True)
class Cone:
    """The directions in which the head may look: within ``half`` of (pan, tilt), in radians.

    Raises
    ------
    ParameterError
        If the half angle is not between 0 and a half turn.
    """

    half: float = math.radians(30)
    pan: float = 0.0
    tilt: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < as_finite("half angle of the cone", self.half) <= math.pi:
            raise ParameterError(f"a cone of {self.half} rad; give a half angle in (0, pi]")

    def clip(self, angles: npt.ArrayLike) -> FloatArray:
        """Return (2,) angles, shortened to the edge of the cone if they are outside."""
        middle = np.array([self.pan, self.tilt])
        off = np.asarray(angles, dtype=np.float64) - middle
        reach = float(np.hypot(*off))
        return np.asarray(middle + off * min(1.0, self.half / max(reach, 1e-12)))


@dataclass(frozen=True, eq=False)
class ServoState:
    """State of a servo.

    Parameters
    ----------
    angles : (2,) array
        Last wanted pan and tilt, in radians.
    integral : (2,) array
        Integral of the angular error, in radian seconds.
    """

    angles: FloatArray
    integral: FloatArray


@dataclass(frozen=True, eq=False)
class ServoStep:
    """Result of a step: the next angles of the head.

    Parameters
    ----------
    angles : (2,) array
        Wanted pan and tilt, in radians.
    rates : (2,) array
        Their rates, in radians per second.
    error : float
        Distance of the point from its wanted place, in pixels; NaN without a point.
    verdict : str
        ``turning``, ``at the cone``, ``at the rate limit``, ``no target`` or ``singular``.
    """

    angles: FloatArray
    rates: FloatArray
    error: float
    verdict: str


@dataclass(frozen=True, eq=False)
class Servo:
    """Control law: rates = -gain e - integral_gain (integral of e dt), e = J^-1 (s - wanted).

    Parameters
    ----------
    camera : CalibratedCamera
        Gives the depth of the wall and the lever of the lens.
    gain : float
        Rate at which the error decays, in 1/s.
    integral_gain : float
        In 1/s^2. The integral stops while a limit is active.
    interval : float
        Time between steps, in seconds.
    delay : float
        From a change of the wanted angles to its effect in the image, in seconds. A gain that is
        too high for it is refused.
    cone : Cone
        Where the head may look.
    rate_limit : float
        Fastest change of the wanted direction, in radians per second.
    lead : float
        Largest distance of wanted from measured angles, in radians, for a head that is slow.
    soft : float
        Distance in pixels below which the gain falls in proportion; 0 keeps it constant.

    Raises
    ------
    ParameterError
        If a number is out of its range, or gain times delay is not below 0.5.

    Notes
    -----
    e is the angular error of the head; the law is that of Chaumette and Hutchinson, Visual servo
    control I, 2006, equation (5), plus an integral term with the sign of the proportional one. The
    wanted angles are an integral of the rates already, so that a second one overshoots on the way
    to a point; it is for a head that drifts all the time. `PointHold` has the integral of the
    angles.
    """

    camera: CalibratedCamera
    gain: float = 0.5
    integral_gain: float = 0.0
    interval: float = 0.04
    delay: float = 0.0
    cone: Cone = Cone()
    rate_limit: float = math.radians(20)
    lead: float = math.inf
    soft: float = 0.0

    def __post_init__(self) -> None:
        for name in ("gain", "interval", "rate_limit", "lead"):
            if not getattr(self, name) > 0:
                raise ParameterError(f"{name} of the servo is {getattr(self, name)}; give > 0")
        for name in ("integral_gain", "delay", "soft"):
            if not as_finite(name, getattr(self, name)) >= 0:
                raise ParameterError(f"{name} of the servo is {getattr(self, name)}; give >= 0")
        if not self.gain * (self.delay + self.interval) < 0.5:
            raise ParameterError(
                f"gain {self.gain} 1/s times a delay of {self.delay + self.interval:g} s is not "
                "below 0.5 and the loop would ring; lower the gain"
            )

    def begin(self, angles: npt.ArrayLike) -> ServoState:
        """Return the state of a servo that starts at (2,) angles in radians, without a jump.

        Raises
        ------
        ParameterError
            If they are not two finite numbers.
        """
        start = _pair(angles)
        if not np.isfinite(start).all():
            raise ParameterError(
                f"a servo cannot begin at {angles!r}; give pan and tilt, two finite numbers in rad"
            )
        return ServoState(self.cone.clip(start), np.zeros(2))

    def step(
        self,
        state: ServoState,
        pixel: npt.ArrayLike | None,
        angles: npt.ArrayLike | None = None,
        *,
        wanted: npt.ArrayLike = (0.0, 0.0),
    ) -> tuple[ServoStep, ServoState]:
        """Return the next angles and state; a lost point gives a verdict, not an error.

        Parameters
        ----------
        state : ServoState
        pixel : (2,) array_like, optional
            Place of the point in the image; None, NaN or anything but a pair while it is lost.
        angles : (2,) array_like, optional
            Measured pan and tilt, in radians; without them, the last wanted ones.
        wanted : (2,) array_like
            Wanted place of the point, in normalised coordinates; anything but a pair of numbers
            is no target.
        """
        seen, goal = _pair(pixel), _pair(wanted)
        measured = _pair(angles)
        present = np.where(np.isfinite(measured), measured, state.angles)
        if not (np.isfinite(seen).all() and np.isfinite(goal).all()):
            return ServoStep(state.angles, np.zeros(2), math.nan, NO_TARGET), state
        point = self.camera.lens.normalised(seen)
        off = point - goal
        pixels = float(self.camera.lens.focal * np.hypot(*off))
        error = self.angular_error(point, off, present)
        if error is None:
            return ServoStep(state.angles, np.zeros(2), pixels, SINGULAR), state
        return self._turn(state, error, present if angles is not None else None, pixels)

    def angular_error(
        self, point: FloatArray, off: FloatArray, angles: FloatArray
    ) -> FloatArray | None:
        """Return an error in the image as pan and tilt; None where the Jacobian is singular."""
        pan, tilt = float(angles[0]), float(angles[1])
        try:
            depth = wall_depth(self.camera, point, pan, tilt)
        except ParameterError:
            return None
        mount = self.camera.mount
        jacobian = pan_tilt_jacobian(
            point, tilt, lever=mount.lever, depth=depth, camera=mount.camera
        )
        return rates_for(jacobian, off)

    def _turn(
        self, state: ServoState, error: FloatArray, measured: FloatArray | None, pixels: float
    ) -> tuple[ServoStep, ServoState]:
        integral = state.integral + self.interval * error
        gain = self.gain * (min(pixels / self.soft, 1.0) if self.soft > 0 else 1.0)
        rates = -gain * error - self.integral_gain * integral
        aimed, verdict = state.angles + self.interval * rates, TURNING
        if measured is not None and math.isfinite(self.lead):
            near = measured + shortened(aimed - measured, self.lead)
            verdict = AT_RATE if (near != aimed).any() else verdict
            aimed = near
        inside = self.cone.clip(aimed)
        if np.abs(inside - aimed).max() > 1e-12:
            verdict = AT_CONE
        # The cone is convex: a shorter step from inside stays inside.
        move = shortened(inside - state.angles, self.rate_limit * self.interval)
        if verdict == TURNING and (move != inside - state.angles).any():
            verdict = AT_RATE
        step = ServoStep(state.angles + move, move / self.interval, pixels, verdict)
        after = replace(state, angles=step.angles)
        return step, replace(after, integral=integral) if verdict == TURNING else after


def _pair(values: npt.ArrayLike | None) -> FloatArray:
    """Return two numbers, NaN for anything else."""
    try:
        pair = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        return np.full(2, np.nan)
    return pair if pair.shape == (2,) else np.full(2, np.nan)


def shortened(vector: FloatArray, most: float) -> FloatArray:
    """Return the vector, shortened to a length of ``most``."""
    length = float(np.hypot(*vector))
    return vector if length <= most else np.asarray(vector * (most / length))
