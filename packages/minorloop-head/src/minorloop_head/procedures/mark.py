"""Touch a place of the wall with the point of the micro-tool, which leaves a mark there.

The tool is beside the lens, so that the head turns the tool to the place, not the optical axis.
Calibration gives the pixel at which the tool would meet the wall. The head turns until the tracked
place is at that pixel. After the touch, the mark is searched in the picture: its distance from the
expected place is the error of the tool's calibration, which a test mark corrects (`Touch.tool`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError, SignalError
from minorloop_head.geometry import Tool, wall_point
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.centre import CONE, NOT_IN_VIEW, TWO_TICKS, Centring
from minorloop_head.procedures.go import go
from minorloop_head.procedures.meter import Light, acquisition, meter
from minorloop_head.procedures.values import (
    NOTHING,
    NOW,
    Procedure,
    Reading,
    Request,
    held_since,
    passed,
)
from minorloop_head.vision.calibrated_camera import Image
from minorloop_head.vision.new_mark import new_mark
from minorloop_head.vision.recentre import FOUND, outline_about
from minorloop_head.vision.servo import sighted_angles
from minorloop_head.vision.tracking import TRACKED, Track, TrackState

APPROACH = 0.6
"""Share of the deflection to which the head turns before the servo takes over. The servo then
approaches from the side of the axis and does not drive the head beyond the cone."""
TOUCHED, NO_TOOL, BEYOND = "touched", "no tool", "out of reach of the tool"
NO_CONTACT, UNSTEADY = "no contact", "not steady enough to touch"
"""Verdicts; others are those of the tracker."""
_BACK = math.radians(6.0)
"""Angle in radians by which both joints first stop before the place. A wire that was cooling would
oscillate about the place, across the dead zone of its loop."""
_STILL = 0.44
"""Seconds for which the place stays near before the point moves on."""
_GAP, BEHIND = 1e-3, 2e-3
"""Distance in metres before the wall at which the point waits so again; and depth in metres behind
the expected wall without contact at which it stops: that of the deepest pit."""
_SHARE, _LEAN = 0.36, 0.15
"""Weight of a frame in the wanted angles and the distance, and integral gain in 1/s that removes a
constant error. Wires settle in some seconds; at 0.4 1/s a wire oscillated across its dead zone."""
_MOST_LEAN = math.radians(2.0)
"""Limit of the integral: largest angle added to correct errors of the wire model."""
_INWARD = (0.0, 0.45, 0.6, 0.3, 0.15)
"""Positions of the tracked patch, as shares of the way from the feature to the middle of the
picture; each try begins with the next one. Near the edge the picture does not show the whole patch
about the feature, and the tool may hide a patch beside its point."""


def aim_at(
    calibration: HeadCalibration, place: npt.ArrayLike, catheter: npt.ArrayLike, share: float = 1.0
) -> FloatArray:
    """Return pan and tilt (2,), within the cone, of a share of the turn towards a place.

    ``place`` (2,): phi and z; ``catheter`` (2,): its advance and roll; ``share``: 1 looks at the
    place.
    """
    phi, z = np.asarray(place, dtype=np.float64).tolist()
    point = wall_point(phi, z, calibration.radius)
    return CONE.clip(share * np.array(calibration.mount_at(catheter).aim(point)))


def tool_pixel(
    calibration: HeadCalibration, tool: Tool, catheter: npt.ArrayLike, angles: npt.ArrayLike
) -> FloatArray:
    """Return the pixel (2,) at which a tool would meet the wall; NaN if its point is outside."""
    camera, (pan, tilt) = calibration.camera_at(catheter), np.asarray(angles).tolist()
    try:
        phi, z, _ = tool.meet(camera.mount, pan, tilt, calibration.radius)
    except ParameterError:
        return np.full(2, np.nan)
    return np.asarray(camera.pixel((phi, z), pan, tilt))


def seen_mark(
    calibration: HeadCalibration,
    catheter: npt.ArrayLike,
    contact: FloatArray,
    before: tuple[Image, FloatArray],
    after: tuple[Image, FloatArray],
) -> FloatArray | None:
    """Return phi and z (2,) of the mark of a touch; None if the pictures do not show it.

    Raises a `ParameterError` if the tool meets no wall there.

    ``calibration``: with a tool; ``catheter`` (2,): its advance and roll; ``contact`` (2,): pan and
    tilt at the contact; ``before``, ``after`` (2,): pictures, with pan and tilt of each.
    """
    camera, tool = calibration.camera_at(catheter), calibration.tool
    assert tool is not None
    pan, tilt = contact.tolist()
    expected = tool.meet(camera.mount, pan, tilt, camera.radius)[:2]
    return new_mark(camera, expected, before, after)


@dataclass(eq=False, kw_only=True)
class Touch:
    """State of a touch, which the procedure keeps up to date.

    ``place`` (2,) is phi and z of the feature, ``beside`` (2,) the metres around and along the wall
    from there to the point to be touched. ``tracked`` (2,) is phi and z of the tracked patch: that
    of the feature if the picture shows it whole. ``off`` (2,) is the smoothed distance in pixels
    between the point and the place where the tool would meet the wall. ``lean`` (2,) is the
    integral part of the ``wanted`` angles. The tool is extended to its ``stop``: back, near the
    wall, or as far as a contact may be. ``seen_at`` is the last time the patch was recognised.
    ``verdict`` is empty until the end, or says what the touch waits for. ``touch`` (2,) is phi and
    z of the contact by the picture, in the frame of ``place``: the mark, if the tool hid the patch.
    ``before`` is the last picture before the contact, with its angles; ``met`` (2,) are the angles
    at the contact. ``mark`` (2,) is the place of the mark in the picture after it, and ``tool`` the
    corrected tool, which would touch there; both are None if no mark is seen.
    """

    place: FloatArray
    beside: FloatArray = field(default_factory=lambda: np.zeros(2))
    tracked: FloatArray = field(default_factory=lambda: np.full(2, np.nan))
    track: TrackState | None = None
    outlined: bool = False
    stop: Literal["back", "near", "contact"] = "back"
    extension: float = 0.0
    seen_at: float = -math.inf
    wanted: FloatArray | None = None
    lean: FloatArray = field(default_factory=lambda: np.zeros(2))
    off: FloatArray = field(default_factory=lambda: np.full(2, np.nan))
    touch: FloatArray | None = None
    before: tuple[Image, FloatArray] | None = None
    met: FloatArray | None = None
    mark: FloatArray | None = None
    tool: Tool | None = None
    verdict: str = ""

    def target(self, place: FloatArray, radius: float) -> FloatArray:
        """Return phi and z of the point to be touched, for phi and z of the tracked patch."""
        metres = np.array([radius, 1.0])
        return np.asarray(place + self.place - self.tracked + self.beside / metres)

    def request(self, now: Reading) -> Request:
        """Return the request of the next tick: a frame in every other one, or for the contact."""
        frame = now.image is None or self.stop == "contact"
        return Request(angles=self.wanted, extension=self.extension, frame=frame)


@dataclass(frozen=True, kw_only=True, eq=False)
class Marking:
    """Turn the tool to a place, extend it until it touches the wall, and withdraw it."""

    calibration: HeadCalibration
    """Without a tool the verdict is ``no tool``."""
    close: float = 1.0
    """Largest distance in pixels for a touch: 1 of 640 is 0.03 mm across the way of the tool and
    0.07 mm along a wall that it meets at 25 degrees."""
    patience: float = 15.0
    """Longest duration of a stop in seconds; the tool is withdrawn then."""
    unseen: float = 0.0
    """Longest seconds without recognition of the patch while the place counts as near."""
    tries: int = 3
    """Largest number of turns to the place, if the head does not come to rest there or loses the
    tracked patch."""

    def touch(self, touch: Touch, light: Light) -> Procedure[Touch]:
        """Touch beside a place, with a camera that has a light; return the touch."""
        tool = self.calibration.tool
        if tool is None:
            touch.verdict = NO_TOOL
            return touch
        for tried in range(self.tries):
            now = yield from self._turn_and_pick(touch, tool, light, tried)
            again = tried + 1 < self.tries
            if now is None or (yield from self._try_touch(touch, tool, now, again=again)):
                break
        return touch

    def resume(self, touch: Touch) -> Procedure[Touch]:
        """Touch a point that is already tracked, with the tool of the head; return the touch."""
        tool = self.calibration.tool
        assert tool is not None
        yield from self._try_touch(touch, tool, (yield NOW), again=False)
        return touch

    def angles(self, place: npt.ArrayLike, catheter: npt.ArrayLike) -> FloatArray | None:
        """Return pan and tilt (2,) at which the tool meets phi and z (2,); None out of reach.

        ``catheter`` (2,) is the place of the catheter.
        """
        tool, where = self.calibration.tool, np.asarray(place, dtype=np.float64)
        guess = aim_at(self.calibration, where, catheter)
        return None if tool is None else self._angles(tool, where, catheter, guess)

    def _turn_and_pick(
        self, touch: Touch, tool: Tool, light: Light, tried: int
    ) -> Procedure[Reading | None]:
        """Turn the tool towards the place by the joints, and begin to track a patch there.

        Returns a reading with a frame; None if the place is out of reach or not in view. Each try
        first stops before the place: a wire may come to rest there, and the tool may not hide
        another patch.
        """
        touch.tracked, touch.outlined, touch.verdict = touch.place, False, ""
        touch.lean, touch.off, touch.seen_at = np.zeros(2), np.full(2, np.nan), -math.inf
        for short in (_BACK, 0.0):
            now = yield NOW
            target = touch.target(touch.tracked, self.calibration.radius)
            guess = aim_at(self.calibration, target, now.place)
            touch.wanted = self._angles(tool, target, now.place, guess)
            if touch.wanted is None:
                touch.verdict = BEYOND
                return None
            stop = CONE.clip(touch.wanted - short) if short else touch.wanted
            yield from go(angles=stop)
            yield Request(angles=stop)
        light.place = None
        yield from meter(self.calibration, light, last=NOTHING)
        frames = yield from acquisition(light.gain)
        now, last = (yield NOW), frames[-1]
        then = replace(now, angles=np.array([last.pan, last.tilt]))
        camera = self.calibration.camera_at(now.place)
        pixel = np.asarray(camera.pixel(touch.place, last.pan, last.tilt))
        hole = outline_about(frames, camera, pixel, reach=FOUND)
        if hole is not None:
            touch.place, pixel, touch.outlined = hole.place, hole.pixel, True
        for share in (*_INWARD[tried:], *_INWARD[:tried]):
            inner = pixel + share * (np.asarray(camera.lens.centre) - pixel)
            try:
                _, track = Centring(calibration=self.calibration).pick(last.image, inner, then)
            except SignalError:
                continue
            touch.track = track
            touch.tracked = track.home + touch.place - camera.place(pixel, last.pan, last.tilt)
            return (yield Request(frame=True))
        touch.verdict = NOT_IN_VIEW
        return None

    def _try_touch(self, touch: Touch, tool: Tool, now: Reading, *, again: bool) -> Procedure[bool]:
        """Touch the tracked place, withdraw the tool, and look for the mark.

        Returns False if the head did not come to rest and has to be turned there again.
        """
        met = yield from self._aim_until(touch, tool, now, lambda now, still: still)
        if met is not None:
            touch.stop, touch.extension = "near", max(met.free - _GAP, 0.0)
            now = yield touch.request(met.now)
            met = yield from self._aim_until(
                touch,
                tool,
                now,
                lambda now, still: still and now.extension >= touch.extension - 1e-4,
            )
        if met is not None:
            assert met.now.image is not None
            touch.before = met.now.image, self._angles_in_picture(touch, met.seen, met.now)
            touch.stop, touch.extension = "contact", min(met.free + BEHIND, tool.longest)
            now = yield touch.request(met.now)
            met = yield from self._aim_until(
                touch,
                tool,
                now,
                lambda now, _: now.touching or now.extension >= touch.extension - 1e-6,
            )
        elif again and touch.verdict != BEYOND:
            yield Request(extension=0.0)
            return False
        touch.stop, touch.extension = "back", 0.0
        if met is None:
            touch.verdict = touch.verdict or UNSTEADY
            now = yield Request(extension=0.0)
        else:
            touch.verdict = TOUCHED if met.now.touching else NO_CONTACT
            if met.now.touching:
                self._set_contact(touch, met)
            now = yield touch.request(met.now)
        yield from self._withdraw(touch, tool, now)
        return True

    def _aim_until(
        self, touch: Touch, tool: Tool, now: Reading, arrived: Callable[[Reading, bool], bool]
    ) -> Procedure[_Met | None]:
        """Aim the tool at the place until it has ``arrived``; return None after the `patience`.

        ``arrived`` takes a reading, and whether the place has stayed near. If the tool hides the
        tracked patch at the contact, it counts as touching.
        """
        since, near_since = now.t, None
        while not passed(since, now.t, self.patience):
            waits = False
            if now.image is not None and touch.track is not None:
                seen, touch.track = Centring(calibration=self.calibration).follow(
                    touch.track, now, now.image
                )
                if seen.verdict == TRACKED:
                    touch.verdict, touch.seen_at = "", now.t
                    near = self._steer(touch, tool, seen.place, now)
                    near_since = held_since(near_since, now.t, near)
                    hit = self._meeting_point(tool, now)
                    if hit is not None and arrived(now, passed(near_since, now.t, _STILL)):
                        return _Met(now, seen, hit)
                else:
                    waits = True
                    hidden = touch.stop == "contact" and now.touching
                    if hidden and passed(touch.seen_at, now.t, _STILL):
                        return _Met(now, seen)
                    touch.verdict = seen.verdict
                    if passed(touch.seen_at, now.t, self.unseen):
                        near_since = None
            request = touch.request(now)
            now = yield replace(request, extension=now.extension) if waits else request
        return None

    def _steer(self, touch: Touch, tool: Tool, place: FloatArray, now: Reading) -> bool:
        """Set the wanted angles, and return whether the tool would meet the wall near the point."""
        camera = self.calibration.camera_at(now.place)
        target, (pan, tilt) = touch.target(place, camera.radius), now.angles.tolist()
        angles = self._angles(tool, target, now.place, now.angles)
        pixel = tool_pixel(self.calibration, tool, now.place, now.angles)
        if angles is None or not np.isfinite(pixel).all():
            touch.verdict = BEYOND
            return False
        off = np.asarray(camera.pixel(target, pan, tilt)) - pixel
        touch.off = off if np.isnan(touch.off).any() else touch.off + _SHARE * (off - touch.off)
        before = angles if touch.wanted is None else touch.wanted - touch.lean
        lean = touch.lean + _LEAN * TWO_TICKS * (angles - now.angles)
        touch.lean = np.clip(lean, -_MOST_LEAN, _MOST_LEAN)
        touch.wanted = CONE.clip(before + _SHARE * (angles - before) + touch.lean)
        return float(np.hypot(*touch.off)) < self.close

    def _meeting_point(self, tool: Tool, now: Reading) -> FloatArray | None:
        """Return phi, z and extension (3,) where the tool would meet the wall; None if nowhere."""
        mount = self.calibration.mount_at(now.place)
        try:
            pan, tilt = now.angles.tolist()
            return tool.meet(mount, pan, tilt, self.calibration.radius)
        except ParameterError:
            return None

    def _set_contact(self, touch: Touch, met: _Met) -> None:
        """Note angles and place of a contact; the place is not known if the tool hides it."""
        touch.met = met.now.angles
        if met.seen.verdict == TRACKED and met.hit is not None:
            metres = np.array([self.calibration.radius, 1.0])
            off = met.hit[:2] - touch.target(met.seen.place, self.calibration.radius)
            touch.touch = touch.place + (touch.beside + off * metres) / metres
            touch.met = self._angles_in_picture(touch, met.seen, met.now)

    def _withdraw(self, touch: Touch, tool: Tool, now: Reading) -> Procedure[None]:
        """Withdraw the tool, then look for the mark."""
        since = now.t
        while not passed(since, now.t, self.patience):
            if touch.before is None or touch.met is None or touch.track is None:
                if now.extension <= 0.0:
                    return
            elif now.image is not None:
                seen, touch.track = Centring(calibration=self.calibration).follow(
                    touch.track, now, now.image
                )
                if now.extension <= 0.0 and seen.verdict == TRACKED:
                    after = now.image, self._angles_in_picture(touch, seen, now)
                    self._set_mark(touch, tool, now, after)
                    return
            now = yield touch.request(now)

    def _set_mark(
        self, touch: Touch, tool: Tool, now: Reading, after: tuple[Image, FloatArray]
    ) -> None:
        """Set the mark in a picture with its angles, and the corrected tool, if a mark is seen."""
        assert touch.before is not None
        assert touch.met is not None
        touch.mark = seen_mark(self.calibration, now.place, touch.met, touch.before, after)
        if touch.mark is None:
            return
        camera = self.calibration.camera_at(now.place)
        point = wall_point(float(touch.mark[0]), float(touch.mark[1]), camera.radius)
        touch.tool = tool.through(camera.mount.pose(*touch.met.tolist()).to_camera(point))
        touch.touch = touch.mark if touch.touch is None else touch.touch

    def _angles_in_picture(self, touch: Touch, seen: Track, now: Reading) -> FloatArray:
        """Return the angles (2,) that explain the place of the patch in the picture."""
        camera = self.calibration.camera_at(now.place)
        angles = sighted_angles(camera, touch.tracked, seen.pixel, now.angles)
        return now.angles if angles is None else angles

    def _angles(
        self, tool: Tool, place: FloatArray, catheter: npt.ArrayLike, guess: FloatArray
    ) -> FloatArray | None:
        """Return the angles at which the tool meets a place; None beyond the cone."""
        mount = self.calibration.mount_at(catheter)
        angles = tool.aim(mount, place, self.calibration.radius, guess)
        if angles is None or not np.hypot(*angles) <= CONE.half:
            return None
        pan, tilt = angles.tolist()
        _, _, length = tool.meet(mount, pan, tilt, self.calibration.radius).tolist()
        return angles if length + _GAP <= tool.longest else None


@dataclass(frozen=True, eq=False)
class _Met:
    """Track at a stop of the tool, and where the tool would meet the wall, if that is known."""

    now: Reading
    seen: Track
    hit: FloatArray | None = None

    @property
    def free(self) -> float:
        """Extension in metres at which the tool would meet the wall."""
        assert self.hit is not None
        return float(self.hit[2])
