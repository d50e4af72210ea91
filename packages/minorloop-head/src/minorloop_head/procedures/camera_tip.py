"""A tip whose pictures come from another camera than its own."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from minorloop.errors import InstrumentError
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.values import Tip
from minorloop_head.sources import Frame, Shot
from minorloop_head.vision.calibrated_camera import Image
from minorloop_head.vision.frame_checks import (
    BLACK,
    FROZEN,
    NO_PICTURE,
    SATURATED,
    TORN,
    WRONG_SIZE,
    check_frame,
)
from minorloop_head.vision.video import LiveCamera

_SAID = {
    FROZEN: "repeats the same picture; restart it",
    f"{BLACK}, {FROZEN}": "repeats the same black picture; check its lights, or restart it",
    f"{SATURATED}, {FROZEN}": "repeats the same white picture; check its exposure, or restart it",
    TORN: "gives torn pictures; check its cable",
    NO_PICTURE: "gives noise or an even grey; check its cable",
}


class CameraTip:
    """Lights, focus and probe of a tip, and the pictures of a camera, which are checked.

    ``view``: of the camera.
    """

    def __init__(self, tip: Tip, camera: LiveCamera, view: HeadCalibration) -> None:
        self._tip, self._camera = tip, camera
        self._lens, self._latency = view.lens, view.latency
        self._before: Image | None = None
        self._lit, self._settled = True, 0.0

    def frame(self) -> Frame:
        """Return the newest picture under the present lights; wait for it after they were switched.

        Raises an `InstrumentError` as `newest` does.
        """
        while (found := self.newest()) is None:
            pass
        return found

    def newest(self) -> Frame | None:
        """Return the newest picture; None if it may show the lights before they were switched.

        Raises an `InstrumentError` if none comes in time, or it has another size than calibrated,
        repeats the last one, is torn, or is no picture.
        """
        found = self._camera.frame()
        if found.t < self._settled:
            return None
        verdict = check_frame(found.image, self._lens, self._before, lit=self._lit)
        before = self._before
        if verdict in (BLACK, SATURATED) and before is not None:
            verdict += f", {FROZEN}" if np.array_equal(found.image, before) else ""
        self._before = found.image
        if verdict == WRONG_SIZE:
            height, width = found.image.shape
            self._camera.renew()
            raise InstrumentError(
                f"{self._camera.address} gives pictures of {width} by {height} pixels and was "
                f"calibrated with {self._lens.width} by {self._lens.height}; set its size, or give "
                "its calibration with --head"
            )
        if verdict in _SAID:
            raise InstrumentError(f"{self._camera.address} {_SAID[verdict]}")
        return found

    def switch(self, lights: Sequence[bool]) -> None:
        """Set which lights are on from the next frame."""
        self._lit = any(lights)
        self._tip.switch(lights)
        self._settled = time.monotonic() + self._latency

    def expose(self, exposure: float, gain: float = 1.0) -> None:
        """Set exposure time in seconds and gain of the camera."""
        self._camera.expose(exposure, gain)

    def move_to(self, stance: tuple[float, ...]) -> None:
        """Take over the pose of the plant."""
        self._tip.move_to(stance)

    def focus_at(self, distance: float) -> None:
        """Set the focus of the tip to a distance in metres."""
        self._tip.focus_at(distance)

    def flood(self, on: bool) -> None:
        """Fill the pipe with water for the probe, or drain it."""
        self._tip.flood(on)

    def shots(self, count: int) -> list[Shot]:
        """Fire pulses, one after the other."""
        return self._tip.shots(count)
