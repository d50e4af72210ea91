"""Steps with one candidate of a rig: go to it, centre, focus, extract and touch it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop_head.geometry import AXES, wall_distance, wall_point, wrapped
from minorloop_head.procedures.centre import CONE, TWO_TICKS, Centred, Centring
from minorloop_head.procedures.go import go as going
from minorloop_head.procedures.mark import APPROACH, TOUCHED, Marking, Touch, aim_at
from minorloop_head.procedures.meter import acquisition
from minorloop_head.procedures.meter import meter as metering
from minorloop_head.procedures.rig import InspectionRig
from minorloop_head.vision.calibrated_camera import CalibratedCamera, Image
from minorloop_head.vision.defects import Findings, Hole, find_holes
from minorloop_head.vision.recentre import FOUND
from minorloop_head.vision.reflectance_map import LitFrame
from minorloop_head.vision.tracking import TRACKED

_CENTRED = np.radians(23.0)
"""Deflection at which a candidate is centred, in radians."""
NEAR, FIRST = 6e-3, 1e-3
"""Advance of the near view beyond the place of centring, and least advance of the catheter, in
metres: drawn back further, its tip sticks."""
COLD, _SPARE = np.radians(135.0), 2.0
"""Direction in the image of the cold side of both wires, in radians from its x to its y axis; and
spare degrees of reach of a wire beyond a place, for tool and overshoot."""
_SHORT = 8.0
"""Largest error of a joint in degrees when looking in a direction: views overlap by more."""
REFUSED = "out of reach"
"""Verdict of a place that the head or its probe does not reach."""
CENTRED_PX, WITHIN = 2.0, 0.3e-3
"""Largest distance of a centred point from the middle of the image in pixels, and of a touch from
its place in metres."""
_STEADY_PX, _CENTRINGS = 0.8, 3
"""Tolerance in pixels of an outline in the first try, less than half of `CENTRED_PX`, since the
head moves on; and most tries until the outline, found anew, is in the middle. A wire with friction
does not hold it so near, and oscillates with an integral: later tries use `CENTRED_PX` and none."""
STEPS = (0.0, -3e-3, 3e-3, -6e-3, 6e-3)
"""Travels in metres, of which one lets the tool reach the middle of the image. The tool is 3.5 mm
beside the lens: 8 mm along a wall that it meets at 25 degrees."""
TURNS = np.radians((0.0, 45.0, -45.0, 90.0, -90.0, 135.0, -135.0, 180.0))
"""Rolls of the catheter, of which one turns a place to where the wires reach it with the tool."""
CLAIMED = ("centre", "touch", "reach", "scan")
"""Steps that must succeed for a defect to count as measured."""
_TESTED, _TEST_MARK = "test mark", (1.5e-3, 0.0)
"""Step of the log, and offset of the test mark from the pit, around and along the pipe in metres:
beside the largest pit, and near enough to have the error of the touch."""


@dataclass(frozen=True, eq=False)
class Photo:
    """An image, the calibrated camera, and the line of sight in radians."""

    image: npt.NDArray[np.uint8]
    camera: CalibratedCamera
    angles: tuple[float, float]

    def pixels(self, places: npt.ArrayLike) -> FloatArray:
        """Return columns and rows (..., 2) of places (..., 2) on the wall."""
        return np.asarray(self.camera.pixel(np.asarray(places), *self.angles))


def go(
    rig: InspectionRig, place: npt.ArrayLike | None = None, angles: npt.ArrayLike | None = None
) -> None:
    """Bring the catheter to a place (2,), advance and roll, or the head to angles (2,).

    A head without a catheter stays at its place.
    """
    rig.run(going(place if rig.travels else None, angles))


def look(rig: InspectionRig, name: str, angles: FloatArray) -> bool:
    """Turn the head to angles (2,) from a roll of 0; return whether it arrives.

    If it does not, the log says so under ``name``. The catheter then rolls until the head, at the
    angles that its wires reach, looks in the same direction round the pipe.
    """
    go(rig, angles=angles)
    need, has = (rig.calibration.joints(each) for each in (angles, rig.angles))
    short = np.abs(need - has) > _SHORT
    if not short.any():
        return True
    rig.most = np.where(short & (has < need), np.minimum(rig.most, has), rig.most)
    each = [
        f"{AXES[axis]} needs {need[axis]:.0f} degrees, has {has[axis]:.0f}"
        for axis in np.flatnonzero(short)
    ]
    said = f"{REFUSED}: {', '.join(each)}"
    wanted, now = (math.atan2(tilt, pan) for pan, tilt in (angles, rig.angles))
    roll = float(wrapped(wanted - now))
    if rig.travels and abs(roll) > math.radians(_SHORT):
        said += f"; rolled by {math.degrees(roll):.0f} degrees instead"
        go(rig, place=(rig.place[0], roll))
    rig.say(name, said, succeeded=False)
    return False


def meter(rig: InspectionRig, place: FloatArray | None = None) -> None:
    """Focus on the wall ahead, and set the gain for a middle grey of it, or of a place (2,)."""
    rig.light.place = place
    rig.run(metering(rig.calibration, rig.light))


def acquire(rig: InspectionRig) -> tuple[LitFrame, ...]:
    """Take five frames under switched lights; the last one is under all."""
    return rig.run(acquisition(rig.light.gain))


def search(rig: InspectionRig, frames: Sequence[LitFrame] | None = None) -> Findings:
    """Return the findings in five frames, which are taken if they are not given."""
    taken, camera = frames or acquire(rig), rig.calibration.camera_at(rig.place)
    return rig.compute(lambda: find_holes(taken, camera))


def photo(rig: InspectionRig) -> Photo:
    """Take a photo."""
    now, image = rig.look()
    pan, tilt = now.angles.tolist()
    return Photo(image, rig.calibration.camera_at(now.place), (pan, tilt))


def approach(rig: InspectionRig, place: FloatArray) -> None:
    """Go to where a place (2,) is within the cone, and turn towards it."""
    go(rig, place=_place_before(rig, place))
    go(rig, angles=aim_at(rig.calibration, place, rig.place, APPROACH))


def pick(rig: InspectionRig, place: FloatArray, words: str) -> tuple[Image, FloatArray]:
    """Go to where a place is within the cone, turn towards it, and return image and pixel."""
    approach(rig, place)
    meter(rig, place)
    rig.say("pick", f"{place_words(place)}, {words}")
    seen = photo(rig)
    return seen.image, seen.pixels(place)


def place_words(place: FloatArray) -> str:
    """Return phi and z (2,) of the wall in words."""
    return f"phi {np.degrees(wrapped(place[0])):.1f} deg, z {1e3 * place[1]:.2f} mm"


def _place_before(rig: InspectionRig, place: FloatArray) -> FloatArray:
    """Return advance and roll (2,) of the catheter before a place.

    It rolls only if the wires do not turn the head to the place from a roll of 0. The place is then
    on the side where they are cold.
    """
    view = rig.calibration
    ahead = float(place[1]) - view.radius / np.tan(_CENTRED)
    there = np.array([max(ahead, FIRST), 0.0])
    wanted = view.joints(aim_at(view, place, there))
    least, most = rig.control.reach(wanted).T
    most = np.minimum(most, rig.most)
    if (wanted > most - _SPARE).any() or (wanted < least).any():
        there[1] = float(wrapped(place[0] - COLD - view.roll))
    return there


def centre(rig: InspectionRig, place: FloatArray, *, outlined: bool = False) -> None:
    """Centre a place of the wall in the image.

    If the place is lost, white, or cut off by the edge of the picture, the joints turn the head
    there, the gain is set for the place, and the picture is tried again.

    The step is out of reach where the place stays beside the middle because it is beyond the cone.

    ``place`` (2,): phi and z. ``outlined``: whether to centre the middle of the round outline there
    instead, if there is one: places from another view are some pixels off. The outline is then
    found anew in the middle of the picture, and centred again if it is not in the middle.
    """
    centring = Centring(calibration=rig.calibration, interval=TWO_TICKS)
    if outlined:
        centring = replace(centring, in_middle=_STEADY_PX)
    pixel = None
    for _ in range(_CENTRINGS):
        if outlined and pixel is None:
            pixel = _outlined(rig, centring, place)
        found = rig.run(centring.centre(Centred(place=place, shown=pixel)))
        if found.verdict != TRACKED:
            pixel = None
            go(rig, angles=aim_at(rig.calibration, place, rig.place))
            meter(rig, place)
            continue
        if not outlined or found.stuck or _beyond(rig, found):
            break
        place, pixel = found.place, _outlined(rig, centring, found.place)
        lens = rig.calibration.lens
        off = lens.off_axis(lens.normalised(pixel))
        found = replace(found, error=max(off, found.error))
        if found.error <= centring.in_middle:
            break
        centring = replace(centring, in_middle=CENTRED_PX, integral_gain=0.0)
    _log_centred(rig, found)


def _beyond(rig: InspectionRig, found: Centred) -> bool:
    """Return whether a tracked point stays beside the middle because it is beyond the cone."""
    phi, z = found.place.tolist()
    point = wall_point(phi, z, rig.calibration.radius)
    off = np.hypot(*rig.calibration.mount_at(rig.place).aim(point))
    return bool(found.error > CENTRED_PX and off > CONE.half)


def _outlined(rig: InspectionRig, centring: Centring, place: FloatArray) -> FloatArray:
    """Return the pixel (2,) in the middle of the round outline about a place in a new picture."""
    now, image = rig.look()
    camera = rig.calibration.camera_at(now.place)
    guess = np.asarray(camera.pixel(place, *now.angles.tolist()))
    frame = LitFrame(image, *now.angles.tolist())
    return rig.compute(lambda: centring.outlined([frame], guess, now, reach=FOUND))


def _log_centred(rig: InspectionRig, found: Centred) -> None:
    """Log the distance from the middle, or why the picture does not give it."""
    if found.verdict != TRACKED:
        words = f"{found.verdict} in {_CENTRINGS} tries; turned there by the joints alone"
        rig.say("centre", words, succeeded=False)
    else:
        lens = rig.calibration.lens
        words = f"{found.error:.1f} px from the middle of {lens.width} by {lens.height}"
        good = found.error <= CENTRED_PX
        words += "" if good else f", more than {CENTRED_PX:g}"
        beyond = f"{REFUSED}: " if _beyond(rig, found) else ""
        rig.say("centre", f"{beyond}{words}", succeeded=good)


def bring_in_reach(rig: InspectionRig, marking: Marking, where: npt.ArrayLike) -> None:
    """Bring the catheter to where the tool reaches phi and z (2,), if it does not from here.

    It travels, and rolls only if that is not enough: both wires must reach the angles of the tool.

    ``where`` (2,).
    """
    home = rig.place
    for turn, by in product(TURNS, STEPS):
        place = home + np.array([by, turn])
        if (by and place[0] < FIRST) or not _in_reach(rig, marking, where, place):
            continue
        if by or turn:
            go(rig, place=place)
        return


def _in_reach(
    rig: InspectionRig, marking: Marking, where: npt.ArrayLike, place: FloatArray
) -> bool:
    """Return whether the wires turn the tool to phi and z (2,) from a place of the catheter."""
    angles = marking.angles(where, place)
    if angles is None:
        return False
    wanted = rig.calibration.joints(angles)
    least, most = rig.control.reach(wanted).T
    return bool((wanted > least + _SPARE).all() and (wanted < most - _SPARE).all())


def touch(rig: InspectionRig, hole: Hole) -> None:
    """Touch a hole with the point of the tool.

    The catheter travels and rolls to where the tool reaches it, if it does not from here. The first
    touch of a rig comes after one of the wall beside it, whose mark gives the error of the tool.
    """
    if not any(entry.what == _TESTED for entry in rig.log):
        _test_tool(rig, hole)
    marking = Marking(calibration=rig.calibration)
    bring_in_reach(rig, marking, hole.place)
    found = rig.run(marking.touch(Touch(place=hole.place), rig.light))
    off = math.inf
    if found.verdict == TOUCHED and found.touch is not None:
        off = float(wall_distance(found.touch, hole.place, rig.calibration.radius))
    words = found.verdict if off < WITHIN or math.isinf(off) else f"{1e3 * off:.2f} mm beside"
    rig.say("touch", f"{place_words(hole.place)}: {words}", succeeded=off <= WITHIN)


def _test_tool(rig: InspectionRig, hole: Hole) -> None:
    """Set a mark beside a hole, and correct the calibration of the tool by its place."""
    view, metres = rig.calibration, np.array([rig.calibration.radius, 1.0])
    marking = Marking(calibration=view)
    bring_in_reach(rig, marking, hole.place + np.array(_TEST_MARK) / metres)
    found = rig.run(marking.touch(Touch(place=hole.place, beside=np.array(_TEST_MARK)), rig.light))
    words = found.verdict
    if found.tool is not None and view.tool is not None:
        rig.calibration = replace(view, tool=found.tool)
        moved = 1e3 * float(np.linalg.norm(np.subtract(found.tool.offset, view.tool.offset)))
        words = f"the tool is {moved:.2f} mm beside its expected place"
    rig.say(_TESTED, words)
