"""Checks of frames: black, saturated, frozen, torn, wrong size or without a picture.

Such frames happen to every camera on a long cable. A check returns a verdict and raises no error,
so that a loop can continue without the frame. Pictures along a pipe may also be blurred or veiled,
as by a wet or a dirty lens.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import convolve, maximum_filter, uniform_filter

from minorloop.arrays import FloatArray
from minorloop_head.geometry import Pinhole
from minorloop_head.vision.calibrated_camera import Image
from minorloop_head.vision.imaging import opencv, shrunk

CLEAR, BLURRED, VEILED = "clear", "blurred", "veiled"
"""Verdicts on a picture."""
_FINE, _COARSE = 1, 4
"""Half widths in pixels over which slopes are taken."""
_LEAST_RATIO = 1.8
"""Least ratio of mean squared slopes over few and many pixels in a picture that is not blurred.
In pictures of five simulated pipes it is 2.2 to 5.0, and 0.5 to 1.6 with a blur of 2.5 pixels."""
_MOST_VEIL = 0.25
"""Largest grey of the darkest 1 % of a picture, over its mean: the pipe ahead is dark."""
_LIT = 40.0
"""Least grey level of wall whose texture is above the noise."""
_AREA, _SHARE, _FEWEST = 48, 0.8, 8
"""Side of a block in pixels, least lit share of a block, and fewest such blocks."""
_SECOND = np.array([[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]])
"""Mask that cancels edges; noise of variance 1 has the variance 36 after it."""
_DARK = 2.0
"""Grey level that is added before the logarithm, so that noise in the dark counts little."""
GOOD, WRONG_SIZE, BLACK, SATURATED, NO_PICTURE, FROZEN, TORN = (
    "good",
    "wrong size",
    "black",
    "saturated",
    "no picture",
    "frozen",
    "torn",
)
"""Verdicts on a frame."""

_DARK_LEVEL = 12
"""Largest grey level of the mean and of the cells of a black frame: one lit spot makes it not
black, the noise of a high gain does not."""
WHITE, _WHITE_SHARE = 250, 0.6
"""Grey level of a saturated pixel, since JPEG may lower it from 255; and share of them above which
a frame is saturated: glints and a bright wall have fewer."""
_STRIDE = 4  # pixels: a sixteenth of a frame is enough, and fast
_TEAR_FACTOR, _TEAR_LEAST = 3.0, 3.0
"""A tear is a median step to the next row above 3 times its neighbours plus 3 grey levels."""
# Mean squared step to the next pixel over the variance: near 0 for a picture, 2 for noise.
_EVEN, _ROUGH = 0.5, 1.5
_CELL, _BLOCK, _LEAST_GREY, _DIM = 16, 4, 10.0, 0.25
_ALIKE, _NOISE = 0.01, 0.3
"""Largest difference of two blocks under the same light, as a share and in grey levels: under the
same light the share was 0.006 at most, under different ones 0.039 at least in 30 views of the twin,
and 0.030 in 39 of path-traced walls, where light from other walls makes the LEDs more alike."""
_SUDDEN = 5.0
"""Least difference of the block next to a strip of the wrong light, which ends suddenly, in
multiples of the difference under the same light. In 150 path-traced scenes two LEDs were alike
about the middle of bare metal, and the blocks about it differed by at most 4 times that."""
_MOST = 0.9
"""Percentile of a row that ignores a dark part of it, and glints in a tenth of it."""
_EQUAL_ROWS, _ROW_GREY = 2, 4
"""Fewest equal rows of frames that share rows, and their least grey level: noise of a grey level
never repeats 160 pixels of a row, but near black it is clipped at 0. A strip has several rows."""

_KEPT = 16
"""Number of frames among which a repeated one counts as frozen."""


def repeated(
    image: npt.NDArray[np.uint8], earlier: tuple[int, ...]
) -> tuple[bool, tuple[int, ...]]:
    """Return whether a frame repeats one of the last ones, and their check sums with its own.

    ``image`` (height, width); ``earlier``: check sums of the frames before, the oldest first.
    """
    key = zlib.crc32(np.ascontiguousarray(image).tobytes())
    return key in earlier, (*earlier, key)[-_KEPT:]


def check_frame(
    image: Any, lens: Pinhole, before: npt.NDArray[np.uint8] | None = None, *, lit: bool = True
) -> str:
    """Return ``good``, or the fault of a frame.

    Faults are ``wrong size``, ``black``, ``saturated``, ``no picture``, ``frozen`` and ``torn``.
    ``no picture`` is an even grey, or noise without correlation of neighbours. A frame is torn if a
    row differs from the next, over most of its length, far more than its neighbours do; a tear in a
    still or dark picture is not detected.

    ``image`` (height, width): the frame; any other object has the wrong size. ``lens``: the lens,
    which has the size of a frame. ``before`` (height, width): the frame before; an equal frame is
    frozen, since noise never repeats itself. ``lit``: whether a light was on; a frame without light
    may be black.
    """
    whole = isinstance(image, np.ndarray) and image.dtype == np.uint8
    if not whole or image.shape != (lens.height, lens.width):
        return WRONG_SIZE
    few = image[::_STRIDE, ::_STRIDE]
    if lit and few.mean() < _DARK_LEVEL and not (shrunk(image, _CELL) > _DARK_LEVEL).any():
        return BLACK
    if (few >= WHITE).mean() > _WHITE_SHARE:
        return SATURATED
    if _without_picture(image[::_STRIDE]):
        return NO_PICTURE
    if before is not None and before.shape == image.shape and np.array_equal(before, image):
        return FROZEN
    return TORN if lit and _torn(image) else GOOD


def _torn(image: npt.NDArray[np.uint8]) -> bool:
    """Return whether one row jumps to the next."""
    few = image[:, ::_STRIDE]
    steps = np.median(opencv().absdiff(few[1:], few[:-1]), axis=1)
    padded = np.pad(steps, 2, mode="edge")
    around = np.maximum.reduce([padded[:-4], padded[1:-3], padded[3:-1], padded[4:]])
    return bool((steps > _TEAR_FACTOR * around + _TEAR_LEAST).any())


def _without_picture(few: npt.NDArray[np.uint8]) -> bool:
    """Return whether rows of a frame are of one grey or pure noise (von Neumann, 1941)."""
    spread = float(few[:, ::_STRIDE].std())
    if spread < _EVEN:
        return float(few.mean()) > _DARK_LEVEL
    # Noise of a dark frame is small.
    if spread < _DARK_LEVEL:
        return False
    left, right = few[:, :-1:_STRIDE].astype(np.int16), few[:, 1::_STRIDE]
    return float(np.square(right - left, dtype=np.float32).mean()) > _ROUGH * spread**2


@dataclass(frozen=True, eq=False)
class Brightness:
    """Brightness of a frame from top to bottom, for comparison with others."""

    cells: npt.NDArray[np.float32]
    """Shape (rows, columns). Mean greys of cells of 16 by 16 pixels."""
    blocks: npt.NDArray[np.float32]
    """Shape (rows - 3,). Maximum over four rows of the 90th percentile of the row."""

    @classmethod
    def of(cls, image: npt.NDArray[np.uint8]) -> Brightness:
        """Return the brightness of a frame."""
        cells = shrunk(image, _CELL)
        return cls(cells, _blocks(cells))


def same_light(one: Brightness, other: Brightness) -> str:
    """Check that two frames taken under different lights differ.

    Returns ``good`` if they differ from top to bottom, ``torn`` if they are alike in some block of
    rows and differ in one next to it, ``frozen`` if they are alike in all. Dark blocks are ignored.
    """
    grey = np.minimum(one.blocks, other.blocks)
    known = (grey >= _LEAST_GREY) & (grey < WHITE)
    apart = _blocks(np.abs(one.cells - other.cells)) / (_ALIKE * grey + _NOISE)
    alike = known & (apart < 1.0)
    if not (alike == known).all():
        near = np.pad(apart, _BLOCK, mode="edge")
        near = np.lib.stride_tricks.sliding_window_view(near, 2 * _BLOCK + 1)
        alike &= near.max(axis=1) > _SUDDEN
    return _all_or_some(alike, known, FROZEN)


def less_light(more: Brightness, fewer: Brightness) -> str:
    """Check that a frame is not darker than another, taken with fewer of its lights.

    Returns ``good`` if no block of rows is, ``torn`` if some are, ``black`` if all are.
    """
    known = fewer.blocks >= _LEAST_GREY
    return _all_or_some(known & (more.blocks < _DIM * fewer.blocks), known, BLACK)


def _all_or_some(bad: npt.NDArray[np.bool_], known: npt.NDArray[np.bool_], verdict: str) -> str:
    if not bad.any():
        return GOOD
    return verdict if bad.sum() == known.sum() else TORN


def _blocks(cells: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return the maximum over four rows of the 90th percentile of the row."""
    if cells.shape[0] < _BLOCK or cells.shape[1] == 0:
        return np.empty(0, dtype=np.float32)
    rank = int(_MOST * (cells.shape[1] - 1))
    rows = np.partition(cells, rank, axis=1)[:, rank]
    return np.asarray(np.lib.stride_tricks.sliding_window_view(rows, _BLOCK).max(axis=1))


