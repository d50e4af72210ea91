"""A touch of the tracked point with the micro-tool from the console: what each tick does for it.

TRACK is its mode: leaving it ends the touch. The head turns until the point is where the tool would
meet the wall; then the tool extends until it touches, and is withdrawn; then the camera looks for
its mark. The camera process has the tool. Every touch ends with a sentence.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError
from minorloop.head.console.camera_protocol import CameraCommand
from minorloop.head.console.messages import Pair
from minorloop.head.procedures.calibration import HeadCalibration
from minorloop.head.procedures.centre import Centring
from minorloop.head.procedures.mark import Marking, tool_pixel
from minorloop.head.procedures.steps import WITHIN
from minorloop.head.procedures.values import Reading, held_since, passed

PATIENCE = 30.0
"""Longest duration in seconds: in the simulated pipe the head takes 5 to 12 s to come to rest, and
the tool 2 s to the wall and back."""
_UNSEEN_FOR = 0.5
"""Seconds for which a point may not be recognised while the head comes to rest: on wall with little
texture this is one picture of ten, and a loaded machine gives them late. TRACK ends at 0.6 s."""
_LOOK = 5.0
"""Longest duration in seconds of the withdrawal and of the search for the mark."""
TOUCHED = "the tool has touched the wall, and is withdrawn"
NOT_SHOWN = "the camera does not show its mark"
NO_CONTACT = (
    f"the tool was withdrawn: no contact up to {1e3 * Marking.beyond:g} mm behind the wall; "
    "pick a point beside the hole"
)
OUT_OF_REACH = (
    "the tool does not reach this point from here; move the catheter, or pick another point"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class ConsoleMark:
    """A touch in progress.

    Parameters
    ----------
    began : float
        Time in seconds.
    stage : str
        ``aim`` while the head turns, then ``touch``, and ``withdraw`` after it.
    off : (2,) array
        Smoothed distance of the point from where the tool would meet the wall, in pixels.
    seen_at : float
        When the point was recognised last.
    near_since : float, optional
        From when it has been near without a break.
    extending : bool
        Whether the tool is on its way.
    ended : str
        Why the touch has ended; empty until then.
    """

    began: float
    stage: Literal["aim", "touch", "withdraw"] = "aim"
    off: FloatArray
    seen_at: float
    near_since: float | None = None
    extending: bool = False
    ended: str = ""


def begin_mark(view: HeadCalibration, pixel: npt.ArrayLike, now: Reading) -> ConsoleMark | None:
    """Return a touch of what a pixel (2,) shows; None if the tool does not reach it."""
    place = np.asarray(view.camera_at(now.place).place(pixel, *now.angles.tolist()))
    if not np.isfinite(place).all() or not np.isfinite(_tool(view, now)).all():
        return None
    if Marking(calibration=view).angles(place, now.place) is None:
        return None
    return ConsoleMark(began=now.t, off=np.full(2, np.nan), seen_at=now.t)


def marked(
    mark: ConsoleMark, view: HeadCalibration, pixel: Pair | None, now: Reading
) -> tuple[ConsoleMark, list[CameraCommand]]:
    """Return the touch after a tick, and its commands to the camera process.

    Whoever ends a touch withdraws the tool.

    Parameters
    ----------
    mark : ConsoleMark
    view : HeadCalibration
        With a tool.
    pixel : (float, float), optional
        Where the tracked point is; None while it is not recognised.
    now : Reading
    """
    if mark.stage == "withdraw":
        late = passed(mark.began, now.t, _LOOK)
        return replace(mark, ended=unmeasured(NOT_SHOWN) if late else ""), []
    if passed(mark.began, now.t, PATIENCE):
        said = (
            "the tool was withdrawn: the head did not come to rest with the tool at the point in "
            f"{PATIENCE:g} s; move the catheter, or pick another point"
        )
        return replace(mark, ended=said), []
    mark = _seen(mark, view, pixel, now)
    near = pixel is not None and mark.near_since is not None
    if mark.stage == "aim":
        if not near or not passed(mark.near_since or 0.0, now.t, Centring.still):
            return mark, []
        mark = replace(mark, stage="touch")
    length = _length(view, now) if near else None
    if mark.extending == (length is not None):
        return mark, []
    # The tool waits where it is until the point is recognised again, at its place.
    command: CameraCommand = ("hold_tool", []) if length is None else ("extend", [length])
    return replace(mark, extending=length is not None), [command]


def touched(mark: ConsoleMark, now: Reading) -> ConsoleMark:
    """Return the touch after the contact: its mark is looked for."""
    return replace(mark, stage="withdraw", began=now.t, extending=False)


def measured(off: float | None) -> str:
    """Return the sentence on a touch whose mark is metres from the picked point, None if unseen."""
    if off is None:
        return unmeasured(NOT_SHOWN)
    most = f", farther than {1e3 * WITHIN:g} mm" if off > WITHIN else ""
    return TOUCHED.replace(",", f" {1e3 * off:.2f} mm from the picked point{most},")


def unmeasured(why: str) -> str:
    """Return the sentence on a touch whose mark was not measured."""
    return f"{TOUCHED}; its distance from the picked point is not known: {why}"


def servoed(view: HeadCalibration, pixel: Pair, now: Reading) -> FloatArray:
    """Return the pixel (2,) to be centred, so that a point gets to where the tool meets it."""
    return np.asarray(np.asarray(pixel) - _tool(view, now) + np.asarray(view.lens.centre))


def _seen(
    mark: ConsoleMark, view: HeadCalibration, pixel: Pair | None, now: Reading
) -> ConsoleMark:
    """Return the touch with what a picture shows of the point."""
    if pixel is None:
        lost = passed(mark.seen_at, now.t, _UNSEEN_FOR)
        return replace(mark, near_since=None if lost else mark.near_since)
    off = np.asarray(pixel) - _tool(view, now)
    smooth = off if np.isnan(mark.off).any() else mark.off + Marking.share * (off - mark.off)
    near = bool(np.hypot(*smooth) < Centring.in_middle)
    since = held_since(mark.near_since, now.t, near)
    return replace(mark, off=smooth, seen_at=now.t, near_since=since)


def _tool(view: HeadCalibration, now: Reading) -> FloatArray:
    """Return the pixel (2,) at which the tool would meet the wall; NaN if it would not."""
    assert view.tool is not None
    return tool_pixel(view, view.tool, now.place, now.angles)


def _length(view: HeadCalibration, now: Reading) -> float | None:
    """Return the extension in metres at which there is no contact, behind the wall."""
    assert view.tool is not None
    pan, tilt = now.angles.tolist()
    try:
        met = view.tool.meet(view.mount_at(now.place), pan, tilt, view.radius)
    except ParameterError:
        return None
    return min(float(met[2]) + Marking.beyond, view.tool.longest)
