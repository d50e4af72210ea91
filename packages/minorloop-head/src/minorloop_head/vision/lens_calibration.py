"""Calibration of a lens, and of the places of LEDs, from pictures of a flat target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError, RecordError, counted
from minorloop_head.geometry import Pinhole
from minorloop_head.vision.calibrated_camera import Image
from minorloop_head.vision.imaging import opencv
from minorloop_head.vision.measured import Measured
from minorloop_head.vision.targets import SeenTarget

_LEAST_REFLECTIONS = 4
"""Fewest reflections: two determine the place of an LED, and more are needed to see that they are
those of one. In 20 sets of each count (seeds 1000 to 1019) the rms error is 0.24 mm with 2, 0.18
with 3, 0.10 with 4 and 0.08 with 8."""
_SATURATED, _LEAST_PIXELS = 250, 4
"""Grey level of a saturated pixel, which coding as JPEG may lower from 255; and pixels of a spot,
as a single one may be hot."""
_SECOND = 0.3
"""Largest share that the second largest saturated spot may have of the largest."""
FARTHEST = 0.05
"""Metres from the lens to an LED: more than the radius of any pipe that such a head enters by."""
_SPOT = 0.3
"""Standard deviation of the centre of a reflection, in pixels."""
_LARGEST_LED_SD, _LARGEST_CONDITION = 3e-3, 1e4
"""Of a position, in metres; and ratio of the best to the worst determined direction."""
_LARGEST_SPREAD = 5.0
"""Largest rms distance of reflections from the fit, in standard deviations."""
_LEAST_PICTURES = 8
"""Fewest pictures. In 20 sets of each count (seeds 1000 to 1019), none of 4 determines a lens, 17
of those with 6 do and all of those with 8, with an rms error of the focal length of 0.05 %; that
of 16 is 0.03 %."""
_LEAST_CORNERS = 8
"""Fewest corners in each ninth of the image."""
_TILTED, _LEAST_TILTED = 12.0, 3
"""Least angle in degrees of a picture that is not frontal, and how many there have to be."""
_LEAST_SPREAD = 0.2
"""Least share of the rarer direction of tilt."""
_LARGEST_SD = 3e-3
"""Largest relative uncertainty of the focal length."""
_OUTLIER = (4.0, 0.5)
"""Rms residual of a picture that moved: in medians of all, and at least so many pixels."""
_DOWN, _ACROSS = ("upper", "middle", "lower"), ("left", "centre", "right")


@dataclass(frozen=True, eq=False)
class TargetPose:
    """Pose of a target before the camera."""

    name: str
    """Of the picture."""
    rotation: FloatArray
    """Shape (3, 3). From the target (x right, y down, z away from the camera) to the camera."""
    position: FloatArray
    """Shape (3,). Of the target's upper left corner in the camera, in metres."""
    information: FloatArray
    """Shape (6, 6). Inverse covariance of a small rotation in radians, about axes of the camera,
    and of the position in metres."""
    residuals: FloatArray
    """Shape (N, 2). Seen less projected corners, in pixels."""

    @property
    def tilt(self) -> float:
        """Angle between the target and the image plane, in degrees."""
        return float(np.degrees(np.arccos(np.clip(self.rotation[2, 2], -1.0, 1.0))))


@dataclass(frozen=True, eq=False)
class LensFit:
    """A calibrated lens."""

    lens: Pinhole
    measured: tuple[Measured, ...]
    """Focal length, principal point and distortion."""
    poses: tuple[TargetPose, ...]
    """Of the pictures that were used."""
    seen: tuple[SeenTarget, ...]
    """Their corners."""
    left_out: dict[str, str]
    """Names of pictures that do not fit the others, and why."""
    rms: float
    """Of the distances between seen and projected corners, in pixels."""


