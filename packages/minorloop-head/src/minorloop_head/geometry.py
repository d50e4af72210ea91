"""Rays, cylinders, pinhole cameras and rotations, for twins and estimators alike.

Two coordinate frames are used. In the camera's, x points right, y down and z along the optical
axis. In the pipe's, z is the axis of the pipe, and a point of the wall is (phi, z), at
``(R cos phi, R sin phi, z)``. The head turns about a pivot: first the tilt about the x axis of
the camera, then the pan about the y axis of the base, so R = Ry(pan) Rx(tilt). Positive pan looks
right and positive tilt looks up; both are zero along the pipe. Lengths are in metres, angles in
radians.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_finite
from minorloop.errors import ParameterError
from minorloop_head.distortion import DISTORTION, distorted

AXES = ("pan", "tilt")
"""Names of the axes of the head, in the order of all arrays with one entry an axis."""
REACH = float(np.radians(30.0))
"""Half-angle of the cone of allowed lines of sight; beyond, the lens touches the wall."""
WATER_INDEX = 1.333
"""Refractive index of water, at 20 degrees Celsius and 589 nm; it varies by 0.005 from 0 to 60
degrees and from red to blue."""
_NEWTON_STEPS = 40
"""Most steps of `Pinhole.undistort`. It takes 4 to 6 for coefficients from -0.5 to 0.3; the
bound only ends a search that has no solution."""

_PORT_SAMPLES = 200
"""Number of radii at which the distortion by a flat port is fitted; 50 change it by 0.01 pixel."""

_TURN, _LONGEST_STEP, _ON_PLACE = 1e-6, 0.2, 1e-9
"""Step of numerical derivatives and longest Newton step, both in radians, and tolerance of the
place of the tool, in metres."""


def rotation_x(angle: float) -> FloatArray:
    """Return the (3, 3) rotation about x by an angle in radians."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def rotation_y(angle: float) -> FloatArray:
    """Return the (3, 3) rotation about y by an angle in radians."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def rotation_z(angle: float) -> FloatArray:
    """Return the (3, 3) rotation about z by an angle in radians."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def pan_tilt(pan: float, tilt: float) -> FloatArray:
    """Return the (3, 3) rotation Ry(pan) Rx(tilt) from the camera to the base."""
    return rotation_y(pan) @ rotation_x(tilt)


def pan_tilt_of(axis: npt.ArrayLike) -> tuple[float, float]:
    """Return pan and tilt, in radians, that turn the optical axis to a (3,) direction."""
    x, y, z = np.asarray(axis, dtype=np.float64)
    return float(np.arctan2(x, z)), float(np.arctan2(-y, np.hypot(x, z)))


def _turned_onto(own: npt.ArrayLike, way: npt.ArrayLike) -> tuple[float, float] | None:
    """Return pan and tilt, in radians, that turn a (3,) direction of the head onto another.

    It is None if no tilt reaches it. ``own`` (3,): fixed to the head, ahead of it; ``way`` (3,): in
    the base.
    """
    x, y, z = np.asarray(own, dtype=np.float64) / np.linalg.norm(own)
    right, down, ahead = np.asarray(way, dtype=np.float64) / np.linalg.norm(way)
    height = np.hypot(y, z)
    if abs(down) > height:
        return None
    turn = np.arccos(down / height)  # of (y, z) about x, from the y axis
    pan = np.arctan2(right, ahead) - np.arctan2(x, height * np.sin(turn))
    return float(pan), float(turn - np.arctan2(z, y))


def body_rates(tilt: float) -> FloatArray:
    """Return the (3, 2) matrix from the rates of pan and tilt to the angular velocity.

    The angular velocity is that of the camera, in its own frame, from R^T dR of
    R = Ry(pan) Rx(tilt).
    """
    return np.array([[0.0, 1.0], [np.cos(tilt), 0.0], [-np.sin(tilt), 0.0]])


