"""A touch of the tracked point with the micro-tool from the console, and its messages.

Its mode is TRACK: leaving it ends the touch. The head turns until the tool would meet the wall at
the point. The camera process carries out the rest, as `minorloop_head.procedures.mark.Marking` does
for a rig. Every touch ends with a message.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop_head.console.messages import Pair
from minorloop_head.procedures import mark as touches
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.centre import Centring
from minorloop_head.procedures.mark import BEHIND, Marking, tool_pixel
from minorloop_head.procedures.steps import WITHIN
from minorloop_head.procedures.values import Reading
from minorloop_head.vision.tracking import SURELY

PATIENCE = 30.0
"""Longest duration of a stage in seconds: in the simulated pipe the head takes 5 to 12 s to come to
rest, and the tool 2 s to the wall and back."""
_UNSEEN = 0.5
"""Longest seconds without recognition of a point while the head comes to rest: on wall with little
texture one picture in ten fails, and a loaded machine is late. TRACK ends at 0.6 s."""
TOUCHED = "the tool has touched the wall, and is withdrawn"
_NOT_SHOWN = "the camera does not show its mark"
NO_CONTACT = (
    f"the tool was withdrawn: no contact up to {1e3 * BEHIND:g} mm behind the wall; "
    "if the point is in a hole, pick one beside it; if it is on plain wall, pick it again from "
    "nearer"
)
OUT_OF_REACH = (
    "the tool does not reach this point from here; move the catheter, or pick another point"
)


def marking(view: HeadCalibration) -> Marking:
    """Return the part of the procedure in the camera process; TRACK turns the head."""
    close = Centring.in_middle
    return Marking(calibration=view, close=close, patience=PATIENCE, unseen=_UNSEEN, tries=1)


def reaches(view: HeadCalibration, pixel: npt.ArrayLike, now: Reading) -> bool:
    """Return whether the tool reaches the wall at a pixel (2,)."""
    place = np.asarray(view.camera_at(now.place).place(pixel, *now.angles.tolist()))
    known = bool(np.isfinite(place).all())
    return known and Marking(calibration=view).angles(place, now.place) is not None


def servoed(view: HeadCalibration, pixel: Pair, now: Reading) -> FloatArray:
    """Return the pixel (2,) to be centred, so that the tool meets a point."""
    assert view.tool is not None
    met = tool_pixel(view, view.tool, now.place, now.angles)
    return np.asarray(np.asarray(pixel) - met + np.asarray(view.lens.centre))


def ended(verdict: str, off: float | None, score: float = 1.0) -> str:
    """Return the message on a touch.

    ``verdict``: of `Marking`. ``off``: distance of the mark from the picked point in metres; None
    if the mark is not seen. ``score``: of the recognition of the point when the touch began.
    """
    said = _ended(verdict, off)
    if score < SURELY:
        said += (
            f"; the point was hard to recognise, with a score of {score:.2f}, and "
            f"{SURELY:g} is sure: pick one that stands out"
        )
    return said


def _ended(verdict: str, off: float | None) -> str:
    if verdict == touches.TOUCHED:
        if off is None:
            return unmeasured(_NOT_SHOWN)
        most = f", farther than {1e3 * WITHIN:g} mm" if off > WITHIN else ""
        return TOUCHED.replace(",", f" {1e3 * off:.2f} mm from the picked point{most},")
    known = {touches.NO_CONTACT: NO_CONTACT, touches.BEYOND: OUT_OF_REACH}
    return known.get(
        verdict,
        "the tool was withdrawn: the head did not come to rest with the tool at the point in "
        f"{PATIENCE:g} s; move the catheter, or pick another point",
    )


def unmeasured(why: str) -> str:
    """Return the message on a touch whose mark was not measured."""
    return f"{TOUCHED}; its distance from the picked point is not known: {why}"
