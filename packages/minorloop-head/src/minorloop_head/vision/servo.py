"""Turn the head until a point of the wall is in the middle of the image.

A servo is frozen configuration; each step takes a state and returns the next one::

    servo = Servo(camera, cone=Cone(half=np.deg2rad(30)))
    state = servo.begin(angles)
    while ...:
        step, state = servo.step(state, pixel, angles)
        head.aim(step.angles)

`PointHold` keeps it there while flow sways the head: each frame gives the joint angles at which the
point would be in the middle. They follow the sway, and are predicted by the delay of the wires. An
integral of the error removes the remaining error.

Without joint sensors, the camera measures the angles: a fixed patch of the wall shows in each frame
how the head has turned since the patch was picked (`sighted_angles`). In the interaction matrix of
pan and tilt (Chaumette and Hutchinson, Visual servo control I, 2006, equation 11), points are in
normalised coordinates (X, Y), without distortion, x right, y down, z ahead, and velocities are
those of the camera in its own frame. A head that pans about an axis of the base also turns about
its own optical axis, and its lens moves with it, so that all six columns are needed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_finite
from minorloop.errors import ParameterError
from minorloop_head.geometry import body_rates, meet_wall, wall_point
from minorloop_head.vision.calibrated_camera import CalibratedCamera

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
    control I, 2006, equation (5). The wanted angles already integrate the rates: an integral of the
    error would overshoot on the way to a point; `PointHold` has one.
    """

    camera: CalibratedCamera
    """Source of the depth of the wall and the lever of the lens."""
    gain: float = 0.5
    """Rate at which the error decays, in 1/s."""
    interval: float = 0.04
    """Time between steps, in seconds."""
    delay: float = 0.0
    """Delay from a change of the wanted angles to its effect in the image, in seconds. It limits
    the gain."""
    cone: Cone = Cone()
    """Directions in which the head may look."""
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
                "below 0.5 and the loop would oscillate; lower the gain"
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
        """Return the pan and tilt from the middle to a point; None if the Jacobian is singular.

        The point is (2,) in normalised coordinates, at angles (2,) in radians.
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
        move = _shortened(inside - state.angles, self.rate_limit * self.interval)
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


def _shortened(vector: FloatArray, most: float) -> FloatArray:
    """Return the vector, shortened to a length of ``most``."""
    length = float(np.hypot(*vector))
    return vector if length <= most else np.asarray(vector * (most / length))


_STEPS, _CLOSE, _WIDEST = 8, 1e-6, math.pi / 2
"""Most Newton steps, length below which they have converged, and largest length, in radians."""


def sighted_angles(
    camera: CalibratedCamera, place: npt.ArrayLike, pixel: npt.ArrayLike, guess: npt.ArrayLike
) -> FloatArray | None:
    """Return (2,) pan and tilt in radians at which a pixel shows a place of the wall.

    It is None if the pixel shows it at no angles near the guess, or a number is not finite.

    ``camera``: the camera; ``place`` (2,): phi and z; ``pixel`` (2,): column and row; ``guess``
    (2,): pan and tilt to begin from, in radians, such as those of the frame before.

    Notes
    -----
    Newton's method on the two normalised coordinates with the Jacobian of pan and tilt. An error
    of the angles at which the patch was picked stays in all later ones.
    """
    seen, angles = np.asarray(pixel, dtype=np.float64), np.asarray(guess, dtype=np.float64)
    where = np.asarray(place, dtype=np.float64)
    if not all(each.shape == (2,) and np.isfinite(each).all() for each in (seen, angles, where)):
        return None
    wanted = camera.lens.normalised(seen)
    point = wall_point(float(where[0]), float(where[1]), camera.radius)
    for _ in range(_STEPS):
        x, y, depth = camera.mount.pose(*angles.tolist()).to_camera(point)
        if not depth > 0:
            return None
        now = np.array([x, y]) / depth
        jacobian = pan_tilt_jacobian(
            now,
            float(angles[1]),
            lever=camera.mount.lever,
            depth=float(depth),
            camera=camera.mount.camera,
        )
        move = rates_for(jacobian, wanted - now)
        if move is None or not np.hypot(*move) < _WIDEST:
            return None
        angles = angles + move
        if np.hypot(*move) < _CLOSE:
            return angles
    return None


_LEAST_SHARE = 1e-3
"""Smallest over largest singular value, below which a Jacobian counts as singular."""


def _rotation_columns(point: npt.ArrayLike) -> FloatArray:
    """Return (2, 3) rates of a (2,) point for angular velocities of 1 rad/s about x, y, z."""
    x, y = np.asarray(point, dtype=np.float64)
    return np.array([[x * y, -(1 + x * x), y], [1 + y * y, -x * y, -x]])


def _translation_columns(point: npt.ArrayLike, depth: float) -> FloatArray:
    """Return (2, 3) rates of a (2,) point at a depth in metres for 1 m/s along x, y, z.

    Raises a `ParameterError` if the depth is not positive; it may be infinite.
    """
    if not depth > 0:
        raise ParameterError(f"a point at depth {depth} m is not in front of the camera")
    x, y = np.asarray(point, dtype=np.float64)
    return np.array([[-1.0, 0.0, x], [0.0, -1.0, y]]) / depth


def pan_tilt_jacobian(
    point: npt.ArrayLike,
    tilt: float,
    *,
    lever: float,
    depth: float,
    camera: FloatArray,
) -> FloatArray:
    """Return (2, 2) rates of a point for 1 rad/s of pan and of tilt.

    Raises a `ParameterError` if the depth is not positive.

    ``point`` (2,): normalised coordinates. ``tilt``: of the head, in radians. ``lever``: from the
    pivot to the lens along the optical axis, in metres. ``depth``: of the point along the optical
    axis, in metres. ``camera`` (3, 3): rotation from the camera to the joints, see `Mount.camera`.
    """
    # The velocity of the lens is the angular velocity crossed with the lever along z.
    carried = lever * np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    columns = _rotation_columns(point) + _translation_columns(point, depth) @ carried
    rates: FloatArray = columns @ (camera.T @ body_rates(tilt))
    return rates


def rates_for(jacobian: npt.ArrayLike, motion: npt.ArrayLike) -> FloatArray | None:
    """Return (2,) rates of pan and tilt that move a point by a (2,) motion; None if impossible.

    With a tilt of a quarter turn, pan turns about the optical axis; a point in the middle of the
    image can then move in one direction only.
    """
    matrix = np.asarray(jacobian, dtype=np.float64)
    values = np.linalg.svd(matrix, compute_uv=False) if np.isfinite(matrix).all() else np.zeros(2)
    if not values[1] > _LEAST_SHARE * values[0]:
        return None
    return np.asarray(np.linalg.solve(matrix, np.asarray(motion, dtype=np.float64)))


def wall_depth(camera: CalibratedCamera, point: npt.ArrayLike, pan: float, tilt: float) -> float:
    """Return the depth of the wall at a (2,) point, along the optical axis, in metres.

    Raises a `ParameterError` if the lens is not inside the pipe at this pan and tilt.
    """
    pose = camera.mount.pose(pan, tilt)
    x, y = np.asarray(point, dtype=np.float64)
    return float(meet_wall(pose.position, pose.rotation @ np.array([x, y, 1.0]), camera.radius)[2])


_STABLE = 0.9
"""Bound of integral gain times delay; with a pure delay the loop is stable below 0.94."""


@dataclass(frozen=True, eq=False)
class _HoldState:
    """State of a hold.

    ``angles`` (2,) are the joint angles that would centre the point, in radians, ``rates`` (2,)
    their rates, ``integral`` (2,) that of the angular error, in radian seconds; ``followed`` (2,)
    are the expected angles of joints that follow, ``wanted`` (2,) the last requested ones. The
    point has been lost for ``missed`` seconds.
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
    """Source of camera, interval, cone and rate limit; its gains are not used."""
    lead: float = 0.35
    """Delay of the wires, in seconds."""
    integral_gain: float = 2.0
    """Gain of the integral in 1/s; 0 switches it off."""
    near: float = math.radians(2.0)
    """Angular error in radians above which nothing is integrated: the head is on its way."""
    slip: float = math.radians(0.5)
    """Distance in radians of a joint from its expected angle, above which its error is not
    integrated: its wire is at a limit, or cools as fast as it can."""
    share: float = 0.5
    slope_share: float = 0.15
    """Weight of a new frame in the angles and in their rates, above 0 and up to 1."""
    patience: float = 0.4
    """Time in seconds for which the motion continues while the point is lost."""

    def __post_init__(self) -> None:
        most = _STABLE / (self.lead + self.servo.interval)
        if not 0 <= as_finite("integral_gain", self.integral_gain) < most:
            raise ParameterError(
                f"integral_gain is {self.integral_gain} 1/s; give 0 to below {most:.3g} 1/s, or "
                "the loop would oscillate with its delay"
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
        (2,): pan and tilt measured at the time of the image, in radians.
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
        move = _shortened(inside - state.wanted, self.servo.rate_limit * self.servo.interval)
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
        """Return the integral part of the angles (2,), with its lead if there is an error."""
        ahead = np.zeros(2) if error is None else self.lead * _shortened(error, self.near)
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