@dataclass(frozen=True, eq=False)
class Pose:
    """Position and orientation of a camera in the pipe."""

    rotation: FloatArray
    """Shape (3, 3). Rotation from the camera to the pipe."""
    position: FloatArray
    """Shape (3,). Centre of the lens in the pipe, in metres."""

    def to_pipe(self, points: npt.ArrayLike) -> FloatArray:
        """Return points (..., 3) of the camera in the pipe."""
        moved: FloatArray = np.asarray(points, dtype=np.float64) @ self.rotation.T + self.position
        return moved

    def to_camera(self, points: npt.ArrayLike) -> FloatArray:
        """Return points (..., 3) of the pipe in the camera."""
        moved: FloatArray = (np.asarray(points, dtype=np.float64) - self.position) @ self.rotation
        return moved


@dataclass(frozen=True)
class Mount:
    """Place of the head in the pipe.

    Raises a `ParameterError` if a number is not finite.
    """

    lever: float = 8e-3
    """Distance from the pivot to the lens along the optical axis, in metres."""
    offset: tuple[float, float] = (0.0, 0.0)
    """Offset of the pivot from the axis, along x and y of the pipe, in metres."""
    roll: float = 0.0
    """Roll of the base about the axis of the pipe, in radians."""
    advance: float = 0.0
    """Position of the pivot along the pipe, in metres."""
    squint: float = 0.0
    camera_roll: float = 0.0
    """Rotation of the camera on the joints: sideways, then about its optical axis, in radians."""

    def __post_init__(self) -> None:
        for name, value in (
            ("lever", self.lever),
            ("offset along x", self.offset[0]),
            ("offset along y", self.offset[1]),
            ("roll", self.roll),
            ("advance", self.advance),
            ("squint", self.squint),
            ("camera roll", self.camera_roll),
        ):
            as_finite(name, value)

    @property
    def camera(self) -> FloatArray:
        """(3, 3) rotation from the camera to the joints."""
        return rotation_y(self.squint) @ rotation_z(self.camera_roll)

    def pose(self, pan: float, tilt: float) -> Pose:
        """Return the pose of the camera at a pan and a tilt, in radians."""
        from minorloop_head import _geometry_kernels as kernels  # a supervisor needs no kernels

        place = self.lever, *self.offset, self.advance, self.roll, self.squint, self.camera_roll
        return Pose(*kernels.pose(pan, tilt, *place))

    def aim(self, point: npt.ArrayLike) -> tuple[float, float]:
        """Return pan and tilt, in radians, that centre a (3,) point of the pipe in the image.

        The lens is on the line from the pivot, so the lever does not matter. If no tilt reaches the
        point, the angles are the nearest ones.
        """
        way = self.way_to(point)
        return _turned_onto(self.camera[:, 2], way) or pan_tilt_of(way)

    def way_to(self, point: npt.ArrayLike) -> FloatArray:
        """Return the (3,) way from the pivot to a (3,) point of the pipe, in the base."""
        pivot = np.array([self.offset[0], self.offset[1], self.advance])
        way: FloatArray = (np.asarray(point, dtype=np.float64) - pivot) @ rotation_z(self.roll)
        return way


