"""Cameras in ``minorloop devices``."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from minorloop.devices import DeviceRow
from minorloop.errors import MinorloopError

_CAMERAS = "dev/video*"
_FIRST_PICTURE = 5.0
"""Longest time in seconds to the first picture of a camera."""


def found() -> Iterator[DeviceRow]:
    """Yield the cameras of this machine."""
    for path in sorted(Path("/").glob(_CAMERAS)):
        yield DeviceRow(f"camera:{path}", "camera", "there; not opened")


def probed(address: str) -> DeviceRow | None:
    """Return the size of a picture of a camera, a video or a folder, or why it has no picture."""
    if not address.startswith("camera:") and not Path(address).exists():
        return None
    from minorloop_head.vision.video import LiveCamera

    try:
        camera = LiveCamera(address, patience=_FIRST_PICTURE)
        try:
            height, width = camera.frame().image.shape
            timed = "by the camera" if camera.timed_by_camera else "when they arrive"
        finally:
            camera.close()
    except MinorloopError as error:
        return DeviceRow(address, "camera", str(error), error=True)
    return DeviceRow(address, "camera", f"pictures of {width} by {height} pixels, timed {timed}")
