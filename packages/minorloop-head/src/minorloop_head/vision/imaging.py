"""OpenCV, imported when it is first needed, and filters of images."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import numpy.typing as npt

Image32 = npt.NDArray[np.float32]
_SILENT = {"OPENCV_LOG_LEVEL": "SILENT", "OPENCV_FFMPEG_LOGLEVEL": "-8"}
"""Level that keeps OpenCV from printing: this package reports its errors in sentences."""


def opencv() -> Any:
    """Return the module ``cv2``."""
    for name, value in _SILENT.items():
        os.environ.setdefault(name, value)
    import cv2

    return cv2


def gaussian(image: Image32, sd: float, truncate: float, *, zero: bool = False) -> Image32:
    """Return an image smoothed by a Gaussian.

    ``sd``: in pixels; ``truncate``: cut-off of the filter in standard deviations; ``zero``: whether
    the image continues with zeros instead of its mirror image.
    """
    cv2, side = opencv(), 2 * int(truncate * sd + 0.5) + 1
    beyond = cv2.BORDER_CONSTANT if zero else cv2.BORDER_REFLECT
    smooth: Image32 = cv2.GaussianBlur(image, (side, side), sd, borderType=beyond)
    return smooth


def shrunk(image: npt.NDArray[Any], side: int = 2) -> Image32:
    """Return means of ``side`` by ``side`` pixels; NaN where one of the pixels is NaN."""
    rows, columns = (size // side for size in image.shape)
    if not rows * columns:
        return np.empty((rows, columns), dtype=np.float32)
    cv2, whole = opencv(), image[: rows * side, : columns * side].astype(np.float32)
    means: Image32 = cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA)
    return means
