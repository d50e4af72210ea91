"""Turns of the head between the frames of an acquisition, from what they show of the wall.

A sensor of the joints has an error in each frame. Maps of frames that do not lie on each other
have their edges twice, so that a hole looks larger than it is. The marks of the wall are the same
under every light, and say by how much the frames are off from each other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy import ndimage

from minorloop.arrays import FloatArray
from minorloop_head.vision import _map_kernels as kernels
from minorloop_head.vision.calibrated_camera import (
    CalibratedCamera,
    Window,
    irradiance,
    unroll,
    window_in_view,
)
from minorloop_head.vision.imaging import Image32, gaussian
from minorloop_head.vision.reflectance_map import FLOOR, LEAST_LIGHT, LitFrame

_STEP, _LEAST = 0.1e-3, 8e3
"""Texel of the maps in metres, and least resolution in pixels per metre: wall with a texel less
wide than a pixel says little."""
_WIDE = 12
"""Width in texels of the mean that is subtracted: the light of dents and of stains is wider."""
_SMOOTHED = (4.0, 2.5, 1.5, 1.0, 1.0)
"""Widths in texels of the Gaussian smoothing, one for each step of the search: wide first, so that
frames half a degree apart are found."""
_CUT = 2.5
"""Widths at which it is cut off."""
_NEAR = 2
"""Steps from which the maps lie on each other, so that noise is what shortens a step."""
_CLIPPED = 0.5
"""Largest departure of a logarithm from the mean about it that counts: glints have more."""
_TURN = math.radians(0.1)
"""Turn for which the motion of the wall on the map is computed, in radians."""
_SD = math.radians(0.2)
"""Standard deviation of an angle before its frame was looked at, in radians: where the wall shows
nothing, the measured angle remains. It is more than that of the sensors, 0.05 to 0.1 degrees."""
_FARTHEST = 5 * _SD
_EVEN = 1e-3
"""Least scale of the residuals."""
_KNOWN = 20.0
"""Least information of the last step about a turn, over that of the measured angle. Marks give more
than 100; noise gives less than 10, and its steps are as wide as they are wrong."""
_FEWEST = 400
"""Least number of texels, 2 by 2 mm of wall: less is the surroundings of one hole only."""


def aligned(frames: Sequence[LitFrame], camera: CalibratedCamera) -> tuple[LitFrame, ...]:
    """Return frames whose angles agree with each other; their mean stays.

    Parameters
    ----------
    frames : sequence of LitFrame
        Good frames of an acquisition. Those without light keep their angles.
    camera : CalibratedCamera

    Notes
    -----
    Each frame is turned until its map differs least from that of the frame with most light: Gauss
    and Newton's steps with robust weights. The first use the mean gradient of both maps. In the
    last, the gradients of one map are the instruments of the other's, so that their noise does not
    shorten the steps (Fuller, Measurement Error Models, 1987, section 1.4).
    """
    lit = [n for n, frame in enumerate(frames) if any(frame.lights)]
    first = max(lit, key=lambda n: sum(frames[n].lights), default=0)
    window = window_in_view(camera, frames[first].pan, frames[first].tilt, step=_STEP, least=_LEAST)
    if len(lit) < 2 or window is None:
        return tuple(frames)
    maps = _Maps(camera, window, frames[first])
    turns = np.zeros((len(frames), 2))
    for n in lit:
        if n != first:
            turns[n] = maps.turn(frames[n])
    turns[lit] -= turns[lit].mean(axis=0)
    return tuple(
        replace(frame, pan=frame.pan + float(a), tilt=frame.tilt + float(b))
        for frame, (a, b) in zip(frames, turns, strict=True)
    )


class _Maps:
    """Maps of frames on a window, and how they move there."""

    def __init__(self, camera: CalibratedCamera, window: Window, first: LitFrame) -> None:
        self._camera, self._window = camera, window
        light = irradiance(camera, window, first.pan, first.tilt)
        self._light = np.maximum(light, LEAST_LIGHT)
        self._motion = self._moved(first)
        level, self._seen = self._level(first, np.zeros(2))
        self._bases = {width: gaussian(level, width, _CUT) for width in _SMOOTHED}

    def turn(self, frame: LitFrame) -> FloatArray:
        """Return the turn (2,) of a frame from its measured angles, in radians."""
        turn, told, right = np.zeros(2), np.empty((2, 2)), np.empty(2)
        for n, width in enumerate(_SMOOTHED):
            level, own = self._level(frame, turn)
            both = self._seen & own
            if both.sum() < _FEWEST:
                return np.zeros(2)
            base, level = self._bases[width], gaussian(level, width, _CUT)
            scale = 1.48 * float(np.median(np.abs(level - base)[both])) + _EVEN
            kernels.weigh(level, base, both, self._motion, scale, n < _NEAR, told, right)
            # Smoothed noise is alike over so many texels.
            alike = 4.0 * math.pi * width**2
            prior = alike * scale**2 / _SD**2
            turn = turn - np.linalg.solve(told + prior * np.eye(2), right + prior * turn)
            if not np.abs(turn).max() < _FARTHEST:
                return np.zeros(2)
        least = float(np.linalg.eigvalsh(0.5 * (told + told.T))[0])
        return turn if least > _KNOWN * prior else np.zeros(2)

    def _moved(self, first: LitFrame) -> FloatArray:
        """Return by how many texels the wall moves on the map, (2, 2, rows, columns).

        The first index is that of the angle, the second of column and row, both for a radian; 0
        where the wall is not seen.
        """
        camera, window = self._camera, self._window
        y, x = np.mgrid[: window.rows, : window.columns]
        places = window.place(x, y, camera.radius)
        angles = np.array([first.pan, first.tilt])
        moved = []
        for turn in _TURN * np.eye(2):
            there = camera.shifted(places, angles, angles + turn)
            off = window.texels(there, camera.radius) - np.stack([x, y], axis=-1)
            moved.append(np.moveaxis(off, -1, 0) / _TURN)
        return np.asarray(np.nan_to_num(np.array(moved)))

    def _level(
        self, frame: LitFrame, turn: FloatArray
    ) -> tuple[Image32, np.ndarray[Any, np.dtype[np.bool_]]]:
        """Return the logarithm of the reflectance less the mean about it, and where it is known."""
        angles = np.array([frame.pan, frame.tilt]) + turn
        flat = unroll(frame.image, self._camera, self._window, *angles.tolist(), least=_LEAST)
        light = self._light[np.array(frame.lights, dtype=bool)].sum(axis=0)
        seen = np.isfinite(flat)
        level = np.where(seen, np.log((flat + FLOOR) / light), np.float32(0))
        share = ndimage.uniform_filter(seen.astype(np.float32), _WIDE)
        level -= ndimage.uniform_filter(level, _WIDE) / np.maximum(share, 1e-3)
        level = np.where(seen, np.clip(level, -_CLIPPED, _CLIPPED), np.float32(0))
        inside = ndimage.minimum_filter(seen, _WIDE + 1, mode="constant")
        return level, inside
