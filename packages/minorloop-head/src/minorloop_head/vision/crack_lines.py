"""Heights of thin lines on maps of the wall, averaged over all lights.

Under each light a line is darker or brighter than the wall on both of its sides, along some length.
An edge has one such side only, and a spot has no length. The flanks of a groove answer differently
to lights from different sides; differences between lights show them, and not the colour of a wall.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import fft, ndimage

from minorloop_head.vision._line_kernels import keep_highest
from minorloop_head.vision.imaging import Image32

_HEADINGS = 16
"""Number of headings of the filter: a line between two of them deviates by 0.2 texels in length."""
_ALONG = 4.0
"""Standard deviation of the filter along a line in texels, 0.2 mm: cracks turn in about twice
that."""
_ACROSS = ((0.8, 4.0), (1.6, 6.0))
"""Pairs of standard deviation across a line and distance of the wall beside it, in texels: for
lines of up to about 0.15 and 0.3 mm."""
_GROUND = 12.0
"""Standard deviation in texels of the filter for the brightness of the wall around: by trial."""
_MARGIN = 24
"""Texels of padding, so that one edge of the map does not act on the other."""


def line_heights(
    stack: Image32, seen: npt.NDArray[np.bool_]
) -> tuple[Image32, npt.NDArray[np.bool_]]:
    """Return the heights of lines through each texel over both sides, and the middles of lines.

    ``stack`` (K, rows, columns): logarithm of the reflectance under each of K lights; ``seen``
    (rows, columns): where all of them are known.

    Returns
    -------
    heights : (J, rows, columns) array of float32
        In the logarithm of the reflectance, averaged along and across the filter and over the
        lights; 0 where there is no line. J is 2: lines of the maps, and of their differences from
        the mean over the lights; or 1 with one light, without the latter.
    middle : (J, rows, columns) array of bool
        Where no texel beside the line is higher.
    """
    rows, columns = seen.shape
    shape = tuple(fft.next_fast_len(n + _MARGIN, real=True) for n in (rows, columns))
    share = _around(seen.astype(np.float32))
    waves = [fft.rfft2(_levelled(level, seen, share), shape) for level in stack]
    v = 2 * np.pi * np.fft.fftfreq(shape[0])[:, None].astype(np.float32)
    u = 2 * np.pi * np.fft.rfftfreq(shape[1])[None].astype(np.float32)
    kinds = min(len(stack), 2)
    best = np.full((kinds, rows, columns), -np.inf, dtype=np.float32)
    sides = np.zeros((kinds, 2, rows, columns), dtype=np.int8)
    smooth, product = np.empty((len(stack), *shape), dtype=np.float32), np.empty_like(waves[0])
    for heading in np.pi * np.arange(_HEADINGS) / _HEADINGS:
        c, s = float(np.cos(heading)), float(np.sin(heading))
        along, across = c * u + s * v, c * v - s * u
        for wide, aside in _ACROSS:
            filtered = np.exp(-0.5 * ((_ALONG * along) ** 2 + (wide * across) ** 2))
            for wave, one in zip(waves, smooth, strict=True):
                one[:] = fft.irfft2(np.multiply(wave, filtered, out=product), shape)
            step, side = (round(aside * c), round(-aside * s)), (round(1.4 * c), round(-1.4 * s))
            keep_highest(smooth, step, side, best[0], sides[0])
            if kinds > 1:
                smooth -= smooth.mean(axis=0)
                keep_highest(smooth, step, side, best[1], sides[1])
    return best, np.stack([_middle(*one) for one in zip(best, sides, strict=True)])


def _middle(heights: Image32, sides: npt.NDArray[np.int8]) -> npt.NDArray[np.bool_]:
    """Return whether both texels at the step to either side are not higher."""
    i, j = np.indices(heights.shape)
    last = np.array(heights.shape)[:, None, None] - 1
    middle = np.ones(heights.shape, dtype=bool)
    for sign in (-1, 1):
        y, x = np.clip(np.stack([i, j]) + sign * sides, 0, last)
        middle &= heights >= heights[y, x]
    return middle


def _levelled(level: Image32, seen: npt.NDArray[np.bool_], share: Image32) -> Image32:
    """Return a map less the brightness around; 0 where it is not seen.

    ``share`` (rows, columns) is the weight of known texels around.
    """
    around = _around(np.where(seen, level, 0).astype(np.float32))
    flat: Image32 = np.where(seen, level - around / np.maximum(share, 1e-3), 0).astype(np.float32)
    return flat


def _around(level: Image32) -> Image32:
    """Return a map averaged over the surroundings of each texel."""
    averaged: Image32 = ndimage.gaussian_filter(level, _GROUND, mode="constant", truncate=3)
    return averaged