@dataclass(frozen=True)
class Probe:
    """An ultrasonic disc on the head, whose beam passes through the pivot.

    Raises a `ParameterError` if the squint is not between 0 and a right angle, the azimuth not
    finite, or a length not positive.

    Notes
    -----
    With the default squint and azimuth the beam is normal to the wall at a pan of -20 degrees, on
    the side where the wires are coldest: water cools them so much that they reach little more. The
    default face leaves 8 mm of water.
    """

    squint: float = float(np.radians(70.0))
    """Angle of the beam off the optical axis, in radians."""
    azimuth: float = float(np.pi)
    """Direction of the beam about the optical axis of the camera, from its x axis to its y axis, in
    radians."""
    face: float = 2e-3
    """Distance from the pivot to the face of the disc along the beam, in metres."""
    aperture: float = 5e-3
    """Diameter of the disc, in metres."""
    focus: float = 8e-3
    """Focal length of its lens in water, in metres; infinite without a lens."""

    def __post_init__(self) -> None:
        if not 0 < self.squint < np.pi / 2:
            raise ParameterError(f"squint {self.squint} rad; give an angle between 0 and pi/2")
        as_finite("azimuth", self.azimuth)
        if not (self.face > 0 and self.aperture > 0 and self.focus > 0):
            raise ParameterError(
                f"a probe with its face at {self.face} m, aperture {self.aperture} m and focus "
                f"{self.focus} m; give positive lengths"
            )

    def beam(self, mount: Mount, pan: float, tilt: float) -> tuple[FloatArray, FloatArray]:
        """Return the centre (3,) of the face and the direction (3,) of the beam, in the pipe."""
        along = mount.pose(pan, tilt).rotation @ self._direction
        pivot = np.array([mount.offset[0], mount.offset[1], mount.advance])
        return pivot + self.face * along, along

    def aim(self, mount: Mount, point: npt.ArrayLike) -> tuple[float, float]:
        """Return pan and tilt, in radians, that aim the beam at a (3,) point of the pipe.

        Raises a `ParameterError` if there are none; turn the roll of the mount towards the point
        then.
        """
        return self._turned(mount, mount.way_to(point))

    def moved(self, mount: Mount, pan: float, tilt: float, other: Mount) -> tuple[float, float]:
        """Return pan and tilt of the same beam at another roll of the mount.

        Raises a `ParameterError` if there are none.
        """
        along = self.beam(mount, pan, tilt)[1]
        return self._turned(other, along @ rotation_z(other.roll))

    def perpendicular(self, mount: Mount, tilt: float) -> float:
        """Return the pan at which, with a tilt, the beam is at a right angle to the pipe."""
        x, _, z = rotation_x(tilt) @ mount.camera @ self._direction
        return float(np.arctan2(np.copysign(1.0, x) * z, abs(x)))

    def _turned(self, mount: Mount, way: FloatArray) -> tuple[float, float]:
        """Return pan and tilt that send the beam along a (3,) direction of the base."""
        found = _turned_onto(mount.camera @ self._direction, way)
        if found is None:
            off = np.degrees(np.arcsin(way[1] / np.linalg.norm(way)))
            raise ParameterError(
                f"no tilt sends the beam {off:.3g} degrees off the plane of "
                "the pan; turn the roll of the mount towards the point"
            )
        return found

    @property
    def _direction(self) -> FloatArray:
        """(3,) direction of the beam in the camera."""
        side = np.array([np.cos(self.azimuth), np.sin(self.azimuth), 0.0])
        axis = np.array([0.0, 0.0, 1.0])
        return np.asarray(np.sin(self.squint) * side + np.cos(self.squint) * axis)


