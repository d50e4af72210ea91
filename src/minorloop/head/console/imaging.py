"""OpenCV, imported when it is first needed."""

from __future__ import annotations

from typing import Any

from minorloop.errors import MissingExtraError


def opencv() -> Any:
    """Return the module ``cv2``.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    try:
        import cv2
    except ImportError:
        raise MissingExtraError("opencv", "head") from None
    return cv2
