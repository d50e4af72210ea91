"""Correction of the calibration of a camera by its pictures of the wall while the head turns.

An error of the lever or of the pivot's place makes near and far patches of the wall turn by
different angles. Small changes of the calibration and of the angles of each picture make all
pictures of a sweep agree; the wall is a known cylinder. This is a bundle adjustment whose points
are known by their first picture.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import SignalError
from minorloop_head.sources import Frame
from minorloop_head.vision.calibrated_camera import CalibratedCamera
from minorloop_head.vision.wall_angles import LEAST, WallAngles
from minorloop_head.vision.wall_patches import SEEN, WallState

_ROUNDS = 3
"""Rounds of evaluation and adjustment: the third one changes the result by a fifth."""
_EVERY, _FLOOR = 3, math.radians(0.15)
"""Interval of adjusted pictures, and least standard deviation of a patch in each, in radians: as
the lights turn with the head, the look of a patch changes and shifts it by several hundredths of a
degree, equally in neighbouring pictures. By trial on seeds 1000 to 1008: with all pictures and 0.04
degrees the result departs from a true calibration by three standard deviations."""
_STEP = 0.01
"""Steps of numerical derivatives, in standard deviations before the correction."""


@dataclass(frozen=True, kw_only=True)
class CameraDoubt:
    """Standard deviations of a calibration, before its correction.

    The defaults are those of errors uniform within the bounds of ``head calibrate``: 0.3 % of the
    focal length, 1 pixel, 0.3 degrees and 0.1 mm.
    """

    focal: float = 0.0017
    """Relative standard deviation of the focal length."""
    centre: float = 0.6
    """Standard deviation of the principal point, in pixels of a picture 640 wide."""
    angle: float = math.radians(0.17)
    """Standard deviation of the angles of the mount and of the head at rest, in radians."""
    length: float = 0.06e-3
    """Standard deviation of the lever and of the pivot's place, in metres."""


def refined(
    estimator: WallAngles,
    frames: Sequence[Frame],
    rest: FloatArray,
    doubt: CameraDoubt | None = None,
) -> tuple[CalibratedCamera, FloatArray]:
    """Return the camera and the rest angles (2,) with which the pictures of a sweep agree best.

    Raises a `SignalError` if the pictures cannot be used, as `WallAngles.begin`, or fewer than ten
    show the angles.

    ``estimator``: with the calibrated camera; ``frames``: pictures while the head turns, the first
    at rest; ``rest`` (2,): pan and tilt of the line of sight at rest, in radians.
    """
    doubt = doubt or CameraDoubt()
    known = estimator.camera
    change, start = np.zeros(len(_sds(doubt, known))), np.asarray(rest, dtype=np.float64)
    zero = start
    for _ in range(_ROUNDS):
        at = replace(estimator, camera=_changed(known, change, doubt))
        angles, pictures, state = _tracked(at, frames, zero)
        more, turn = _adjusted(
            at, angles[::_EVERY], pictures[::_EVERY], state, doubt, change, zero - start
        )
        change, zero = change + more, zero + turn
    return _changed(known, change, doubt), zero


def _tracked(
    estimator: WallAngles, frames: Sequence[Frame], rest: FloatArray
) -> tuple[FloatArray, list[Frame], WallState]:
    """Return the pictures with known angles, these angles (K, 2), and the patches."""
    sight, state = estimator.begin(frames[0].image, rest, frames[0].t)
    angles, seen = [sight.angles], [frames[0]]
    for frame in frames[1:]:
        sight, state = estimator.step(state, frame.image, frame.t)
        if sight.verdict == SEEN:
            angles.append(sight.angles)
            seen.append(frame)
    if len(seen) < 10:
        raise SignalError(
            f"{len(seen)} pictures of the sweep show the angles, and 10 are needed; set lights, "
            "gain and focus, and turn the head slowly"
        )
    return np.array(angles), seen, state