@dataclass(frozen=True)
class Tool:
    """A micro-tool beside the lens, whose point extends along a straight line.

    Raises a `ParameterError` if a number is not finite, or the longest extension not positive.

    Notes
    -----
    With the default slope the way crosses the optical axis 35 mm ahead, so that the point of
    contact is in view wherever the tool reaches the wall.
    """

    offset: tuple[float, float, float] = (0.0, 3.5e-3, 0.0)
    """Position of its withdrawn point in the camera, in metres."""
    slope: tuple[float, float] = (0.0, -0.1)
    """Slope of its way: metres to the right and down per metre along the optical axis."""
    longest: float = 25e-3
    """Longest extension, in metres."""

    def __post_init__(self) -> None:
        for value in (*self.offset, *self.slope):
            as_finite("offset or slope of the tool", value)
        if not 0 < self.longest < np.inf:
            raise ParameterError(
                f"longest extension of the tool is {self.longest} m; give a positive length"
            )

    def meet(self, mount: Mount, pan: float, tilt: float, radius: float) -> FloatArray:
        """Return phi, z and extension (3,) at which the tool meets the wall of a pipe.

        Raises a `ParameterError` if its point is not inside the pipe when it is drawn in.
        """
        pose = mount.pose(pan, tilt)
        way = np.array([*self.slope, 1.0])
        start = pose.to_pipe(np.array(self.offset))
        return meet_wall(start, pose.rotation @ (way / np.linalg.norm(way)), radius)

    def through(self, point: npt.ArrayLike) -> Tool:
        """Return the tool moved sideways, so that its way leads through a point (3,) in metres."""
        x, y, z = self.offset
        u, v, depth = np.asarray(point, dtype=np.float64).tolist()
        right, down = self.slope
        x += u - x - right * (depth - z)
        y += v - y - down * (depth - z)
        return replace(self, offset=(x, y, z))

    def between(self, other: Tool, share: float) -> Tool:
        """Return the tool with its offset moved by a share of the way to that of another."""
        mine, its = np.array(self.offset), np.array(other.offset)
        x, y, z = (mine + share * (its - mine)).tolist()
        return replace(self, offset=(x, y, z))

    def aim(
        self, mount: Mount, place: npt.ArrayLike, radius: float, guess: npt.ArrayLike
    ) -> FloatArray | None:
        """Return pan and tilt (2,) in radians at which the tool meets a place of the wall.

        It is None if no angles near the guess reach it.

        ``place`` (2,): phi and z; ``radius``: of the pipe, in metres; ``guess`` (2,): pan and tilt
        to begin from, in radians.

        Notes
        -----
        Newton's method with differences.
        """
        wanted, angles = np.asarray(place, dtype=np.float64), np.asarray(guess, dtype=np.float64)
        try:
            for _ in range(_NEWTON_STEPS):
                off = self._off(mount, angles, wanted, radius)
                if not np.isfinite(off).all():
                    return None
                if np.hypot(*off) < _ON_PLACE:
                    return angles
                columns = [
                    (self._off(mount, angles + turn, wanted, radius) - off) / _TURN
                    for turn in _TURN * np.eye(2)
                ]
                step = np.linalg.solve(np.stack(columns, axis=-1), -off)
                angles = angles + step * min(1.0, _LONGEST_STEP / max(np.hypot(*step), 1e-12))
        except (ParameterError, np.linalg.LinAlgError):
            return None
        return None

    def _off(
        self, mount: Mount, angles: FloatArray, place: FloatArray, radius: float
    ) -> FloatArray:
        """Return the offset of the contact of the tool from a place, in metres around and along."""
        phi, z, _ = self.meet(mount, float(angles[0]), float(angles[1]), radius)
        return np.array([radius * float(wrapped(phi - place[0])), z - place[1]])


