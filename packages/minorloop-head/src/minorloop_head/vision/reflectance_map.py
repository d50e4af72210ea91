"""Reflectance maps of the wall, from frames under different lights.

The logarithm of a frame, less that of the light on the wall, is the reflectance. Marks of the wall
stay on the map under every light; reflections and shadows move. Readings of the joints have an
error in each frame. Without a correction the merged map shows edges twice, and a hole looks larger
than it is. The marks give the displacement between frames.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError
from minorloop_head.vision import frame_checks
from minorloop_head.vision.calibrated_camera import (
    CalibratedCamera,
    Window,
    irradiance,
    unroll,
    window_in_view,
)
from minorloop_head.vision.imaging import Image32, shrunk
from minorloop_head.vision.patch_pictures import PatchPictures

NO_ANGLE = "angle unknown"
"""Verdict on a frame without the angles of the head."""

FARTHEST = np.pi / 2
"""Largest plausible pan or tilt, in radians: the head looks into the pipe."""

ALONE = 1.5
"""Exposure of a frame with one light or none, relative to one with all."""

LEAST_SEEN = 14e3
"""Least resolution of the wall in pixels per metre: 12 pixels across a hole of 0.85 mm."""

_FLOOR, _GLOW_FLOOR = 2.0, 4.0
"""Grey levels: added before the logarithm, so that noise in the dark stays small; and least light
from behind that is subtracted from the other frames."""
STEP = 0.05e-3
"""Texel of the map for holes of about 1 mm, in metres: an outline of 17 to 23 texels across
scatters by 0.4 % (``_outline_kernels``). It grows with the holes that are searched."""
_AVERAGED = 1.5
"""Least scale at which a texel is the mean of four finer ones: it is then wider than two pixels of
the nearest wall, and interpolation would skip some of them."""
_BLOCK = 16
"""Side of a block in texels, 0.8 mm: a hole of 1.15 mm fills more than half of at most two of the
nine blocks whose median is the ground."""
_LEAST_LIGHT = 1e-3
"""Least assumed irradiance, so that a wall that faces away from an LED has a logarithm. A lit wall
has less only 0.1 m along the pipe, where its picture is too small to be searched."""


@dataclass(frozen=True, eq=False)
class LitFrame:
    """A frame with the angles and lights under which it was taken."""

    image: Any
    """Shape (height, width). The frame."""
    pan: float
    tilt: float
    """Measured angles of the head, in radians."""
    lights: tuple[bool, ...] = (True, True, True)
    """Whether each LED was on."""


@dataclass(frozen=True, eq=False)
class ReflectanceMap:
    """Reflectance of a part of the wall, as natural logarithms; NaN where it is not seen."""

    window: Window
    """The texels of the map."""
    stack: Image32
    """Shape (K, rows, columns). One for each single light; without those, one for each frame with
    light."""
    whole: Image32
    """Shape (rows, columns). With all lights on; the median of the stack without such a frame."""
    glow: Image32 | None
    """Shape (rows, columns). Logarithm of the light with all LEDs off."""
    ground: Image32
    """Shape (rows, columns). Local median."""

    @property
    def brightest(self) -> Image32:
        """Reflectance under the light that makes it brightest."""
        return np.asarray(self.stack.max(axis=0))

    @property
    def darkest(self) -> Image32:
        """Reflectance under the light that makes it darkest."""
        return np.asarray(self.stack.min(axis=0))


def check_frames(frames: Sequence[LitFrame], camera: CalibratedCamera) -> str:
    """Return ``good``, or the fault of the first bad frame.

    Raises a `ParameterError` if a frame does not have one flag for each light of the camera.
    """
    earlier: list[LitFrame] = []
    for number, frame in enumerate(frames):
        if len(frame.lights) != len(camera.leds):
            raise ParameterError(
                f"frame {number} has {len(frame.lights)} lights; give a truth value for each of "
                f"the {len(camera.leds)} of the camera"
            )
        verdict = frame_checks.check_frame(frame.image, camera.lens, lit=any(frame.lights))
        if verdict != frame_checks.GOOD:
            return verdict
        if any(np.array_equal(frame.image, other.image) for other in earlier):
            return frame_checks.FROZEN
        if not _plausible(frame, camera):
            return NO_ANGLE
        earlier.append(frame)
    if not any(any(frame.lights) for frame in frames):
        return frame_checks.BLACK
    return _check_pairs(frames)


def _check_pairs(frames: Sequence[LitFrame]) -> str:
    """Return the fault of a frame that repeats another, or lacks its light."""
    brightness = [frame_checks.Brightness.of(frame.image) for frame in frames]
    for (one, first), (other, second) in combinations(zip(frames, brightness, strict=True), 2):
        verdict = _check_pair(one, other, first, second)
        if verdict != frame_checks.GOOD:
            return verdict
    return frame_checks.GOOD


def _check_pair(
    one: LitFrame, other: LitFrame, first: frame_checks.Brightness, second: frame_checks.Brightness
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


def finite_angles(pan: Any, tilt: Any) -> bool:
    """Return whether pan and tilt are finite numbers."""
    try:
        pair = np.array([pan, tilt], dtype=np.float64)
    except (TypeError, ValueError):
        return False
    return bool(np.isfinite(pair).all())


def _plausible(frame: LitFrame, camera: CalibratedCamera) -> bool:
    """Return whether a head in the pipe can have the angles of a frame."""
    if not finite_angles(frame.pan, frame.tilt):
        return False
    pan, tilt = float(frame.pan), float(frame.tilt)
    return max(abs(pan), abs(tilt)) <= FARTHEST and camera.inside(pan, tilt)


def lay_flat(
    frames: Sequence[LitFrame], camera: CalibratedCamera, scale: float = 1.0
) -> ReflectanceMap | None:
    """Unroll good frames onto one map of the wall.

    It is None if no part of the wall is in all of them with enough resolution.

    ``frames``: at least one with light; ``camera``: the camera; ``scale``: size of the searched
    holes over 1 mm, to which texels and least resolution are adapted.
    """
    middle = frames[len(frames) // 2]
    step, least = scale * STEP, LEAST_SEEN / scale
    window = window_in_view(camera, middle.pan, middle.tilt, step=step, least=least)
    if window is None:
        return None
    fine = window if scale < _AVERAGED else window.finer(camera.radius)
    flats = [unroll(k.image, camera, fine, k.pan, k.tilt, least=least) for k in frames]
    if fine is not window:
        flats = [shrunk(flat) for flat in flats]
    seen = np.isfinite(flats[0])
    for flat in flats[1:]:
        seen &= np.isfinite(flat)
    if seen.sum() < _BLOCK**2:
        return None
    light = np.maximum(irradiance(camera, window, middle.pan, middle.tilt), _LEAST_LIGHT)
    alone: list[Image32] = []
    full: list[Image32] = []
    for flat in flats:
        flat[~seen] = np.nan
    dark = [flat for frame, flat in zip(frames, flats, strict=True) if not any(frame.lights)]
    behind = np.mean(dark, axis=0) if dark else np.zeros_like(flats[0])
    own = np.where(behind > _GLOW_FLOOR, behind, 0)  # subtracting less adds noise in the dark
    for frame, flat in zip(frames, flats, strict=True):
        if not any(frame.lights):
            continue
        fall = light[np.array(frame.lights, dtype=bool)].sum(axis=0)
        lit = np.maximum(flat - own / (ALONE if all(frame.lights) else 1.0), 0)
        level = np.log((lit + _FLOOR) / fall)
        (alone if sum(frame.lights) == 1 else full).append(level)
    stack = np.array(alone if len(alone) > 1 else [*full, *alone], dtype=np.float32)
    typical = median(stack)
    whole = np.mean(full, axis=0).astype(np.float32) if full else typical
    glow = np.log(behind / _GLOW_FLOOR + 1).astype(np.float32) if dark else None
    return ReflectanceMap(window, stack, whole, glow, _ground(typical, seen))


def median(stack: Image32) -> Image32:
    """Return the median of the images of a stack."""
    if len(stack) != 3:
        return np.median(stack, axis=0).astype(np.float32)
    a, b, c = stack
    middle: Image32 = np.maximum(np.minimum(a, b), np.minimum(np.maximum(a, b), c))
    return middle


def _ground(level: Image32, seen: np.ndarray[Any, np.dtype[np.bool_]]) -> Image32:
    """Return the local median, of blocks and then of their neighbours."""
    from scipy import ndimage  # tracking does not need it

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
    """Interpolate bilinearly between nodes at rows i and columns j."""
    i, j = np.clip(i, 0, nodes.shape[0] - 1), np.clip(j, 0, nodes.shape[1] - 1)
    i0 = np.minimum(i.astype(int), max(nodes.shape[0] - 2, 0))
    j0 = np.minimum(j.astype(int), max(nodes.shape[1] - 2, 0))
    i1, j1 = np.minimum(i0 + 1, nodes.shape[0] - 1), np.minimum(j0 + 1, nodes.shape[1] - 1)
    s, t = (i - i0)[:, None], (j - j0)[None, :]
    upper = (1 - t) * nodes[np.ix_(i0, j0)] + t * nodes[np.ix_(i0, j1)]
    lower = (1 - t) * nodes[np.ix_(i1, j0)] + t * nodes[np.ix_(i1, j1)]
    return np.asarray((1 - s) * upper + s * lower, dtype=np.float32)


_SIZE, _LEAST, _COLUMNS = 1.2e-3, 0.5, 320.0
"""Side of a patch in metres, its least correlation, and most columns of a compared picture. In
acquisitions of twelve views (seeds 1000 to 1011) with errors of 0.15 degrees, 0.003 degrees remain
in the median view and 0.012 in the worst."""
_LEVELS = (2, 2, 1, 1, 0)
_FEWEST = 4
"""Least number of patches that agree."""
_WIDEST, _FARTHEST = math.radians(0.1), math.radians(1.0)
"""Largest standard deviation of a turn, and largest turn, that are accepted: a poor sensor has
0.15 degrees."""


def aligned(frames: Sequence[LitFrame], camera: CalibratedCamera) -> tuple[LitFrame, ...]:
    """Return frames whose angles agree with each other; their mean stays.

    ``frames``: good frames of an acquisition. A frame without light keeps its angles, and so does a
    frame with too few patches of the frame with most light.
    """
    lit = [n for n, frame in enumerate(frames) if any(frame.lights)]
    if len(lit) < 2:
        return tuple(frames)
    first = max(lit, key=lambda n: sum(frames[n].lights))
    pictures, still = PatchPictures(camera, _SIZE, _LEAST, width=_COLUMNS), np.zeros(2)
    begun, pyramid = _angles(frames[first]), pictures.pyramid(frames[first].image)
    patches = pictures.new(pyramid, begun, pictures.none, still, still)
    turns = np.zeros((len(frames), 2))
    for n in set(lit) - {first} if len(patches.sd) >= _FEWEST else ():
        angles, pyramid = _angles(frames[n]), pictures.pyramid(frames[n].image)
        found = pictures.agreed(pyramid, patches, angles, still, _LEVELS)
        sure = found.sd is not None and found.sd.max() < _WIDEST
        near = np.abs(found.angles - angles).max() < _FARTHEST
        if sure and near and (found.scores >= _LEAST).sum() >= _FEWEST:
            turns[n] = found.angles - angles
    turns[lit] -= turns[lit].mean(axis=0)
    return tuple(
        replace(frame, pan=frame.pan + float(a), tilt=frame.tilt + float(b))
        for frame, (a, b) in zip(frames, turns, strict=True)
    )


def _angles(frame: LitFrame) -> FloatArray:
    return np.array([frame.pan, frame.tilt])
