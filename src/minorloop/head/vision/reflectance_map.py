"""Several frames of one wall under different lights, laid flat and made comparable.

The logarithm of a frame, less that of the light that falls on the wall, is the reflectance: what
is still on the map under every light belongs to the wall, and what moves from light to light is
a reflection or a shadow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from scipy import ndimage

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError
from minorloop.head.vision import frame_checks
from minorloop.head.vision.calibrated_camera import (
    CalibratedCamera,
    Image32,
    Window,
    irradiance,
    unroll,
    window_in_view,
)

NO_ANGLE = "angle unknown"
"""Verdict on a frame of which it is not known where the head was."""

FARTHEST = np.pi / 2
"""Largest pan or tilt of a head that looks into the pipe; beyond it, an angle is not known."""

LEAST_SEEN = 14e3
"""Pixels for each metre of the wall below which it is not looked at."""

_FLOOR, _GLOW_FLOOR = 2.0, 4.0
_BLOCK = 16
_LEAST_LIGHT = 1e-3


@dataclass(frozen=True, eq=False)
class LitFrame:
    """A frame and what is known of how it was taken.

    Parameters
    ----------
    image : (height, width) array of uint8
        The frame.
    pan, tilt : float
        Of the head as measured, in radians.
    lights : tuple of bool
        Which LEDs were on.
    """

    image: Any
    pan: float
    tilt: float
    lights: tuple[bool, ...] = (True, True, True)


@dataclass(frozen=True, eq=False)
class ReflectanceMap:
    """Reflectance of a piece of wall, as natural logarithms; NaN where it is not seen.

    Parameters
    ----------
    window : Window
        Where it lies on the wall.
    stack : (K, rows, columns) array of float32
        One for each light that was on alone; else one for each frame with light.
    whole : (rows, columns) array of float32
        With all lights on; the median of the stack where there was no such frame.
    glow : (rows, columns) array of float32, optional
        What shines with no light on.
    ground : (rows, columns) array of float32
        Local median.
    """

    window: Window
    stack: Image32
    whole: Image32
    glow: Image32 | None
    ground: Image32

    @property
    def brightest(self) -> Image32:
        """Under whichever light makes it brightest."""
        return np.asarray(self.stack.max(axis=0))

    @property
    def darkest(self) -> Image32:
        """Under whichever light makes it darkest."""
        return np.asarray(self.stack.min(axis=0))


def judge_looks(looks: Sequence[LitFrame], eye: CalibratedCamera) -> str:
    """``good``, or what is wrong with the first frame that cannot be used.

    Raises
    ------
    ParameterError
        If a look does not say of each light of the eye whether it was on.
    """
    earlier: list[LitFrame] = []
    for number, look in enumerate(looks):
        if len(look.lights) != len(eye.leds):
            raise ParameterError(
                f"look {number} has {len(look.lights)} lights; give a truth value for each of the "
                f"{len(eye.leds)} of the eye"
            )
        verdict = frame_checks.judge(look.image, eye.lens, lit=any(look.lights))
        if verdict != frame_checks.GOOD:
            return verdict
        if any(np.array_equal(look.image, other.image) for other in earlier):
            return frame_checks.FROZEN
        if not _known(look, eye):
            return NO_ANGLE
        earlier.append(look)
    if not any(any(look.lights) for look in looks):
        return frame_checks.BLACK
    return _judge_pairs(looks)


def _judge_pairs(looks: Sequence[LitFrame]) -> str:
    """What is wrong with a frame that holds another, whole or in part, or lacks its light."""
    greys = [frame_checks.Greys.of(look.image) for look in looks]
    for (one, first), (other, second) in combinations(zip(looks, greys, strict=True), 2):
        verdict = _judge_pair(one, other, first, second)
        if verdict != frame_checks.GOOD:
            return verdict
    return frame_checks.GOOD


def _judge_pair(
    one: LitFrame, other: LitFrame, first: frame_checks.Greys, second: frame_checks.Greys
) -> str:
    if frame_checks.shares_rows(one.image, other.image):
        return frame_checks.TORN
    on, more = np.array([one.lights, other.lights], dtype=bool)
    if (on == more).all():
        return frame_checks.GOOD
    verdict = frame_checks.same_light(first, second)
    if verdict == frame_checks.GOOD and not (on & ~more).any():
        return frame_checks.less_light(second, first)
    if verdict == frame_checks.GOOD and not (more & ~on).any():
        return frame_checks.less_light(first, second)
    return verdict


def known_angles(pan: Any, tilt: Any) -> bool:
    """Whether pan and tilt are finite numbers."""
    try:
        pair = np.array([pan, tilt], dtype=np.float64)
    except (TypeError, ValueError):
        return False
    return bool(np.isfinite(pair).all())


def _known(look: LitFrame, eye: CalibratedCamera) -> bool:
    """Whether pan and tilt are angles that a head in the pipe can have."""
    if not known_angles(look.pan, look.tilt):
        return False
    pan, tilt = float(look.pan), float(look.tilt)
    return max(abs(pan), abs(tilt)) <= FARTHEST and eye.inside(pan, tilt)


def lay_flat(looks: Sequence[LitFrame], eye: CalibratedCamera) -> ReflectanceMap | None:
    """Lay good frames on one map of the wall.

    Parameters
    ----------
    looks : sequence of LitFrame
        At least one of them with light.
    eye : CalibratedCamera
        The camera.

    Returns
    -------
    ReflectanceMap or None
        None where the wall is nowhere seen large enough by all of them.
    """
    middle = looks[len(looks) // 2]
    window = window_in_view(eye, middle.pan, middle.tilt, least=LEAST_SEEN)
    if window is None:
        return None
    flats = [unroll(k.image, eye, window, k.pan, k.tilt, least=LEAST_SEEN) for k in looks]
    seen = np.isfinite(flats[0])
    for flat in flats[1:]:
        seen &= np.isfinite(flat)
    if seen.sum() < _BLOCK**2:
        return None
    light = np.maximum(irradiance(eye, window, middle.pan, middle.tilt), _LEAST_LIGHT)
    alone: list[Image32] = []
    full: list[Image32] = []
    dark: list[Image32] = []
    for look, flat in zip(looks, flats, strict=True):
        flat[~seen] = np.nan
        if not any(look.lights):
            dark.append(np.log((flat + _GLOW_FLOOR) / _GLOW_FLOOR))
            continue
        fall = light[np.array(look.lights, dtype=bool)].sum(axis=0)
        level = np.log((flat + _FLOOR) / fall)
        (alone if sum(look.lights) == 1 else full).append(level)
    stack = np.array(alone if len(alone) > 1 else [*full, *alone], dtype=np.float32)
    typical = median(stack)
    whole = np.mean(full, axis=0).astype(np.float32) if full else typical
    glow = np.mean(dark, axis=0).astype(np.float32) if dark else None
    return ReflectanceMap(window, stack, whole, glow, _ground(typical, seen))


def median(stack: Image32) -> Image32:
    """Median of the images of a stack."""
    if len(stack) != 3:
        return np.median(stack, axis=0).astype(np.float32)
    a, b, c = stack
    middle: Image32 = np.maximum(np.minimum(a, b), np.minimum(np.maximum(a, b), c))
    return middle


def _ground(level: Image32, seen: np.ndarray[Any, np.dtype[np.bool_]]) -> Image32:
    """Local median, of blocks and then of their neighbours."""
    filled = np.where(seen, level, np.float32(np.median(level[seen])))
    rows, columns = (-(-n // _BLOCK) for n in filled.shape)
    pad = (rows * _BLOCK - filled.shape[0], columns * _BLOCK - filled.shape[1])
    padded = np.pad(filled, ((0, pad[0]), (0, pad[1])), mode="edge")
    blocks = padded.reshape(rows, _BLOCK, columns, _BLOCK).swapaxes(1, 2)
    middles: FloatArray = np.median(blocks.reshape(rows, columns, -1), axis=2)
    middles = ndimage.median_filter(middles, 3, mode="nearest")
    i = (np.arange(filled.shape[0]) + 0.5) / _BLOCK - 0.5
    j = (np.arange(filled.shape[1]) + 0.5) / _BLOCK - 0.5
    return _between(middles, i, j)


def _between(nodes: FloatArray, i: FloatArray, j: FloatArray) -> Image32:
    """Bilinear between nodes at rows i and columns j."""
    i, j = np.clip(i, 0, nodes.shape[0] - 1), np.clip(j, 0, nodes.shape[1] - 1)
    i0 = np.minimum(i.astype(int), max(nodes.shape[0] - 2, 0))
    j0 = np.minimum(j.astype(int), max(nodes.shape[1] - 2, 0))
    i1, j1 = np.minimum(i0 + 1, nodes.shape[0] - 1), np.minimum(j0 + 1, nodes.shape[1] - 1)
    s, t = (i - i0)[:, None], (j - j0)[None, :]
    upper = (1 - t) * nodes[np.ix_(i0, j0)] + t * nodes[np.ix_(i0, j1)]
    lower = (1 - t) * nodes[np.ix_(i1, j0)] + t * nodes[np.ix_(i1, j1)]
    return np.asarray((1 - s) * upper + s * lower, dtype=np.float32)
