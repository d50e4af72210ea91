"""Calibration of a lens, and of the places of LEDs, from pictures of a flat target."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations, product
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError, RecordError, counted
from minorloop_head.distortion import DISTORTION
from minorloop_head.geometry import Pinhole
from minorloop_head.vision.calibrated_camera import Image
from minorloop_head.vision.frame_checks import WHITE
from minorloop_head.vision.imaging import opencv
from minorloop_head.vision.measured import Measured
from minorloop_head.vision.targets import SeenTarget

_LEAST_REFLECTIONS = 4
"""Fewest reflections: two determine the place of an LED, more show whether they belong to one LED.
In 20 sets of each count (seeds 1000 to 1019) the rms error is 0.24 mm with 2, 0.18
with 3, 0.10 with 4 and 0.08 with 8."""
_LEAST_PIXELS = 4
"""Fewest pixels of a saturated spot, since a single pixel may be hot."""
_SECOND = 0.3
"""Largest size of the second saturated spot, as a share of the largest."""
FARTHEST = 0.05
"""Largest distance in metres from the lens to an LED: more than the radius of any such pipe."""
_SPOT = 0.3
"""Standard deviation of the centre of a reflection, in pixels."""
_LARGEST_LED_SD, _LARGEST_CONDITION = 3e-3, 1e4
"""Largest standard deviation of a position, in metres, and largest condition number of its fit."""
_LARGEST_SPREAD = 5.0
"""Largest rms distance of reflections from the fit, in standard deviations."""
_LEAST_PICTURES = 3
"""Fewest pictures: two determine a focal length, and a third one checks them."""
_LEAST_CORNERS = 8
"""Fewest corners in each ninth of the image, without a warning."""
_TILTED = 12.0
"""Least angle in degrees of a picture that is not frontal."""
_LEAST_SPREAD = 0.2
"""Least share of the rarer direction of tilt, without a warning."""
_VAGUE, _UNKNOWN = 0.01, 0.1
"""Relative standard deviations of a focal length above which it gives a warning, and an error."""
_OUTLIER = (4.0, 0.5)
"""Least rms residual of a picture that moved: in medians of all pictures, and in pixels."""
_TWO = 0.6
"""Largest share of the residual that remains after fitting two lenses, if there are two cameras."""
_EQUAL = 1.01
"""Largest residual of left-out pictures, relative to the smallest, with which a lens with more free
numbers is chosen: a missing number shifts the focal length more than a superfluous one."""
_SCALES = np.exp(np.linspace(-0.5, 0.5, 11))
"""Initial focal lengths of two cameras, relative to that of all pictures."""
_STARTS = np.array([0.5, 0.8, 1.3, 2.0, 3.2])
"""Initial focal lengths of fits, in widths of the image: a fit may end in a local minimum."""
_SOME = 12
"""Largest number of pictures for initial values."""
_ROUNDS = 5
"""Largest number of assignments of pictures to two lenses; they converge after two or three."""
_DOWN, _ACROSS = ("upper", "middle", "lower"), ("left", "centre", "right")
_NUMBERS = ("fx", "fy", "u", "v", "k1", "k2", "p1", "p2", "k3")
"""Numbers of a lens, in the order of OpenCV."""
_MEANING = {
    "fx": ("focal length fx", "px"),
    "fy": ("focal length fy", "px"),
    "u": ("principal point u", "px"),
    "v": ("principal point v", "px"),
    **{name: (f"distortion {name}", "") for name in DISTORTION},
}
_DETERMINED = 1e10
"""Largest condition of scaled normal equations that are solved."""

_Start = tuple[FloatArray, FloatArray]
"""Matrix (3, 3) and distortion (5,) from which a lens is fitted."""


@dataclass(frozen=True, eq=False)
class TargetPose:
    """Pose of a target before the camera."""

    name: str
    """Name of the picture."""
    rotation: FloatArray
    """Shape (3, 3). Rotation from target (x right, y down, z away from the camera) to camera."""
    position: FloatArray
    """Shape (3,). Upper left corner of the target in the camera, in metres."""
    information: FloatArray
    """Shape (6, 6). Inverse covariance of a small rotation in radians, about axes of the camera,
    and of the position in metres."""
    residuals: FloatArray
    """Shape (N, 2). Observed less projected corners, in pixels."""

    @property
    def tilt(self) -> float:
        """Angle between the target and the image plane, in degrees."""
        return float(np.degrees(np.arccos(np.clip(self.rotation[2, 2], -1.0, 1.0))))


@dataclass(frozen=True, eq=False)
class LensFit:
    """A calibrated lens."""

    lens: Pinhole
    measured: tuple[Measured, ...]
    """Focal lengths, principal point, and the coefficients of distortion that the pictures support;
    the others are 0. The deviations contain residuals that the lens does not explain."""
    poses: tuple[TargetPose, ...]
    """Poses of the used pictures."""
    seen: tuple[SeenTarget, ...]
    """Their corners."""
    left_out: dict[str, str]
    """Names of pictures that do not fit the others, and why."""
    rms: float
    """Rms of the distances between observed and projected corners, in pixels."""
    rms_left_out: float
    """The same for pictures that are left out of the fit, each in turn."""
    model: str
    """Free parameters of the lens: names as in `Pinhole`, f where pixels are square."""
    warnings: tuple[str, ...] = ()
    """Parameters that the pictures hardly determine, and advice on further pictures."""


def fit_lens(seen: Sequence[SeenTarget], size: tuple[int, int]) -> LensFit:
    """Fit focal lengths, principal point and distortion.

    Pictures in which the target moved are left out. The free coefficients of distortion and focal
    lengths are those that best predict pictures left out of the fit; if in doubt, more are free.

    ``seen``: pictures with a target; ``size``: width and height of the pictures, in pixels. Raises
    a `RecordError` if there are fewer than `_LEAST_PICTURES`, or they do not determine the lens;
    the message says why.

    References
    ----------
    Zhang, A flexible new technique for camera calibration, 2000. Deviations: jackknife over
    pictures (Efron, The jackknife, the bootstrap and other resampling plans, 1982), and the shift
    of each number if all coefficients are free and the target may be bent.
    """
    if len(seen) < _LEAST_PICTURES:
        raise RecordError(
            f"{counted(len(seen), 'picture')} with a target; give {_LEAST_PICTURES} or more"
        )
    kept = list(seen)
    solution = _best(kept, size)
    _refuse_two_lenses(kept, size, solution)
    errors = np.array([_rms(each) for each in solution.residuals])
    moved = errors > max(_OUTLIER[0] * float(np.median(errors)), _OUTLIER[1])
    left_out: dict[str, str] = {}
    if moved.any() and (~moved).sum() >= _LEAST_PICTURES:
        left_out = {
            each.name: f"its corners are off by {error:.1f} px; hold the target still"
            for each, error, bad in zip(kept, errors, moved, strict=True)
            if bad
        }
        kept = [each for each, bad in zip(kept, moved, strict=True) if not bad]
        solution = _best(kept, size)
    fit = _result(kept, solution, left_out)
    vague = max(each.sd / each.value for each in fit.measured[:2])
    if not vague < _UNKNOWN:
        raise _undetermined(kept, fit.lens, f"their focal length is known to {100 * vague:.2g} %")
    return replace(fit, warnings=tuple(_further_pictures(fit)))


def corners_in_ninths(seen: Sequence[SeenTarget], lens: Pinhole) -> npt.NDArray[np.int64]:
    """Return the number of corners in each ninth of the image, (3, 3)."""
    pixels = np.concatenate([each.pixels for each in seen])
    counts, _, _ = np.histogram2d(
        pixels[:, 1],
        pixels[:, 0],
        bins=(np.linspace(-0.5, lens.height - 0.5, 4), np.linspace(-0.5, lens.width - 0.5, 4)),
    )
    ninths: npt.NDArray[np.int64] = counts.astype(np.int64)
    return ninths


def _further_pictures(fit: LensFit) -> list[str]:
    """Return advice on further pictures that determine the lens well."""
    said = []
    vague = max(each.sd / each.value for each in fit.measured[:2])
    if vague > _VAGUE:
        said.append(
            f"the focal length is known to {100 * vague:.2g} % only; give more pictures, tilted by "
            "20 to 40 degrees in different directions"
        )
    counts = corners_in_ninths(fit.seen, fit.lens)
    bare = [
        f"{_DOWN[row]} {_ACROSS[column]}" for row, column in np.argwhere(counts < _LEAST_CORNERS)
    ]
    if bare:
        said.append(
            f"hardly any corners in the {', '.join(bare)} of the image, where the distortion is a "
            "guess; photograph the target there"
        )
    normals = np.array([pose.rotation[:2, 2] for pose in fit.poses])
    tilted = normals[[pose.tilt > _TILTED for pose in fit.poses]]
    spread = (tilted**2).sum(axis=0)
    if spread.min() <= _LEAST_SPREAD * spread.sum() / 2:
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
    matrix, distortion = as_opencv(lens)
    good, turn, place = cv2.solvePnP(
        points, seen.pixels, matrix, distortion, flags=cv2.SOLVEPNP_IPPE
    )
    if not good:
        raise RecordError(f"{seen.name} shows a target in no possible pose; leave it out")
    turn, place = cv2.solvePnPRefineLM(points, seen.pixels, matrix, distortion, turn, place)
    return _pose(seen, points, turn, place, matrix, distortion, sd)


@dataclass(frozen=True, eq=False)
class _Solution:
    """A lens that was fitted with some numbers free."""

    model: str
    free: int
    flags: int
    matrix: FloatArray
    distortion: FloatArray
    turns: Sequence[FloatArray]
    places: Sequence[FloatArray]
    residuals: list[FloatArray]
    lens: Pinhole
    left_out: float
    """Rms residual of left-out pictures, in pixels."""
    sds: FloatArray
    """Shape (9,). Standard deviations of the numbers."""


def _models() -> Iterator[tuple[str, int, FloatArray]]:
    """Yield models of a lens: name, flags of OpenCV, and columns (9, K) of their free numbers."""
    cv2 = opencv()
    for square, radial, tangential in product((True, False), (1, 2, 3), (False, True)):
        bent = ["k1", "k2", "k3"][:radial] + ["p1", "p2"] * tangential
        free = ["fx", "fy", "u", "v", *bent]
        columns = np.eye(9)[:, [_NUMBERS.index(name) for name in free]]
        flags = (
            (cv2.CALIB_FIX_ASPECT_RATIO if square else 0)
            | (cv2.CALIB_FIX_K2 if radial < 2 else 0)
            | (cv2.CALIB_FIX_K3 if radial < 3 else 0)
            | (0 if tangential else cv2.CALIB_ZERO_TANGENT_DIST)
        )
        if square:
            columns[1, 0] = 1.0
            columns, free = np.delete(columns, 1, axis=1), ["f", *free[2:]]
        yield ", ".join(free), flags, columns


def _best(seen: Sequence[SeenTarget], size: tuple[int, int]) -> _Solution:
    """Return the lens with most free numbers among those that predict left-out pictures best.

    Raises a `RecordError` if no lens fits.
    """
    found: list[_Solution] = []
    start = _start(seen, size)
    for model, flags, columns in _models():
        solution = _solved(seen, size, start, model, flags, columns)
        if solution is not None:
            found.append(solution)
    if not found:
        nominal = Pinhole(*size, float(size[0]), ((size[0] - 1) / 2, (size[1] - 1) / 2))
        raise _undetermined(seen, nominal, "no lens fits them all")
    most = _EQUAL * min(each.left_out for each in found)
    equal = [each for each in found if each.left_out <= most]
    return max(equal, key=lambda each: (each.free, -each.left_out))


def _undetermined(seen: Sequence[SeenTarget], lens: Pinhole, why: str) -> RecordError:
    """Return the error for undetermined pictures: all frontal, or else another cause."""
    tilt = max(target_pose(lens, each, 1.0).tilt for each in seen)
    if tilt < _TILTED:
        why = f"the target is nowhere tilted by more than {tilt:.2g} degrees"
    return RecordError(
        f"the pictures do not determine the lens: {why}; tilt the target by 20 to 40 degrees, in "
        "different directions, and check that it is flat and of this kind"
    )


def _calibrated(
    seen: Sequence[SeenTarget], size: tuple[int, int], start: _Start, flags: int
) -> Any:
    """Return rms, matrix, distortion and poses that OpenCV finds from a start."""
    cv2 = opencv()
    matrix, distortion = start[0].copy(), start[1].copy()
    if flags & cv2.CALIB_FIX_ASPECT_RATIO:
        matrix[[0, 1], [0, 1]] = np.diag(matrix)[:2].mean()
    return cv2.calibrateCamera(
        [_flat(each).astype(np.float32) for each in seen],
        [each.pixels.astype(np.float32) for each in seen],
        size,
        matrix,
        distortion,
        flags=flags | cv2.CALIB_USE_INTRINSIC_GUESS,
    )


def _start(seen: Sequence[SeenTarget], size: tuple[int, int]) -> _Start:
    """Return matrix and distortion (5,) of the best lens with k1 alone, from several focal lengths.

    Raises a `RecordError` if there is none.
    """
    cv2 = opencv()
    flags = cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
    fits, some = [], seen[:: max(len(seen) // _SOME, 1)]
    for focal in size[0] * _STARTS:
        centre = (np.array(size) - 1) / 2
        matrix = np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1.0]])
        with suppress(cv2.error):
            fits.append(_calibrated(some, size, (matrix, np.zeros(5)), flags)[:3])
    if not fits:
        raise RecordError("the corners of the target are not those of a flat one; check its kind")
    _, matrix, distortion = min(fits, key=lambda fit: float(fit[0]))
    return matrix, distortion.ravel()[:5]


def _solved(
    seen: Sequence[SeenTarget],
    size: tuple[int, int],
    start: _Start,
    model: str,
    flags: int,
    columns: FloatArray,
) -> _Solution | None:
    """Return the fit of a model; None if it is not determined, or folds the image."""
    cv2 = opencv()
    try:
        _, matrix, distortion, turns, places = _calibrated(seen, size, start, flags)
        lens = _lens(size, matrix, distortion)
    except (cv2.error, ParameterError):
        return None
    residuals, parts = [], []
    middle, half = _extent(seen)
    for each, turn, place in zip(seen, turns, places, strict=True):
        pixels, slopes = cv2.projectPoints(_flat(each), turn, place, matrix, distortion)
        off = each.pixels - pixels.reshape(-1, 2)
        residuals.append(off)
        # A bent target: its height is a polynomial of second degree.
        x, y = ((each.points - middle) / half).T
        heights = half * np.stack([x * x, x * y, y * y], axis=-1)
        normal = slopes[:, 3:6].reshape(-1, 2, 3) @ cv2.Rodrigues(turn)[0][:, 2]
        bent = (normal[:, :, None] * heights[:, None, :]).reshape(-1, 3)
        wanted = np.column_stack([slopes[:, 6:15], bent, off.ravel()])
        basis, _ = np.linalg.qr(slopes[:, :6])
        parts.append(wanted - basis @ (basis.T @ wanted))  # what no change of the pose explains
    chosen = _left_out(parts, np.vstack([columns, np.zeros((3, columns.shape[1]))]))
    richest = _shift(sum(part.T @ part for part in parts))
    if chosen is None:
        return None
    influences, left_out, covariance = chosen
    count = len(seen)
    spread = (count - 1) / count * (influences**2).sum(axis=0)
    sds = np.sqrt(np.maximum(spread, np.diag(covariance)) + richest**2)
    return _Solution(
        model, columns.shape[1], flags, matrix, distortion.ravel(), turns, places, residuals, lens,
        left_out, sds,
    )  # fmt: skip


def _left_out(
    parts: Sequence[FloatArray], columns: FloatArray
) -> tuple[FloatArray, float, FloatArray] | None:
    """Return shifts (N, 9) and rms residual if pictures are left out, and the covariance (9, 9).

    ``parts`` (2 M, 13) of each picture are slopes by the numbers and the bending, and residuals.
    None if they do not determine the numbers.
    """
    slopes = [part[:, :-1] @ columns for part in parts]
    normal = sum(each.T @ each for each in slopes)
    scale = 1 / np.sqrt(np.maximum(np.diag(normal), np.finfo(float).tiny))
    shifts, errors = [], []
    for part, slope in zip(parts, slopes, strict=True):
        others = (normal - slope.T @ slope) * scale[:, None] * scale
        if not np.linalg.cond(others) < _DETERMINED:
            return None
        shift = -scale * np.linalg.solve(others, scale * (slope.T @ part[:, -1]))
        shifts.append(columns[:9] @ shift)
        errors.append(part[:, -1] - slope @ shift)
    off = np.concatenate(errors)
    inside = np.concatenate([part[:, -1] for part in parts])
    freedom = max(len(inside) - 6 * len(parts) - len(scale), 1)
    inverse = np.linalg.inv(normal * scale[:, None] * scale) * scale[:, None] * scale
    covariance = columns[:9] @ inverse @ columns[:9].T * (inside @ inside) / freedom
    return np.array(shifts), float(np.sqrt(2 * (off @ off) / len(off))), covariance


def _shift(normal: FloatArray) -> FloatArray:
    """Return the shift of the numbers (9,) if all of them and the bending are free."""
    scale = 1 / np.sqrt(np.maximum(np.diag(normal)[:-1], np.finfo(float).tiny))
    inner = normal[:-1, :-1] * scale[:, None] * scale
    step: FloatArray = scale * np.linalg.lstsq(inner, scale * normal[:-1, -1], rcond=1e-10)[0]
    return step[:9]


def _refuse_two_lenses(
    seen: Sequence[SeenTarget], size: tuple[int, int], solution: _Solution
) -> None:
    """Raise a `RecordError` if pictures are of two cameras: two lenses fit them much better."""
    if len(seen) < 2 * _LEAST_PICTURES:
        return
    lenses = []
    for scale in _SCALES:
        with suppress(ParameterError):  # a short one may fold the image
            lenses.append(replace(solution.lens, focal=solution.lens.focal * scale))
    off = [[_rms(target_pose(lens, each, 1.0).residuals) for each in seen] for lens in lenses]
    one, two = min(combinations(off, 2), key=lambda pair: float((np.min(pair, axis=0) ** 2).sum()))
    first = np.array(one) < np.array(two)
    for _ in range(_ROUNDS):
        if min(first.sum(), (~first).sum()) < _LEAST_PICTURES:
            return
        off = []
        for group in (first, ~first):
            chosen = [each for each, own in zip(seen, group, strict=True) if own]
            try:
                lens = _lens(
                    size, *_calibrated(chosen, size, _start(chosen, size), solution.flags)[1:3]
                )
                off.append([_rms(target_pose(lens, each, 1.0).residuals) for each in seen])
            except (ParameterError, RecordError, opencv().error):
                return
        before, first = first, np.array(off[0]) < np.array(off[1])
        if (before == first).all():
            break
    groups = [[each for each, own in zip(seen, group, strict=True) if own]
              for group in (first, ~first)]  # fmt: skip
    if np.square(np.min(off, axis=0)).sum() > _TWO**2 * sum(
        _rms(each) ** 2 for each in solution.residuals
    ):
        return
    try:
        apart = [_best(group, size).left_out for group in groups]
    except RecordError:
        return
    if max(apart) < _TWO * solution.left_out:  # a lens of a few pictures may explain only them
        names = [[each.name for each in group] for group in groups]
        raise RecordError(
            "the pictures are of two cameras, or the zoom was changed: "
            f"{counted(len(names[0]), 'picture')} such as {names[0][0]}, and {len(names[1])} such "
            f"as {names[1][0]}; give those of one"
        )


def _result(seen: Sequence[SeenTarget], solution: _Solution, left_out: dict[str, str]) -> LensFit:
    lens = solution.lens
    values = dict(zip(_NUMBERS, (*lens.focals, *lens.centre, *solution.distortion), strict=True))
    free = solution.model.replace("f,", "fx, fy,").split(", ")
    sds = dict(zip(_NUMBERS, solution.sds.tolist(), strict=True))
    measured = tuple(
        Measured(what, float(values[name]), sds[name], unit)
        for name, (what, unit) in _MEANING.items()
        if name in free
    )
    rms = _rms(np.concatenate(solution.residuals))
    poses = tuple(
        _pose(each, _flat(each), turn, place, solution.matrix, solution.distortion, rms / 2**0.5)
        for each, turn, place in zip(seen, solution.turns, solution.places, strict=True)
    )
    return LensFit(
        lens, measured, poses, tuple(seen), left_out, rms, solution.left_out, solution.model
    )


def _lens(size: tuple[int, int], matrix: FloatArray, distortion: FloatArray) -> Pinhole:
    """Return a lens of OpenCV.

    Raises a `ParameterError` if it folds the image, or its principal point is not in it.
    """
    (fx, _, u), (_, fy, v), _ = matrix.tolist()
    k1, k2, p1, p2, k3 = distortion.ravel().tolist()
    lens = Pinhole(*size, fx, (u, v), k1, k2, k3, p1, p2, fy / fx)
    ends = np.array([(u, v) for v in (0, size[1] - 1) for u in (0, size[0] - 1)], dtype=np.float64)
    if not (np.abs(lens.pixels(lens.normalised(ends)) - ends).max() < 0.1 and
            0 <= u < size[0] and 0 <= v < size[1]):  # fmt: skip
        raise ParameterError("the lens folds the image, or its principal point is outside of it")
    return lens


def _flat(seen: SeenTarget) -> FloatArray:
    """Return the corners (N, 3) on a plane target."""
    return np.column_stack([seen.points, np.zeros(len(seen.points))])


def _extent(seen: Sequence[SeenTarget]) -> tuple[FloatArray, float]:
    """Return middle (2,) and half of the longer side of the visible part of the target."""
    points = np.concatenate([each.points for each in seen])
    low, high = points.min(axis=0), points.max(axis=0)
    return (low + high) / 2, float((high - low).max() / 2)


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


def as_opencv(lens: Pinhole) -> tuple[FloatArray, FloatArray]:
    """Return matrix (3, 3) and distortion (5,) of a lens, as OpenCV has them."""
    (fx, fy), (u, v) = lens.focals, lens.centre
    matrix = np.array([[fx, 0.0, u], [0.0, fy, v], [0.0, 0.0, 1.0]])
    return matrix, np.array([lens.k1, lens.k2, lens.p1, lens.p2, lens.k3])


def _rms(residuals: FloatArray) -> float:
    return float(np.sqrt((residuals**2).sum(axis=1).mean()))


def find_reflection(image: Image) -> FloatArray | None:
    """Return the pixel (2,) of the one saturated spot in a picture; None without exactly one.

    ``image`` (H, W).
    """
    cv2 = opencv()
    bright = (image >= WHITE).astype(np.uint8)
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

    Returns the position (3,) in the camera, in metres, and its standard deviation (3,).

    Raises a `RecordError` if there are too few, or they are not of one LED.

    ``poses``: of the glossy target; ``pixels`` (N, 2): of the reflections; ``name``: of the LED,
    for messages.

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
