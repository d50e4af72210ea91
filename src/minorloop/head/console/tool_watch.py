"""The micro-tool in the camera process: what it meets, and how far its mark is from the point."""

from __future__ import annotations

from typing import Any, TypeAlias

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError
from minorloop.head.geometry import wall_distance
from minorloop.head.procedures.calibration import HeadCalibration
from minorloop.head.procedures.mark import seen_mark
from minorloop.head.procedures.values import Reading, Request, Tip, ToolTip, apply_to_tip
from minorloop.head.vision.calibrated_camera import Image
from minorloop.head.vision.tracking import TrackState

Sight: TypeAlias = tuple[Image, FloatArray]
"""A picture of the tracked point, and the angles (2,) at which it is where the picture shows it."""


class ToolWatch:
    """Extends the tool, and looks for its mark after a touch.

    Parameters
    ----------
    tip : Tip
    view : HeadCalibration
    """

    def __init__(self, tip: Tip, view: HeadCalibration) -> None:
        self._tip, self._view = tip, view
        self._extending = 0.0
        self._sight: Sight | None = None
        self._seen = False
        self.forget()

    def forget(self) -> None:
        """Look for no mark of a touch before."""
        self._before: Sight | None = None
        self._contact: FloatArray | None = None
        self._touched = False

    def extend(self, length: float) -> None:
        """Extend the tool to a length in metres, or withdraw it.

        Raises
        ------
        MinorloopError
            If there is no tool, or the length is out of its range.
        """
        apply_to_tip(self._tip, Request(extension=length))
        if self._touched == (length > 0.0):  # another touch begins, or one ends without a contact
            self.forget()
        if length > 0.0 and self._before is None:
            self._before = self._sight
        self._extending = length

    def hold(self) -> None:
        """Let the tool wait where it is."""
        if isinstance(self._tip, ToolTip):
            self.extend(self._tip.tool_state()[0])
        self._extending = 0.0

    def see(self, reading: Reading, track: TrackState) -> None:
        """Take a reading whose picture shows the tracked point."""
        assert reading.image is not None
        self._sight, self._seen = (reading.image, reading.angles + track.turn), True

    def watch(self, reading: Reading, track: TrackState | None) -> dict[str, Any]:
        """Return the event of this tick; empty without one.

        It is ``touched`` or ``no contact`` once the tool meets the wall or does not, and ``marked``
        once it is withdrawn after a touch: ``off`` is the distance in metres of the mark from the
        tracked point as it was picked, None if the picture does not show the mark.
        """
        seen, self._seen = self._seen, False
        if not isinstance(self._tip, ToolTip) or not (self._extending or self._touched):
            return {}
        extension, touching = self._tip.tool_state()
        if self._extending:
            if not touching and extension < self._extending:
                return {}
            self._extending, self._touched = 0.0, touching
            if touching and track is not None:
                self._contact = reading.angles + track.turn
            return {"what": "touched" if touching else "no contact"}
        if extension > 0.0 or not (seen or track is None):
            return {}
        off = None if track is None else self._off(reading, track)
        self.forget()
        return {"what": "marked", "off": off}

    def _off(self, reading: Reading, track: TrackState) -> float | None:
        before, contact, after = self._before, self._contact, self._sight
        if before is None or contact is None or after is None:
            return None
        try:
            mark = seen_mark(self._view, reading.place, contact, before, after)
            # The edge of a pit may be off by a pixel: it is as much brighter as it is darker.
            brighter = seen_mark(self._view, reading.place, contact, after, before)
        except ParameterError:  # the tool would meet no wall there
            return None
        return (
            None
            if mark is None or brighter is not None
            else float(wall_distance(mark, track.home, self._view.radius))
        )
