"""Whether a frame can be used at all: verdicts, never an exception.

Black, saturated, frozen, torn and wrongly sized frames happen to every camera on a long cable;
whoever uses frames in a loop asks here first and carries on without the frame.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.geometry import Pinhole

GOOD, WRONG_SIZE, BLACK, SATURATED, FROZEN, TORN = (
    "good",
    "wrong size",
    "black",
    "saturated",
    "frozen",
    "torn",
)
"""Verdicts on a frame."""

_DARK_LEVEL, _DARK_SHARE = 12, 0.002
_WHITE_SHARE = 0.6
_STRIDE = 4
_TEAR_FACTOR, _TEAR_LEAST = 3.0, 3.0


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
        ``good``, ``wrong size``, ``black``, ``saturated``, ``frozen`` or ``torn``. A tear shows
        where one row differs from the next, over most of its length, far more than its
        neighbours do; one in a still or dark picture leaves no trace.
    """
    whole = isinstance(image, np.ndarray) and image.dtype == np.uint8
    if not whole or image.shape != (lens.height, lens.width):
        return WRONG_SIZE
    few = image[::_STRIDE, ::_STRIDE]
    if lit and (few > _DARK_LEVEL).mean() < _DARK_SHARE:
        return BLACK
    if (few == 255).mean() > _WHITE_SHARE:
        return SATURATED
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