@dataclass(frozen=True)
class Pinhole:
    """A camera with radial and tangential distortion.

    Raises a `ParameterError` if a size or a focal length is not positive, or the distortion folds
    the image.
    """

    width: int = 640
    height: int = 480
    """Size of the image, in pixels; the centre of the first pixel is (0, 0)."""
    focal: float = 520.0
    """Focal length along the rows, in pixels."""
    centre: tuple[float, float] = (319.5, 239.5)
    """Principal point (u, v), in pixels."""
    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    """Radial distortion: x_d = x (1 + k1 r^2 + k2 r^4 + k3 r^6)."""
    p1: float = 0.0
    p2: float = 0.0
    """Tangential distortion, see `distorted`."""
    aspect: float = 1.0
    """Focal length along the columns over that along the rows: 1 if pixels are square."""

    def __post_init__(self) -> None:
        if (
            self.width < 1
            or self.height < 1
            or not (0 < min(self.focals) <= max(self.focals) < np.inf)
        ):
            raise ParameterError(
                f"a camera of {self.width} by {self.height} pixels and focal lengths "
                f"{self.focals}; give positive numbers"
            )
        ways = self._corners() * np.linspace(0.0, 1.05, 64)[:, None, None]
        _, _, across, both, down = distorted(ways[..., 0], ways[..., 1], *self.distortion)
        if not (across * down - both**2).min() > 0:  # so that NaN is refused
            named = ", ".join(f"{name} {getattr(self, name):g}" for name in DISTORTION)
            raise ParameterError(f"distortion {named} folds the image; give smaller numbers")

    @property
    def focals(self) -> tuple[float, float]:
        """Focal lengths along rows and columns, in pixels."""
        return self.focal, self.focal * self.aspect

    @property
    def distortion(self) -> tuple[float, float, float, float, float]:
        """k1, k2, k3, p1 and p2."""
        return self.k1, self.k2, self.k3, self.p1, self.p2

    def distort(self, points: npt.ArrayLike) -> FloatArray:
        """Return normalised coordinates (..., 2) after distortion."""
        plain = np.asarray(points, dtype=np.float64)
        moved = distorted(plain[..., 0], plain[..., 1], *self.distortion)[:2]
        return np.stack(moved, axis=-1)

    def undistort(self, points: npt.ArrayLike) -> FloatArray:
        """Invert ``distort``, by Newton's method."""
        wanted = np.asarray(points, dtype=np.float64)
        x, y = (wanted[..., k].copy() for k in (0, 1))
        for _ in range(_NEWTON_STEPS):
            u, v, across, both, down = distorted(x, y, *self.distortion)
            u, v = u - wanted[..., 0], v - wanted[..., 1]
            slope = np.maximum(across * down - both**2, 0.1)
            step = np.stack([down * u - both * v, across * v - both * u]) / slope
            x, y = x - step[0], y - step[1]
            if np.abs(step).max(initial=0.0) < 1e-15:
                break
        return np.stack([x, y], axis=-1)

    def project(self, points: npt.ArrayLike) -> FloatArray:
        """Return pixels (..., 2) of points (..., 3) in the camera; NaN behind it."""
        x = np.asarray(points, dtype=np.float64)
        depth = np.where(x[..., 2:] > 0, x[..., 2:], np.nan)
        return self.pixels(x[..., :2] / depth)

    def pixels(self, points: npt.ArrayLike) -> FloatArray:
        """Return pixels (..., 2) of normalised coordinates (..., 2)."""
        moved: FloatArray = self.distort(points) * self.focals + np.asarray(self.centre)
        return moved

    def normalised(self, pixels: npt.ArrayLike) -> FloatArray:
        """Return normalised coordinates (..., 2), without distortion, of pixels (..., 2)."""
        seen = np.asarray(pixels, dtype=np.float64)
        return self.undistort((seen - np.asarray(self.centre)) / self.focals)

    def off_axis(self, points: npt.ArrayLike) -> float:
        """Return the distance of normalised coordinates (2,) from the image centre, in pixels."""
        return float(np.hypot(*(np.asarray(points) * self.focals)))

    def rays(self, pixels: npt.ArrayLike) -> FloatArray:
        """Return directions (..., 3) in the camera, with z = 1, of pixels (..., 2)."""
        plain = self.normalised(pixels)
        return np.concatenate([plain, np.ones_like(plain[..., :1])], axis=-1)

    def scaled(self, factor: float) -> Pinhole:
        """Return the same camera with pixels ``1 / factor`` times as large."""
        u, v = self.centre
        return replace(
            self,
            width=round(self.width * factor),
            height=round(self.height * factor),
            focal=self.focal * factor,
            centre=((u + 0.5) * factor - 0.5, (v + 0.5) * factor - 0.5),
        )

    def in_water(self) -> Pinhole:
        """Return the lens that is equivalent to this one behind a flat port in water.

        Notes
        -----
        The port is thin and touches the lens. Snell's law is a radial distortion: a ray at x in
        the air behind the port is x / sqrt(n^2 + (n^2 - 1) r^2) in the water. The radial
        coefficients follow it within 0.1 pixel, for the documented lens and field of view, which
        is narrower by a factor of about 1.33; the tangential ones grow by as much.
        """
        edge = float(np.linalg.norm(self._corners(), axis=-1).max())
        reach = np.linspace(0.0, edge, _PORT_SAMPLES)[1:]
        radial = replace(self, p1=0.0, p2=0.0)
        air = radial.undistort(np.stack([reach, 0 * reach], axis=-1))[:, 0]
        water = air / np.sqrt(WATER_INDEX**2 + (WATER_INDEX**2 - 1) * air**2)
        powers = water[:, None] ** np.array([1, 3, 5, 7] if self.k3 else [1, 3, 5])
        first, *more = np.linalg.lstsq(powers, reach, rcond=None)[0].tolist()
        bent = dict(zip(("k1", "k2", "k3"), (each / first for each in more), strict=False))
        p1, p2 = self.p1 * first, self.p2 * first
        return replace(self, focal=self.focal * first, **bent, p1=p1, p2=p2)

    def _corners(self) -> FloatArray:
        """Return the corners (4, 2) of the image, in normalised distorted coordinates."""
        ends = np.array([(u, v) for v in (0, self.height - 1) for u in (0, self.width - 1)])
        return np.asarray((ends - self.centre) / self.focals)


