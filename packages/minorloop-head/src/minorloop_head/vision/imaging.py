"""OpenCV, imported when it is first needed."""

from __future__ import annotations

import os
from typing import Any

_SILENT = {"OPENCV_LOG_LEVEL": "SILENT", "OPENCV_FFMPEG_LOGLEVEL": "-8"}
"""What keeps OpenCV from printing: its errors are reported here, in sentences."""


def opencv() -> Any:
    """Return the module ``cv2``."""
    for name, value in _SILENT.items():
        os.environ.setdefault(name, value)
    import cv2

    return cv2
