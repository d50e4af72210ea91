"""Calibration of how a camera is mounted on its pan-tilt joints, from pictures of one target.

The target stands still. At pan and tilt of the joints, plus their zeros, the camera is turned by
``Ry(pan) Rx(tilt) Ry(squint) Rz(camera roll)``, and its lens is at
``Ry(pan) (apart z + Rx(tilt) lever)``, from a point on the axis of the pan (see
`minorloop_head.geometry`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from minorloop.arrays import FloatArray
from minorloop.errors import RecordError, counted
from minorloop_head.geometry import AXES, pan_tilt, rotation_x, rotation_y, rotation_z
from minorloop_head.vision.lens_calibration import TargetPose
from minorloop_head.vision.measured import Measured

_LEAST_POSES = 6
"""Fewest poses: each has six numbers, so that three determine the 13 unknowns, and three more show
whether they agree."""
_LEAST_RANGE = 10.0
"""Least range of each joint, in degrees."""
_LARGEST_MISFIT = 2.0
"""Largest rms difference between turns of camera and joints, in degrees."""
_LARGEST_SD = {"deg": 1.0, "mm": 1.0}
"""Largest standard deviations of results."""
_MOST_STEPS = 50
"""Largest number of steps of the fit; it needs about ten."""
_LEVER = slice(9, 12)
"""Positions of the vector from the pivot to the lens among the unknowns of the fit."""


@dataclass(frozen=True, eq=False)
class MountFit:
    """Mount of a camera on its joints."""

    measured: tuple[Measured, ...]
    lever: float
    """Distance from the pivot to the lens along the optical axis, in metres."""
    straight: tuple[float | None, float]
    """Readings of pan and tilt if the joints point along the pipe, in radians; pan is None if the
    target was not square to the pipe."""
    squint: float
    camera_roll: float
    """Rotation of the camera on the joints, in radians."""
    roll: float | None
    """Of the base about the axis of the pipe, in radians; None if the target was not square to the
    pipe."""
    offset: tuple[float, float] | None
    """Offset of the pivot from the middle of the target, in metres; None likewise."""
    joints: FloatArray
    """Shape (N, 2). Read less fitted pan and tilt of each picture, in degrees."""
    residuals: FloatArray
    """Shape (N,). Of each picture: normalised distance of its pose from the fit, about 1."""

    @property
    def rms(self) -> float:
        """Rms of read less fitted angles of the joints, in degrees."""
        return float(np.sqrt(np.square(self.joints).mean()))


def fit_mount(
    poses: Sequence[TargetPose],
    joints: FloatArray,
    *,
    sd: float = 0.1,
    middle: FloatArray | None = None,
) -> MountFit:
    """Fit lever, pivots and directions of a camera on its joints.

    Raises a `RecordError` if there are too few pictures, the joints did not move enough, or camera
    and joints turned by different angles.

    ``poses``: of a target at rest; ``joints`` (N, 2): readings of pan and tilt, in degrees;
    ``sd``: standard deviation of a reading, in degrees; ``middle`` (2,): place on the target, in
    metres, that is on the axis of the pipe, if the target is square to the pipe with its rows
    horizontal.
    """
    read = np.asarray(joints, dtype=np.float64)
    _check(poses, read)
    angles = np.radians(read)
    start = _start(poses, angles)
    roots = [np.linalg.cholesky(pose.information).T for pose in poses]
    spread = np.radians(sd)

    def misfit(x: FloatArray) -> FloatArray:
        off = x[13:].reshape(-1, 2)
        parts = [off.ravel() / spread]
        for pose, root, at in zip(poses, roots, angles + off, strict=True):
            rotation, position = _predicted(x, at)
            turn = Rotation.from_matrix(pose.rotation @ rotation.T).as_rotvec()
            parts.append(root @ np.concatenate([turn, pose.position - position]))
        return np.concatenate(parts)

    scale = np.concatenate([np.full(3, 0.1), np.full(3, 0.01), np.full(3, 0.1), np.full(4, 0.01)])
    scales = np.concatenate([scale, np.full(read.size, spread)])
    begin = np.concatenate([start, np.zeros(read.size)])
    found = least_squares(misfit, begin, x_scale=scales, max_nfev=_MOST_STEPS)
    x = found.x
    freedom = max(6 * len(poses) - 13, 1)
    jacobian = np.asarray(found.jac)
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * max(2 * found.cost / freedom, 1.0)
    off = x[13:].reshape(-1, 2)
    each = found.fun[read.size :].reshape(-1, 6)
    return _result(x, covariance, -np.degrees(off), np.sqrt((each**2).mean(axis=1)), middle)


def _predicted(x: FloatArray, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return rotation and position of the target in the camera for joint angles (2,) in radians."""
    target = Rotation.from_rotvec(x[:3]).as_matrix()
    zero, squint, roll = x[6:9]
    link = pan_tilt(at[0], at[1])
    camera = link @ _in_link(zero, squint, roll)
    lens = link @ x[_LEVER] + x[12] * rotation_y(at[0])[:, 2]
    return camera.T @ target, camera.T @ (x[3:6] - lens)


def _in_link(zero: float, squint: float, roll: float) -> FloatArray:
    """Return the rotation from the camera to the link that the tilt turns."""
    return rotation_x(zero) @ rotation_y(squint) @ rotation_z(roll)