def shares_rows(one: npt.NDArray[np.uint8], other: npt.NDArray[np.uint8]) -> bool:
    """Return whether rows of two frames are equal, which noise rules out for different frames."""
    few, rest = one[::_STRIDE], other[::_STRIDE]
    # A few pixels distinguish most rows.
    likely = np.flatnonzero((few[:, ::_CELL] == rest[:, ::_CELL]).all(axis=1))
    equal = few[likely][(few[likely] == rest[likely]).all(axis=1)]
    middle = np.median(equal, axis=1) if len(equal) else np.empty(0)
    return bool(((middle >= _ROW_GREY) & (middle < WHITE)).sum() >= _EQUAL_ROWS)


def clarity(image: Image) -> str:
    """Return ``clear``, ``blurred`` or ``veiled``.

    A picture with too little lit wall to tell is ``clear``; one of a wall without texture is
    ``blurred``.

    ``image`` (height, width): along a pipe under all lights, in focus, so that the dark pipe ahead
    is in it.

    Notes
    -----
    The wall has texture of all sizes, so that its slopes over few pixels are steeper than over
    many, unless it is blurred; the median over blocks counts. Noise is estimated by Immerkaer, Fast
    noise variance estimation, 1996, and subtracted. A veil is light that the lens scatters: it
    brightens dark parts.
    """
    grey = np.asarray(image, dtype=np.float64)
    if np.percentile(grey, 1) > _MOST_VEIL * grey.mean():
        return VEILED
    logarithm = np.log(grey + _DARK)
    lit = uniform_filter(grey, 2 * _COARSE + 1) > _LIT
    lit &= ~maximum_filter(np.asarray(image) >= WHITE, 2 * _COARSE + 1)
    shares = _area_means(lit)
    usable = shares > _SHARE
    if usable.sum() < _FEWEST:
        return CLEAR
    noise = _area_means(convolve(grey, _SECOND) ** 2 / 36 / (grey + _DARK) ** 2)
    fine, coarse = (
        _area_means(_squared_slope(logarithm, half)) - noise / ((2 * half + 1) * half) ** 2
        for half in (_FINE, _COARSE)
    )
    ratio = float(np.median(fine[usable] / np.maximum(coarse[usable], 1e-12)))
    return CLEAR if ratio > _LEAST_RATIO else BLURRED


def _squared_slope(values: FloatArray, half: int) -> FloatArray:
    """Return the squared slope of means over 2 half + 1 pixels, taken over as many as these."""
    means, step = uniform_filter(values, 2 * half + 1), 2 * half
    down = np.zeros_like(values)
    across = np.zeros_like(values)
    down[half:-half] = means[step:] - means[:-step]
    across[:, half:-half] = means[:, step:] - means[:, :-step]
    return np.asarray((down**2 + across**2) / step**2)


def _area_means(values: npt.NDArray[np.generic]) -> FloatArray:
    """Return means over whole blocks; a rest at the far edges is left out."""
    rows, columns = (size // _AREA for size in values.shape)
    part = values[: rows * _AREA, : columns * _AREA].astype(np.float64)
    return np.asarray(part.reshape(rows, _AREA, columns, _AREA).mean(axis=(1, 3)))
