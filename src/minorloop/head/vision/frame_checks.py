"""Whether a frame can be used at all: verdicts, never an exception.

Black, saturated, frozen, torn and wrongly sized frames happen to every camera on a long cable, and
so do greys and noise without a picture; whoever uses frames in a loop asks here first and carries
on without the frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.head.geometry import Pinhole
from minorloop.head.vision import _kernels

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

_DARK_LEVEL, _DARK_SHARE = 12, 0.002
_WHITE, _WHITE_SHARE = 250, 0.6
_STRIDE = 4
_TEAR_FACTOR, _TEAR_LEAST = 3.0, 3.0
# A picture of the wall has neighbours that are nearly alike, noise a ratio of 2.
_EVEN, _ROUGH = 0.5, 1.5
# Shares of the grey of a block by which two frames of it differ: 0.028 at most where the light is
# the same, 0.064 at least where it is another, in 80 views of the twin.
_CELL, _BLOCK, _LEAST_GREY, _ALIKE, _DIM = 16, 4, 10.0, 0.035, 0.25
_MOST, _EQUAL_ROWS, _ROW_GREY = 0.9, 2, 4


def judge(
    image: Any, lens: Pinhole, before: npt.NDArray[np.uint8] | None = None, *, lit: bool = True
) -> str:
    """Say whether a frame can be used.

    Parameters
    ----------
    image : (height, width) array of uint8
        What the camera gave; anything at all is judged.
    lens : Pinhole
        Tells the size that a frame should have.
    before : (height, width) array of uint8, optional
        The frame before; noise never repeats itself, so that an equal frame is a frozen one.
    lit : bool
        Whether light was on; a frame without light may be black.

    Returns
    -------
    str
        ``good``, ``wrong size``, ``black``, ``saturated``, ``no picture``, ``frozen`` or
        ``torn``. No picture is one even grey, or noise of which no pixel tells of the next. A
        tear shows where one row differs from the next, over most of its length, far more than
        its neighbours do; one in a still or dark picture leaves no trace here.
    """
    whole = isinstance(image, np.ndarray) and image.dtype == np.uint8
    if not whole or image.shape != (lens.height, lens.width):
        return WRONG_SIZE
    few = image[::_STRIDE, ::_STRIDE]
    if lit and (few > _DARK_LEVEL).mean() < _DARK_SHARE:
        return BLACK
    if (few >= _WHITE).mean() > _WHITE_SHARE:
        return SATURATED
    if _without_picture(image[::_STRIDE]):
        return NO_PICTURE
    if before is not None and before.shape == image.shape and np.array_equal(before, image):
        return FROZEN
    return TORN if lit and _torn(image) else GOOD


def _torn(image: npt.NDArray[np.uint8]) -> bool:
    """Whether one row jumps to the next."""
    few = image[:, ::_STRIDE].astype(np.int16)
    steps = np.median(np.abs(np.diff(few, axis=0)), axis=1)
    padded = np.pad(steps, 2, mode="edge")
    around = np.maximum.reduce([padded[:-4], padded[1:-3], padded[3:-1], padded[4:]])
    return bool((steps > _TEAR_FACTOR * around + _TEAR_LEAST).any())


def _without_picture(few: npt.NDArray[np.uint8]) -> bool:
    """Whether rows of a frame are of one grey, or nothing but noise (von Neumann, 1941)."""
    spread = float(few[:, ::_STRIDE].std())
    if spread < _EVEN:
        return float(few.mean()) > _DARK_LEVEL
    # Noise of a dark frame is small.
    if spread < _DARK_LEVEL:
        return False
    left, right = few[:, :-1:_STRIDE].astype(np.int16), few[:, 1::_STRIDE]
    return float(np.square(right - left, dtype=np.float32).mean()) > _ROUGH * spread**2


@dataclass(frozen=True, eq=False)
class Greys:
    """How bright a frame is from top to bottom, for comparing it with others.

    Parameters
    ----------
    cells : (rows, columns) array of float32
        Mean greys of cells of 16 by 16 pixels.
    blocks : (rows - 3,) array of float32
        Grey that nine tenths of the cells do not exceed, in the brightest of four rows.
    """

    cells: npt.NDArray[np.float32]
    blocks: npt.NDArray[np.float32]

    @classmethod
    def of(cls, image: npt.NDArray[np.uint8]) -> Greys:
        """Those of a frame."""
        cells = np.empty((image.shape[0] // _CELL, image.shape[1] // _CELL), dtype=np.float32)
        _kernels.cell_means(np.ascontiguousarray(image), cells)
        return cls(cells, _blocks(cells))


def same_light(one: Greys, other: Greys) -> str:
    """Whether two frames that were taken under different lights show the same light.

    Returns
    -------
    str
        ``good`` where they differ from top to bottom, ``torn`` where a block of rows does not,
        ``frozen`` where none does. Blocks too dark to tell count for nothing.
    """
    grey = np.minimum(one.blocks, other.blocks)
    told = (grey >= _LEAST_GREY) & (grey < _WHITE)
    alike = told & (_blocks(np.abs(one.cells - other.cells)) < _ALIKE * grey)
    return _all_or_some(alike, told, FROZEN)


def less_light(more: Greys, fewer: Greys) -> str:
    """Whether a frame is dark where another, taken with some of its lights, is not.

    Returns
    -------
    str
        ``good`` where it is nowhere, ``torn`` where a block of rows is, ``black`` where all are.
    """
    told = fewer.blocks >= _LEAST_GREY
    return _all_or_some(told & (more.blocks < _DIM * fewer.blocks), told, BLACK)


def _all_or_some(bad: npt.NDArray[np.bool_], told: npt.NDArray[np.bool_], verdict: str) -> str:
    if not bad.any():
        return GOOD
    return verdict if bad.sum() == told.sum() else TORN


def _blocks(cells: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """What nine tenths of the cells of a row do not exceed, the most of four rows."""
    if cells.shape[0] < _BLOCK or cells.shape[1] == 0:
        return np.empty(0, dtype=np.float32)
    rank = int(_MOST * (cells.shape[1] - 1))
    rows = np.partition(cells, rank, axis=1)[:, rank]
    return np.asarray(np.lib.stride_tricks.sliding_window_view(rows, _BLOCK).max(axis=1))


def shares_rows(one: npt.NDArray[np.uint8], other: npt.NDArray[np.uint8]) -> bool:
    """Whether rows of a frame are exactly those of another; noise never repeats itself."""
    few, rest = one[::_STRIDE], other[::_STRIDE]
    # A few pixels tell most rows apart.
    likely = np.flatnonzero((few[:, ::_CELL] == rest[:, ::_CELL]).all(axis=1))
    equal = few[likely][(few[likely] == rest[likely]).all(axis=1)]
    middle = np.median(equal, axis=1) if len(equal) else np.empty(0)
    return bool(((middle >= _ROW_GREY) & (middle < _WHITE)).sum() >= _EQUAL_ROWS)