def _check(poses: Sequence[TargetPose], joints: FloatArray) -> None:
    if len(poses) < _LEAST_POSES:
        raise RecordError(
            f"{counted(len(poses), 'picture')} with a target at known joint angles; give "
            f"{_LEAST_POSES} or more"
        )
    moved = np.ptp(joints, axis=0)
    turned = _turns([pose.rotation.T for pose in poses])
    said = _turns([pan_tilt(*np.radians(at)) for at in joints])
    least = np.maximum(np.linalg.norm(said, axis=1).sum(), 1e-9)
    ratio = float(np.linalg.norm(turned, axis=1).sum() / least)
    if 40 < ratio < 80:
        raise RecordError(
            f"the camera turned {ratio:.0f} times as far as the angles say, which seem to be in "
            "radians; give them in degrees"
        )
    for axis, extent in zip(AXES, moved, strict=True):
        if extent < _LEAST_RANGE:
            raise RecordError(
                f"the {axis} of the pictures is within {extent:.2g} degrees; take pictures over "
                f"{_LEAST_RANGE:g} degrees or more"
            )
    if np.linalg.svd(said, compute_uv=False)[1] < np.radians(_LEAST_RANGE):
        raise RecordError(
            "pan and tilt changed only together; take pictures at several tilts for each pan"
        )
    camera, misfit = Rotation.align_vectors(said, turned)
    misfit /= np.sqrt(len(poses))
    # If one sign is wrong, a camera that looks backwards fits.
    if np.degrees(misfit) > _LARGEST_MISFIT or camera.as_matrix()[2, 2] < 0:
        raise RecordError(
            f"camera and joints turned differently (by {np.degrees(misfit):.2g} degrees rms, or in "
            "opposite directions); check units, signs (pan to the right and tilt up are "
            "positive), the order of the pictures, and that the target stood still"
        )


def _turns(rotations: Sequence[FloatArray]) -> FloatArray:
    """Return rotation vectors (N, 3) of rotations since the first, in the frame of their source."""
    return np.array([Rotation.from_matrix(rotations[0].T @ each).as_rotvec() for each in rotations])


def _start(poses: Sequence[TargetPose], angles: FloatArray) -> FloatArray:
    """Return parameters (13,) for exact angles: rotations first, then lengths by least squares."""
    links = [pan_tilt(*at) for at in angles]
    turned = _turns([pose.rotation.T for pose in poses])
    camera = Rotation.align_vectors(_turns(links), turned)[0]
    inner = camera.as_matrix()
    zero, squint, roll = camera.as_euler("XYZ")
    target = Rotation.from_matrix(
        [link @ inner @ pose.rotation for link, pose in zip(links, poses, strict=True)]
    ).mean()
    rows, values = [], []
    for link, at, pose in zip(links, angles, poses, strict=True):
        # Target less lens, in the base: place - link lever - apart z of the pan.
        rows.append(np.column_stack([np.eye(3), -link, -rotation_y(at[0])[:, 2]]))
        values.append(link @ inner @ pose.position)
    lengths = np.linalg.lstsq(np.concatenate(rows), np.concatenate(values), rcond=None)[0]
    return np.concatenate([target.as_rotvec(), lengths[:3], [zero, squint, roll], lengths[3:]])


def _result(
    x: FloatArray,
    covariance: FloatArray,
    joints: FloatArray,
    residuals: FloatArray,
    middle: FloatArray | None,
) -> MountFit:
    """Return the mount by parameters of the fit, with deviations by linear propagation."""

    def derived(x: FloatArray) -> FloatArray:
        zero, squint, roll = x[6:9]
        axis = _in_link(zero, squint, roll)[:, 2]
        lever = x[_LEVER]
        along = float(lever @ axis)
        side = _in_link(zero, squint, roll).T @ (lever - along * axis)
        own = [along, side[0], side[1], x[12], zero, squint, roll]
        if middle is None:
            return np.array(own)
        target = Rotation.from_rotvec(x[:3])
        roll, lean, pan = target.inv().as_euler("ZXY")
        pivot = -target.inv().apply(x[3:6]) - [*middle, 0.0]
        return np.array([*own, pan, roll, lean, *pivot])

    values = derived(x)
    step = 1e-6
    slopes = np.array(
        [(derived(x + step * unit) - values) / step for unit in np.eye(len(x))[:13]]
    ).T
    sds = np.sqrt(np.einsum("ij,jk,ik->i", slopes, covariance[:13, :13], slopes))
    names = [
        ("lever", "mm"), ("lens right of the axis", "mm"), ("lens below the axis", "mm"),
        ("tilt axis before the pan axis", "mm"), ("tilt where level", "deg"), ("squint", "deg"),
        ("camera roll", "deg"), ("pan where straight", "deg"), ("roll of the base", "deg"),
        ("lean of the base", "deg"), ("pivot right of the axis", "mm"),
        ("pivot below the axis", "mm"), ("target before the pivot", "mm"),
    ]  # fmt: skip
    measured = []
    for (name, unit), value, sd in zip(names, values, sds, strict=False):
        scale = 1e3 if unit == "mm" else np.degrees(1.0)
        sign = -1 if name in ("tilt where level", "pan where straight") else 1
        sign = -1 if name == "target before the pivot" else sign
        measured.append(Measured(name, float(sign * scale * value), float(scale * sd), unit))
    vague = [each.name for each in measured if each.sd > _LARGEST_SD[each.unit]]
    if vague:
        raise RecordError(
            f"the pictures do not determine the {vague[0]}; take some at more angles of both joints"
        )
    known = len(values) > 7
    return MountFit(
        measured=tuple(measured),
        lever=float(values[0]),
        straight=(-float(values[7]) if known else None, -float(values[4])),
        squint=float(values[5]),
        camera_roll=float(values[6]),
        roll=float(values[8]) if known else None,
        offset=(float(values[10]), float(values[11])) if known else None,
        joints=joints,
        residuals=residuals,
    )