def fit_lens(seen: Sequence[SeenTarget], size: tuple[int, int]) -> LensFit:
    """Fit focal length, principal point and radial distortion.

    Pictures in which the target moved are left out.

    ``seen``: pictures with a target; ``size``: width and height of the pictures, in pixels. Raises
    a `RecordError` if there are fewer than `_LEAST_PICTURES`, or they do not determine the lens;
    the message says what to photograph.

    References
    ----------
    Zhang, A flexible new technique for camera calibration, 2000.
    """
    if len(seen) < _LEAST_PICTURES:
        raise RecordError(
            f"{counted(len(seen), 'picture')} with a target; give {_LEAST_PICTURES} or more"
        )
    kept = list(seen)
    left_out: dict[str, str] = {}
    fit = _fit(kept, size, left_out)
    errors = np.array([_rms(pose.residuals) for pose in fit.poses])
    moved = errors > max(_OUTLIER[0] * float(np.median(errors)), _OUTLIER[1])
    if moved.any() and (~moved).sum() >= _LEAST_PICTURES:
        left_out = {
            each.name: f"its corners are off by {error:.1f} px; hold the target still"
            for each, error, bad in zip(kept, errors, moved, strict=True)
            if bad
        }
        kept = [each for each, bad in zip(kept, moved, strict=True) if not bad]
        fit = _fit(kept, size, left_out)
    missing = _what_is_missing(fit)
    if missing:
        raise RecordError(f"the pictures do not determine the lens: {'; '.join(missing)}")
    return fit


def corners_in_ninths(seen: Sequence[SeenTarget], lens: Pinhole) -> npt.NDArray[np.int64]:
    """Return how many corners are in each ninth of the image, (3, 3)."""
    pixels = np.concatenate([each.pixels for each in seen])
    counts, _, _ = np.histogram2d(
        pixels[:, 1],
        pixels[:, 0],
        bins=(np.linspace(-0.5, lens.height - 0.5, 4), np.linspace(-0.5, lens.width - 0.5, 4)),
    )
    ninths: npt.NDArray[np.int64] = counts.astype(np.int64)
    return ninths


def _what_is_missing(fit: LensFit) -> list[str]:
    """Return what to photograph, in addition, for the lens to be determined."""
    said = []
    counts = corners_in_ninths(fit.seen, fit.lens)
    for row, column in np.argwhere(counts < _LEAST_CORNERS):
        few = "no" if counts[row, column] == 0 else f"only {counts[row, column]}"
        where = f"{_DOWN[row]} {_ACROSS[column]}"
        said.append(f"{few} corners in the {where} ninth; photograph the target there")
    tilts = np.array([pose.tilt for pose in fit.poses])
    focal = fit.measured[0]
    if (tilts > _TILTED).sum() < _LEAST_TILTED or focal.sd > _LARGEST_SD * focal.value:
        said.append(
            f"the target is tilted by more than {_TILTED:g} degrees in "
            f"{counted(int((tilts > _TILTED).sum()), 'picture')}, and the focal length is known to "
            f"{100 * focal.sd / focal.value:.2g} %; tilt the target by 20 to 40 degrees, in "
            "different directions"
        )
    else:
        normals = np.array([pose.rotation[:2, 2] for pose in fit.poses])
        spread = (normals[tilts > _TILTED] ** 2).sum(axis=0)
        if spread.min() < _LEAST_SPREAD * spread.sum() / 2:
            about = "up and down" if spread[1] < spread[0] else "left and right"
            said.append(f"no target is tilted {about}; tilt it so by 20 to 40 degrees")
    return said


def target_pose(lens: Pinhole, seen: SeenTarget, sd: float) -> TargetPose:
    """Return the pose of a target in a picture of a calibrated lens.

    ``sd``: standard deviation of a coordinate of a corner, in pixels. Raises a `RecordError` if
    there is none.
    """
    cv2 = opencv()
    points = np.column_stack([seen.points, np.zeros(len(seen.points))])
    matrix, distortion = _camera(lens)
    good, turn, place = cv2.solvePnP(
        points, seen.pixels, matrix, distortion, flags=cv2.SOLVEPNP_IPPE
    )
    if not good:
        raise RecordError(f"{seen.name} shows a target in no possible pose; leave it out")
    turn, place = cv2.solvePnPRefineLM(points, seen.pixels, matrix, distortion, turn, place)
    return _pose(seen, points, turn, place, matrix, distortion, sd)


