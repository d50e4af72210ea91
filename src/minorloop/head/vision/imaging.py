"""OpenCV, imported when it is first needed."""

from __future__ import annotations

import os
from typing import Any

from minorloop.errors import MissingExtraError

_SILENT = {"OPENCV_LOG_LEVEL": "SILENT", "OPENCV_FFMPEG_LOGLEVEL": "-8"}
"""What keeps OpenCV from printing: its errors are reported here, in sentences."""


def opencv() -> Any:
    """Return the module ``cv2``.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    for name, value in _SILENT.items():
        os.environ.setdefault(name, value)
    try:
        import cv2
    except ImportError:
        raise MissingExtraError("opencv", "head") from None
    return cv2
