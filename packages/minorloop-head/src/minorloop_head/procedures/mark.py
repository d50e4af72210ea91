"""Touch a place of the wall with the point of the micro-tool, which leaves a mark there.

The tool is beside the lens, so that the head turns the tool to the place, not the optical axis.
Picture and calibration give the pixel at which the tool would meet the wall; the head turns until
the place, which is tracked, is at that pixel. After the touch the mark is looked for in the
picture: where it is, less where it was expected, is the error of the tool's calibration, which a
test mark corrects (`MarkState.tool`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError, SignalError
from minorloop_head.geometry import Tool, wall_point
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.centre import CONE, NOT_IN_VIEW, TWO_TICKS, Centring
from minorloop_head.procedures.extract import Acquisition, AcquisitionState
from minorloop_head.procedures.go import GO, Go, GoState
from minorloop_head.procedures.meter import Metering, MeterState
from minorloop_head.procedures.values import Procedure, Reading, Request, held_since, passed
from minorloop_head.vision.calibrated_camera import Image
from minorloop_head.vision.new_mark import new_mark
from minorloop_head.vision.recentre import FOUND, outline_about
from minorloop_head.vision.sighting import sighted_angles
from minorloop_head.vision.tracking import TRACKED, Track, TrackState

APPROACH = 0.6
"""Share of the deflection to which the head turns before the servo takes over. The servo then
approaches from the side of the axis and does not drive the head beyond the cone."""
TOUCHED, NO_TOOL, BEYOND = "touched", "no tool", "out of reach of the tool"
NO_CONTACT, UNSTEADY = "no contact", "not steady enough to touch"
"""Verdicts; others are those of the tracker."""
_MOST_LEAN = math.radians(2.0)
"""Largest angle that is added for a head that stays off, as wires do whose model errs."""
_INWARD = (0.0, 0.45, 0.6, 0.3, 0.15)
"""Shares of the way from the feature to the middle of the picture where a patch to be tracked is
looked for, each try beginning with the next one: at its edge the picture does not show the whole
patch about the feature, and the tool may hide a patch beside its point."""

MarkStage: TypeAlias = Literal[
    "back", "turn", "meter", "outline", "aim", "near", "contact", "withdraw"
]


def aim_at(
    calibration: HeadCalibration, place: npt.ArrayLike, catheter: npt.ArrayLike, share: float = 1.0
) -> FloatArray:
    """Return pan and tilt (2,), within the cone, of a share of the turn towards a place.

    Parameters
    ----------
    calibration : HeadCalibration
    place : (2,) array_like
        Phi and z.
    catheter : (2,) array_like
        Its advance and roll.
    share : float
        1 looks at the place.
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

    Parameters
    ----------
    calibration : HeadCalibration
        With a tool.
    catheter : (2,) array_like
        Its advance and roll.
    contact : (2,) array
        Pan and tilt at the contact.
    before, after : tuple of image and (2,) array
        Pictures, with pan and tilt of each.

    Raises
    ------
    ParameterError
        If the tool meets no wall there.
    """
    camera, tool = calibration.camera_at(catheter), calibration.tool
    assert tool is not None
    pan, tilt = contact.tolist()
    expected = tool.meet(camera.mount, pan, tilt, camera.radius)[:2]
    return new_mark(camera, expected, before, after)


@dataclass(frozen=True, eq=False, kw_only=True)
class MarkState:
    """State of a touch.

    ``place`` (2,) is phi and z of the feature, ``beside`` (2,) the metres around and along the wall
    from there to the point that is touched, ``gain`` that of the camera. ``tracked`` (2,) is phi
    and z of the patch that is tracked, which is the feature if the picture shows it whole.
    ``stage`` began at ``since``. ``off`` (2,) is the smoothed distance of that point from where the
    tool would meet the wall, in pixels, and ``lean`` (2,) the angles added to the wanted ones to
    make up for a head that stays off. The point has been there without a break from ``near_since``,
    and was recognised last at ``seen_at``; ``tries`` counts the tries before. ``verdict`` is empty
    until the end, or says what the touch waits for; ``touch`` (2,) is where the point touched by
    the picture, phi and z in the frame of ``place``: its mark, if the tool hid what is tracked.
    ``before`` is the last picture before the contact with the angles that it shows, ``contact``
    (2,) those at the contact; ``mark`` (2,) is where the mark is by the picture after it, and
    ``tool`` the tool that would have been expected to touch there, both None if no mark is seen.
    """

    place: FloatArray
    tracked: FloatArray
    gain: float
    beside: FloatArray = field(default_factory=lambda: np.zeros(2))
    stage: MarkStage = "back"
    since: float | None = None
    go: GoState | None = None
    meter: MeterState | None = None
    frames: AcquisitionState | None = None
    track: TrackState | None = None
    outlined: bool = False
    wanted: FloatArray | None = None
    lean: FloatArray = field(default_factory=lambda: np.zeros(2))
    off: FloatArray = field(default_factory=lambda: np.full(2, np.nan))
    near_since: float | None = None
    seen_at: float = -math.inf
    extension: float = 0.0
    tries: int = 0
    touch: FloatArray | None = None
    before: tuple[Image, FloatArray] | None = None
    contact: FloatArray | None = None
    mark: FloatArray | None = None
    tool: Tool | None = None
    verdict: str = ""
    done: bool = False

    @property
    def error(self) -> float:
        """Distance in pixels between the place and where the tool would meet the wall."""
        return float(np.hypot(*self.off))


@dataclass(frozen=True, kw_only=True, eq=False)
class Marking(Procedure[MarkState]):
    """Turn the tool to a place, extend it until it touches the wall, and withdraw it.

    Parameters
    ----------
    calibration : HeadCalibration
        Without a tool the verdict is ``no tool``.
    go : Go
        Of the turn.
    back : float
        Angle in radians by which both joints stop short first. A wire that has cooled last would
        move to and fro about the place, across the dead zone of its loop.
    close : float
        Distance in pixels at which the tool touches: 1 of 640 is 0.03 mm across the way of the
        tool and 0.07 mm along a wall that it meets at 25 degrees.
    still : float
        Seconds for which the place stays so near before the point moves on.
    gap : float
        Distance of the point from the wall in metres at which it waits for that again.
    beyond : float
        Metres behind the expected wall at which there is no contact: as deep as a pit may be.
    share, lean : float
        Weight of a frame in the wanted angles and the distance, and rate in 1/s at which a
        remaining distance is made up for. Wires settle in some seconds; at 0.4 1/s a wire moved to
        and fro across its dead zone for as long as the point was aimed.
    patience : float
        Longest duration of a stage in seconds; the tool is withdrawn then.
    unseen : float
        Seconds for which the place may not be recognised while it stays so near.
    tries : int
        Times that the tool is turned to the place, if the head does not come to rest there or what
        is tracked is lost.
    """

    calibration: HeadCalibration
    go: Go = GO
    back: float = math.radians(6.0)
    close: float = 1.0
    still: float = 0.44
    gap: float = 1e-3
    beyond: float = 2e-3
    share: float = 0.36
    lean: float = 0.15
    patience: float = 15.0
    unseen: float = 0.0
    tries: int = 3

    def begin(
        self, place: npt.ArrayLike, gain: float = 1.0, beside: npt.ArrayLike = (0.0, 0.0)
    ) -> MarkState:
        """Return the state of a touch of phi and z (2,), or beside it, at a gain of the camera."""
        where = np.asarray(place, dtype=np.float64)
        return MarkState(
            place=where,
            tracked=where,
            gain=gain,
            beside=np.asarray(beside, dtype=np.float64),
        )

    def resume(self, track: TrackState, gain: float = 1.0) -> MarkState:
        """Return the state of a touch of a point that is tracked already, as it was picked."""
        return replace(self.begin(track.home, gain), stage="aim", track=track)

    def angles(self, place: npt.ArrayLike, catheter: npt.ArrayLike) -> FloatArray | None:
        """Return pan and tilt (2,) at which the tool meets phi and z (2,); None out of reach.

        ``catheter`` (2,) is the place of the catheter.
        """
        tool, where = self.calibration.tool, np.asarray(place, dtype=np.float64)
        guess = aim_at(self.calibration, where, catheter)
        return None if tool is None else self._angles(tool, where, catheter, guess)

    def _next(self, state: MarkState, reading: Reading) -> tuple[MarkState, Request]:
        tool = self.calibration.tool
        if tool is None:
            return replace(state, verdict=NO_TOOL, done=True), Request()
        state = replace(state, since=reading.t if state.since is None else state.since)
        if state.stage in ("back", "turn"):
            return self._turn(state, tool, reading)
        if state.stage == "meter":
            metering = Metering(calibration=self.calibration)
            meter, request = metering.step(state.meter or metering.begin(state.gain), reading)
            state = replace(state, meter=meter, gain=meter.gain)
            return (self._at(state, "outline") if meter.done else state), request
        if state.stage == "outline":
            return self._outline(state, reading)
        if state.stage == "withdraw":
            return self._withdraw(state, tool, reading)
        return self._aim(state, tool, reading)

    def _at(self, state: MarkState, stage: MarkStage, verdict: str = "") -> MarkState:
        return replace(state, stage=stage, since=None, near_since=None, verdict=verdict)

    def _late(self, state: MarkState, reading: Reading) -> bool:
        return passed(state.since or 0.0, reading.t, self.patience)

    def _turn(self, state: MarkState, tool: Tool, reading: Reading) -> tuple[MarkState, Request]:
        """Turn the tool towards the place by the joints, which stop short of it first."""
        if state.go is None:
            target = self._target(state.tracked, state)
            guess = aim_at(self.calibration, target, reading.place)
            angles = self._angles(tool, target, reading.place, guess)
            if angles is None:
                return replace(state, verdict=BEYOND, done=True), Request()
            stop = CONE.clip(angles - self.back) if state.stage == "back" else angles
            state = replace(state, go=self.go.begin(angles=stop), wanted=angles)
        assert state.go is not None
        go, request = self.go.step(state.go, reading)
        state = replace(state, go=go)
        if go.done and state.stage == "back":
            return self._at(replace(state, go=None), "turn"), request
        return (self._at(state, "meter") if go.done else state), request

    def _outline(self, state: MarkState, reading: Reading) -> tuple[MarkState, Request]:
        """Find the outline of the feature from here, and begin to track it."""
        acquisition = Acquisition()
        frames, request = acquisition.step(state.frames or acquisition.begin(state.gain), reading)
        state = replace(state, frames=frames)
        if not frames.done:
            return state, request
        camera = self.calibration.camera_at(reading.place)
        last = frames.frames[-1]
        pixel = np.asarray(camera.pixel(state.place, last.pan, last.tilt))
        hole = outline_about(frames.frames, camera, pixel, reach=FOUND)
        place = state.place if hole is None else hole.place
        pixel = pixel if hole is None else hole.pixel
        then = replace(reading, angles=np.array([last.pan, last.tilt]))
        for share in (*_INWARD[state.tries :], *_INWARD[: state.tries]):
            inner = pixel + share * (np.asarray(camera.lens.centre) - pixel)
            try:
                _, track = Centring(calibration=self.calibration).pick(last.image, inner, then)
            except SignalError:
                continue
            tracked = track.home + place - camera.place(pixel, last.pan, last.tilt)
            state = replace(state, place=place, outlined=hole is not None)
            state = replace(state, tracked=tracked, track=track)
            return self._at(state, "aim"), replace(request, frame=True)
        return replace(state, verdict=NOT_IN_VIEW, done=True), request

    def _aim(self, state: MarkState, tool: Tool, reading: Reading) -> tuple[MarkState, Request]:
        """Keep the tool turned to the place; extend it while it is."""
        if self._late(state, reading):
            aimed = state.stage in ("aim", "near")
            if state.verdict != BEYOND and aimed and state.tries + 1 < self.tries:
                return self._again(state), Request(extension=0.0)
            return self._at(state, "withdraw", state.verdict or UNSTEADY), Request(extension=0.0)
        if reading.image is None or state.track is None:
            return state, self._request(state, reading)
        seen, track = Centring(calibration=self.calibration).follow(
            state.track, reading, reading.image
        )
        state = replace(state, track=track)
        if seen.verdict != TRACKED:  # it waits where it is
            unseen = passed(state.seen_at, reading.t, self.still)
            if state.stage == "contact" and reading.touching and unseen:  # the tool hides it
                state = replace(state, contact=reading.angles, extension=0.0)
                state = self._at(state, "withdraw", TOUCHED)
                return state, self._request(state, reading)
            lost = passed(state.seen_at, reading.t, self.unseen)
            near = None if lost else state.near_since
            state = replace(state, verdict=seen.verdict, near_since=near)
            return state, self._request(replace(state, extension=reading.extension), reading)
        state = replace(state, verdict="", seen_at=reading.t)
        state = self._steered(state, tool, seen.place, reading)
        return self._moved(state, tool, seen, reading)

    def _again(self, state: MarkState) -> MarkState:
        """Return the state of another try from short of the place.

        A wire may come to rest then, and the tool may not hide another patch.
        """
        begun = self.begin(state.place, state.gain, state.beside)
        return replace(begun, tries=state.tries + 1)

    def _steered(
        self, state: MarkState, tool: Tool, place: FloatArray, reading: Reading
    ) -> MarkState:
        """Return the state with new wanted angles and the distance that is left, in pixels."""
        camera = self.calibration.camera_at(reading.place)
        target, (pan, tilt) = self._target(place, state), reading.angles.tolist()
        angles = self._angles(tool, target, reading.place, reading.angles)
        pixel = tool_pixel(self.calibration, tool, reading.place, reading.angles)
        if angles is None or not np.isfinite(pixel).all():
            return replace(state, verdict=BEYOND, near_since=None)
        off = np.asarray(camera.pixel(target, pan, tilt)) - pixel
        smooth = off if np.isnan(state.off).any() else state.off + self.share * (off - state.off)
        lean = np.clip(
            state.lean + self.lean * TWO_TICKS * (angles - reading.angles), -_MOST_LEAN, _MOST_LEAN
        )
        before = angles if state.wanted is None else state.wanted - state.lean
        wanted = before + self.share * (angles - before) + lean
        near = held_since(state.near_since, reading.t, float(np.hypot(*smooth)) < self.close)
        return replace(state, wanted=CONE.clip(wanted), lean=lean, off=smooth, near_since=near)

    def _moved(
        self, state: MarkState, tool: Tool, seen: Track, reading: Reading
    ) -> tuple[MarkState, Request]:
        """Extend the tool to the next stop, or touch."""
        mount = self.calibration.mount_at(reading.place)
        try:
            pan, tilt = reading.angles.tolist()
            *hit, free = tool.meet(mount, pan, tilt, self.calibration.radius).tolist()
        except ParameterError:
            return state, self._request(state, reading)
        still = state.near_since is not None and passed(state.near_since, reading.t, self.still)
        if state.stage == "aim" and still:
            state = self._at(replace(state, extension=max(free - self.gap, 0.0)), "near")
        elif state.stage == "near" and still and reading.extension >= state.extension - 1e-4:
            end = min(free + self.beyond, tool.longest)
            assert reading.image is not None
            before = reading.image, self._sighted(state, seen, reading)
            state = self._at(replace(state, extension=end, before=before), "contact")
        elif state.stage == "contact" and reading.touching:
            metres = np.array([self.calibration.radius, 1.0])
            off = (np.array(hit) - self._target(seen.place, state)) * metres
            touch = state.place + (state.beside + off) / metres
            contact = self._sighted(state, seen, reading)
            state = replace(state, touch=touch, contact=contact, extension=0.0)
            state = self._at(state, "withdraw", TOUCHED)
        elif state.stage == "contact" and reading.extension >= state.extension - 1e-6:
            state = self._at(replace(state, extension=0.0), "withdraw", NO_CONTACT)
        return state, self._request(state, reading)

    def _withdraw(
        self, state: MarkState, tool: Tool, reading: Reading
    ) -> tuple[MarkState, Request]:
        """Withdraw the tool, then look for the mark."""
        late = self._late(state, reading)
        frame = reading.image is None
        request = Request(extension=0.0, angles=state.wanted, frame=frame)
        before, contact = state.before, state.contact
        if late or before is None or contact is None or state.track is None:
            return replace(state, done=late or reading.extension <= 0.0), request
        if reading.image is None:
            return state, request
        centring = Centring(calibration=self.calibration)
        seen, track = centring.follow(state.track, reading, reading.image)
        state = replace(state, track=track)
        if reading.extension > 0.0 or seen.verdict != TRACKED:
            return state, request
        after = reading.image, self._sighted(state, seen, reading)
        mark = seen_mark(self.calibration, reading.place, contact, before, after)
        if mark is not None:
            camera = self.calibration.camera_at(reading.place)
            point = wall_point(float(mark[0]), float(mark[1]), camera.radius)
            learned = tool.through(camera.mount.pose(*contact.tolist()).to_camera(point))
            touch = mark if state.touch is None else state.touch
            state = replace(state, touch=touch, mark=mark, tool=learned)
        return replace(state, done=True), request

    def _sighted(self, state: MarkState, seen: Track, reading: Reading) -> FloatArray:
        """Return the angles (2,) at which the feature is where the picture shows it."""
        camera = self.calibration.camera_at(reading.place)
        angles = sighted_angles(camera, state.tracked, seen.pixel, reading.angles)
        return reading.angles if angles is None else angles

    def _request(self, state: MarkState, reading: Reading) -> Request:
        """Return the request of the next tick: a frame in every other one, or for the contact."""
        frame = reading.image is None or state.stage == "contact"
        return Request(angles=state.wanted, extension=state.extension, frame=frame)

    def _target(self, place: FloatArray, state: MarkState) -> FloatArray:
        """Return phi and z of the point to be touched, if what is tracked is at a place."""
        metres = np.array([self.calibration.radius, 1.0])
        return np.asarray(place + state.place - state.tracked + state.beside / metres)

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
        return angles if length + self.gap <= tool.longest else None