def _fit(seen: list[SeenTarget], size: tuple[int, int], left_out: dict[str, str]) -> LensFit:
    cv2 = opencv()
    points = [
        np.column_stack([each.points, np.zeros(len(each.points))]).astype(np.float32)
        for each in seen
    ]
    pixels = [each.pixels.astype(np.float32) for each in seen]
    width, height = size
    start = np.array([[width, 0, (width - 1) / 2], [0, width, (height - 1) / 2], [0, 0, 1.0]])
    rms, matrix, distortion, turns, places, sds, _, _ = cv2.calibrateCameraExtended(
        points,
        pixels,
        size,
        start,
        np.zeros(5),
        flags=cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K3,
    )
    sds, bent = sds.ravel(), distortion.ravel()
    try:
        lens = Pinhole(
            width,
            height,
            float(matrix[1, 1]),
            (float(matrix[0, 2]), float(matrix[1, 2])),
            float(bent[0]),
            float(bent[1]),
        )
    except ParameterError:
        raise RecordError(
            f"no lens fits the pictures (rms {rms:.2g} px); check kind and squares of the target, "
            "and photograph it in all parts of the image, tilted by 20 to 40 degrees"
        ) from None
    measured = (
        Measured("focal length", lens.focal, float(max(sds[:2])), "px"),
        Measured("principal point u", lens.centre[0], float(sds[2]), "px"),
        Measured("principal point v", lens.centre[1], float(sds[3]), "px"),
        Measured("distortion k1", lens.k1, float(sds[4]), ""),
        Measured("distortion k2", lens.k2, float(sds[5]), ""),
    )
    sd = rms / np.sqrt(2)
    poses = tuple(
        _pose(each, np.asarray(at, np.float64), turn, place, matrix, distortion, sd)
        for each, at, turn, place in zip(seen, points, turns, places, strict=True)
    )
    return LensFit(lens, measured, poses, tuple(seen), left_out, float(rms))


def _pose(
    seen: SeenTarget,
    points: FloatArray,
    turn: FloatArray,
    place: FloatArray,
    matrix: FloatArray,
    distortion: FloatArray,
    sd: float,
) -> TargetPose:
    cv2 = opencv()
    pixels, slopes = cv2.projectPoints(points, turn, place, matrix, distortion)
    rotation = np.asarray(cv2.Rodrigues(turn)[0], dtype=np.float64)
    moved = slopes[:, 3:6].reshape(-1, 2, 3)  # by the position
    arms = points @ rotation.T
    turned = np.cross(arms[:, None, :], moved)  # d pixel / d angle = arm x (d pixel / d position)
    both = np.concatenate([turned, moved], axis=-1).reshape(-1, 6) / sd
    return TargetPose(
        seen.name,
        rotation,
        np.asarray(place, dtype=np.float64).ravel(),
        both.T @ both,
        seen.pixels - pixels.reshape(-1, 2),
    )


def _camera(lens: Pinhole) -> tuple[FloatArray, FloatArray]:
    """Return matrix (3, 3) and distortion (5,) of a lens, as OpenCV has them."""
    u, v = lens.centre
    matrix = np.array([[lens.focal, 0.0, u], [0.0, lens.focal, v], [0.0, 0.0, 1.0]])
    return matrix, np.array([lens.k1, lens.k2, 0.0, 0.0, 0.0])


def _rms(residuals: FloatArray) -> float:
    return float(np.sqrt((residuals**2).sum(axis=1).mean()))


