"""Turn the head until a point of the wall is in the middle of the image.

A servo is frozen configuration; each step takes a state and returns the next one::

    servo = Servo(camera, cone=Cone(half=np.deg2rad(30)))
    state = servo.begin(angles)
    while ...:
        step, state = servo.step(state, pixel, angles)
        head.aim(step.angles)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

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
    """The directions in which the head may look: within ``half`` of the middle, in radians.

    Raises a `ParameterError` if the half angle is not between 0 and a half turn.
    """

    half: float = math.radians(30)

    def __post_init__(self) -> None:
        if not 0 < as_finite("half angle of the cone", self.half) <= math.pi:
            raise ParameterError(f"a cone of {self.half} rad; give a half angle in (0, pi]")

    def clip(self, angles: npt.ArrayLike) -> FloatArray:
        """Return (2,) angles, shortened to the edge of the cone if they are outside."""
        wanted = np.asarray(angles, dtype=np.float64)
        return np.asarray(wanted * min(1.0, self.half / max(float(np.hypot(*wanted)), 1e-12)))


@dataclass(frozen=True, eq=False)
class _ServoState:
    """State of a servo."""

    angles: FloatArray
    """Shape (2,). Last wanted pan and tilt, in radians."""


@dataclass(frozen=True, eq=False)
class ServoStep:
    """Result of a step: the next angles of the head."""

    angles: FloatArray
    """Shape (2,). Wanted pan and tilt, in radians."""
    rates: FloatArray
    """Shape (2,). Their rates, in radians per second."""
    error: float
    """Distance of the point from the middle, in pixels; NaN without a point."""
    verdict: str
    """``turning``, ``at the cone``, ``at the rate limit``, ``no target`` or ``singular``."""


@dataclass(frozen=True, eq=False)
class Servo:
    """Control law: rates = -gain e, e = J^-1 s, with the place s of the point from the middle.

    Raises a `ParameterError` if a number is out of its range, or gain times delay is not below 0.5.

    Notes
    -----
    e is the angular error of the head; the law is that of Chaumette and Hutchinson, Visual servo
    control I, 2006, equation (5). The wanted angles are an integral of the rates already, so that
    an integral of the error would overshoot on the way to a point; `PointHold` has one.
    """

    camera: CalibratedCamera
    """Gives the depth of the wall and the lever of the lens."""
    gain: float = 0.5
    """Rate at which the error decays, in 1/s."""
    interval: float = 0.04
    """Time between steps, in seconds."""
    delay: float = 0.0
    """From a change of the wanted angles to its effect in the image, in seconds. A gain that is too
    high for it is refused."""
    cone: Cone = Cone()
    """Where the head may look."""
    rate_limit: float = math.radians(20)
    """Fastest change of the wanted direction, in radians per second."""
    soft: float = 0.0
    """Distance in pixels below which the gain falls in proportion; 0 keeps it constant."""

    def __post_init__(self) -> None:
        for name in ("gain", "interval", "rate_limit"):
            if not getattr(self, name) > 0:
                raise ParameterError(f"{name} of the servo is {getattr(self, name)}; give > 0")
        for name in ("delay", "soft"):
            if not as_finite(name, getattr(self, name)) >= 0:
                raise ParameterError(f"{name} of the servo is {getattr(self, name)}; give >= 0")
        if not self.gain * (self.delay + self.interval) < 0.5:
            raise ParameterError(
                f"gain {self.gain} 1/s times a delay of {self.delay + self.interval:g} s is not "
                "below 0.5 and the loop would ring; lower the gain"
            )

    def begin(self, angles: npt.ArrayLike) -> _ServoState:
        """Return the state of a servo that starts at (2,) angles in radians, without a jump.

        Raises a `ParameterError` if they are not two finite numbers.
        """
        start = _pair(angles)
        if not np.isfinite(start).all():
            raise ParameterError(
                f"a servo cannot begin at {angles!r}; give pan and tilt, two finite numbers in rad"
            )
        return _ServoState(self.cone.clip(start))

    def step(
        self, state: _ServoState, pixel: npt.ArrayLike | None, angles: npt.ArrayLike | None = None
    ) -> tuple[ServoStep, _ServoState]:
        """Return the next angles and state; a lost point gives a verdict, not an error.

        ``pixel`` (2,): place of the point in the image; None, NaN or anything but a pair while it
        is lost. ``angles`` (2,): measured pan and tilt, in radians; without them, the last wanted
        ones.
        """
        seen, measured = _pair(pixel), _pair(angles)
        present = np.where(np.isfinite(measured), measured, state.angles)
        if not np.isfinite(seen).all():
            return ServoStep(state.angles, np.zeros(2), math.nan, NO_TARGET), state
        point = self.camera.lens.normalised(seen)
        pixels = self.camera.lens.off_axis(point)
        error = self.angular_error(point, present)
        if error is None:
            return ServoStep(state.angles, np.zeros(2), pixels, SINGULAR), state
        return self._turn(state, error, pixels)

    def angular_error(self, point: FloatArray, angles: FloatArray) -> FloatArray | None:
        """Return where a point is as pan and tilt; None where the Jacobian is singular.

        It is (2,) in normalised coordinates, at angles (2,) in radians.
        """
        pan, tilt = float(angles[0]), float(angles[1])
        try:
            depth = wall_depth(self.camera, point, pan, tilt)
        except ParameterError:
            return None
        mount = self.camera.mount
        jacobian = pan_tilt_jacobian(
            point, tilt, lever=mount.lever, depth=depth, camera=mount.camera
        )
        return rates_for(jacobian, point)

    def _turn(
        self, state: _ServoState, error: FloatArray, pixels: float
    ) -> tuple[ServoStep, _ServoState]:
        gain = self.gain * (min(pixels / self.soft, 1.0) if self.soft > 0 else 1.0)
        aimed, verdict = state.angles + self.interval * (-gain * error), TURNING
        inside = self.cone.clip(aimed)
        if np.abs(inside - aimed).max() > 1e-12:
            verdict = AT_CONE
        # The cone is convex: a shorter step from inside stays inside.
        move = shortened(inside - state.angles, self.rate_limit * self.interval)
        if verdict == TURNING and (move != inside - state.angles).any():
            verdict = AT_RATE
        step = ServoStep(state.angles + move, move / self.interval, pixels, verdict)
        return step, _ServoState(step.angles)


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