def _adjusted(
    estimator: WallAngles,
    angles: FloatArray,
    pictures: list[Frame],
    state: WallState,
    doubt: CameraDoubt,
    before: FloatArray,
    turned_before: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the changes that make patches agree.

    The first changes the calibration, in standard deviations, the second the angles at rest, in
    radians.
    """
    patches, camera = state.patches, estimator.camera
    count = before.size
    views, number = np.unique(np.vstack([patches.origins, angles]), axis=0, return_inverse=True)
    origin, view = np.split(number.ravel(), [len(patches.origins)])
    others = [_changed(camera, _STEP * unit, doubt) for unit in np.eye(count)]
    moved = np.array([_seen_again(patches.places, patches.origins, camera, one) for one in others])
    turned = np.array(
        [
            _seen_again(patches.places, patches.origins, camera, camera, turn)
            for turn in _STEP * doubt.angle * np.eye(2)
        ]
    )
    size = count + views.shape[0] * 2
    normal, right = np.zeros((size, size)), np.zeros(size)
    normal[:count, :count] = np.eye(count)
    right[:count] = -before
    fixed = slice(count + 2 * view[0], count + 2 * view[0] + 2)
    normal[fixed, fixed] += np.eye(2) / doubt.angle**2
    right[fixed] -= turned_before / doubt.angle**2
    for k, frame in enumerate(pictures):
        chosen = estimator.pictures.in_view(patches, angles[k])
        some = patches.of(chosen)
        pyramid = estimator.pictures.pyramid(frame.image)
        scores, own, votes = estimator.pictures.aligned(pyramid[0], some, angles[k])
        turn = 1e-4
        pan, tilt = angles[k].tolist()
        here = camera.pixel(some.places, pan, tilt)
        rates = np.stack(
            [
                (camera.pixel(some.places, pan + turn, tilt) - here) / turn,
                (camera.pixel(some.places, pan, tilt + turn) - here) / turn,
            ],
            axis=2,
        )
        by_camera = np.array(
            [one.pixel(moved[n][chosen], pan, tilt) - here for n, one in enumerate(others)]
        )
        by_turn = np.array([camera.pixel(turned[n][chosen], pan, tilt) - here for n in range(2)])
        for p in range(len(chosen)):
            if not scores[p] >= LEAST or view[k] == origin[chosen[p]]:
                continue
            noise = 8.0 / some.points.shape[1] * (1.0 - min(float(scores[p]), 0.99))
            spread = np.linalg.inv(own[p] + 1e-9 * np.eye(2))
            weight = np.linalg.inv(noise * spread + _FLOOR**2 * np.eye(2))
            back = np.linalg.inv(rates[p])
            row = np.zeros((2, size))
            row[:, :count] = back @ by_camera[:, p].T / _STEP
            own_view, first = count + 2 * view[k], count + 2 * origin[chosen[p]]
            row[:, own_view : own_view + 2] += np.eye(2)
            row[:, first : first + 2] += back @ by_turn[:, p].T / (_STEP * doubt.angle)
            normal += row.T @ weight @ row
            right += row.T @ weight @ votes[p]
    found = np.linalg.lstsq(normal, right, rcond=1e-12)[0]
    return found[:count], found[fixed]


def _seen_again(
    places: FloatArray,
    origins: FloatArray,
    camera: CalibratedCamera,
    other: CalibratedCamera,
    turn: FloatArray | None = None,
) -> FloatArray:
    """Return the places (P, 2) by another camera of patches that one saw at angles (P, 2)."""
    found = np.empty_like(places)
    off = np.zeros(2) if turn is None else turn
    for angles in np.unique(origins, axis=0):
        own = (origins == angles).all(axis=1)
        pixels = camera.pixel(places[own], *angles.tolist())
        found[own] = other.place(pixels, *(angles + off).tolist())
    return found


def _sds(doubt: CameraDoubt, camera: CalibratedCamera) -> FloatArray:
    """Standard deviations: focal length, u, v, lever, offset, squint, camera roll."""
    pixels = doubt.centre * camera.lens.width / 640.0
    lengths, angles = [doubt.length] * 3, [doubt.angle] * 2
    return np.array([camera.lens.focal * doubt.focal, pixels, pixels, *lengths, *angles])


def _changed(camera: CalibratedCamera, change: FloatArray, doubt: CameraDoubt) -> CalibratedCamera:
    """Return a camera after a change in standard deviations."""
    focal, u, v, lever, x, y, squint, roll = (change * _sds(doubt, camera)).tolist()
    lens, mount = camera.lens, camera.mount
    return replace(
        camera,
        lens=replace(
            lens, focal=lens.focal + focal, centre=(lens.centre[0] + u, lens.centre[1] + v)
        ),
        mount=replace(
            mount,
            lever=mount.lever + lever,
            offset=(mount.offset[0] + x, mount.offset[1] + y),
            squint=mount.squint + squint,
            camera_roll=mount.camera_roll + roll,
        ),
    )