def find_reflection(image: Image) -> FloatArray | None:
    """Return the pixel (2,) of the one saturated spot in a picture; None without exactly one.

    ``image`` (H, W).
    """
    cv2 = opencv()
    bright = (image >= _SATURATED).astype(np.uint8)
    count, _, statistics, centres = cv2.connectedComponentsWithStats(bright)
    areas = statistics[1:, cv2.CC_STAT_AREA]
    if count < 2 or areas.max() < _LEAST_PIXELS:
        return None
    order = np.argsort(areas)[::-1]
    if len(order) > 1 and areas[order[1]] > _SECOND * areas[order[0]]:
        return None
    found: FloatArray = np.asarray(centres[1 + order[0]], dtype=np.float64)
    return found


def fit_led(
    lens: Pinhole, poses: Sequence[TargetPose], pixels: FloatArray, name: str
) -> tuple[FloatArray, FloatArray]:
    """Fit the position of an LED to its reflections.

    Raises a `RecordError` if there are too few, or they are not of one LED.

    Parameters
    ----------
    lens : Pinhole
    poses : sequence of N TargetPose
        Of the glossy target.
    pixels : (N, 2) array
        Where the reflection was.
    name : str
        Of the LED, for messages.

    Returns
    -------
    position, sd : (3,) array
        In the camera, in metres, and its standard deviation.

    Notes
    -----
    The image of an LED at L in the mirror n x = d is at L - 2 (n L - d) n.
    """
    if len(poses) < _LEAST_REFLECTIONS:
        raise RecordError(
            f"{counted(len(poses), 'picture')} with one reflection of {name}; give "
            f"{_LEAST_REFLECTIONS} or more, so dark that only the reflection is white, with the "
            "target at different distances and tilts"
        )
    roots = [_root(lens, pose) for pose in poses]

    def misfit(led: FloatArray) -> FloatArray:
        return np.concatenate(
            [
                root @ (_seen(lens, pose.rotation, pose.position, led) - spot)
                for root, pose, spot in zip(roots, poses, pixels, strict=True)
            ]
        )

    found = least_squares(misfit, np.zeros(3), x_scale=1e-3)
    spread = float(np.sqrt(2 * found.cost / (found.fun.size - 3)))
    if spread > _LARGEST_SPREAD or np.linalg.norm(found.x) > FARTHEST:
        raise RecordError(
            f"the reflections of {name} are not those of one LED (they differ by {spread:.2g} "
            "standard deviations); switch the others and the light of the room off"
        )
    jacobian = np.asarray(found.jac)
    covariance = max(spread, 1.0) ** 2 * np.linalg.pinv(jacobian.T @ jacobian)
    sd = np.sqrt(np.diag(covariance))
    if np.linalg.cond(jacobian) > _LARGEST_CONDITION or sd.max() > _LARGEST_LED_SD:
        raise RecordError(
            f"the reflections of {name} are all alike; hold the target at other distances and "
            "tilts too"
        )
    return found.x, sd


def _seen(lens: Pinhole, rotation: FloatArray, position: FloatArray, led: FloatArray) -> FloatArray:
    """Return the pixel (2,) of the reflection of an LED in a target."""
    normal = rotation[:, 2]
    image = led + 2 * (normal @ (position - led)) * normal
    image[2] = max(image[2], 1e-4)
    return lens.project(image)


def _root(lens: Pinhole, pose: TargetPose) -> FloatArray:
    """Return the root (2, 2) of the inverse covariance of a reflection, by that of the pose.

    A target that is turned by an angle turns the reflection by twice as much.
    """
    steps = np.repeat([1e-5, 1e-6], 3)
    slopes = np.empty((2, 6))
    led = np.zeros(3)
    for k, step in enumerate(steps):
        off = np.zeros(6)
        off[k] = step
        turned = Rotation.from_rotvec(off[:3]).as_matrix() @ pose.rotation
        moved = _seen(lens, turned, pose.position + off[3:], led)
        slopes[:, k] = (moved - _seen(lens, pose.rotation, pose.position, led)) / step
    covariance = slopes @ np.linalg.inv(pose.information) @ slopes.T + _SPOT**2 * np.eye(2)
    root: FloatArray = np.linalg.cholesky(np.linalg.inv(covariance)).T
    return root