def meet_wall(origin: npt.ArrayLike, directions: npt.ArrayLike, radius: float) -> FloatArray:
    """Intersect rays from inside a pipe with its wall.

    Returns phi in (-pi, pi], z in metres, and the length along the ray in units of the direction
    (..., 3); infinite along the axis.

    Raises a `ParameterError` if the origin is not inside the pipe.

    ``origin`` (3,): start of the rays, inside the pipe; ``directions`` (..., 3): in the pipe, of
    any length; ``radius``: of the pipe, in metres.

    Notes
    -----
    The positive root of a s^2 + 2 b s + c = 0 with the components across the axis.
    """
    x0, y0, z0 = np.asarray(origin, dtype=np.float64)
    inside = x0 * x0 + y0 * y0 - radius**2
    if not inside < 0:
        raise ParameterError(
            f"the camera is {np.hypot(x0, y0):.4g} m off the axis of a pipe of radius "
            f"{radius:.4g} m; it must be inside"
        )
    d = np.asarray(directions, dtype=np.float64)
    a = d[..., 0] ** 2 + d[..., 1] ** 2
    b = x0 * d[..., 0] + y0 * d[..., 1]
    # The form without a in the denominator stays accurate along the axis.
    denominator = b + np.sqrt(b * b - a * inside)
    with np.errstate(divide="ignore", invalid="ignore"):
        length = np.where(denominator > 0, -inside / denominator, np.inf)
        phi = np.arctan2(y0 + length * d[..., 1], x0 + length * d[..., 0])
        z = np.where(d[..., 2] == 0, z0, z0 + length * d[..., 2])
    return np.stack([phi, z, length], axis=-1)


def wall_point(phi: npt.ArrayLike, z: npt.ArrayLike, radius: float) -> FloatArray:
    """Return points (..., 3) of the wall at phi in radians and z in metres."""
    angle, along = np.broadcast_arrays(
        np.asarray(phi, dtype=np.float64), np.asarray(z, dtype=np.float64)
    )
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), along], axis=-1)


def wrapped(angle: npt.ArrayLike) -> FloatArray:
    """Return angles wrapped to [-pi, pi)."""
    turned: FloatArray = (np.asarray(angle, dtype=np.float64) + np.pi) % (2 * np.pi) - np.pi
    return turned


def wall_distance(one: npt.ArrayLike, other: npt.ArrayLike, radius: float) -> FloatArray:
    """Return distances in metres along the wall between places (..., 2) of phi and z."""
    a, b = np.asarray(one, dtype=np.float64), np.asarray(other, dtype=np.float64)
    apart = np.hypot(radius * wrapped(a[..., 0] - b[..., 0]), a[..., 1] - b[..., 1])
    return np.asarray(apart)


def wall_lengths(course: npt.ArrayLike, radius: float) -> FloatArray:
    """Return path lengths (N,) in metres along the wall from the first of places (N, 2)."""
    places = np.asarray(course, dtype=np.float64)
    return np.concatenate([[0.0], np.cumsum(wall_distance(places[1:], places[:-1], radius))])
