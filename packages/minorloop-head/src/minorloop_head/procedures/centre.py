"""Bring a point of the wall to the middle of the image, and hold it there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import SignalError
from minorloop_head.geometry import REACH
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.meter import LIMITS
from minorloop_head.procedures.values import Procedure, Reading, Request, held_since, passed
from minorloop_head.vision.calibrated_camera import Image
from minorloop_head.vision.hold import HoldState, PointHold
from minorloop_head.vision.jacobian import wall_depth
from minorloop_head.vision.recentre import CLICKED, outline_about
from minorloop_head.vision.reflectance_map import LitFrame
from minorloop_head.vision.servo import Cone, Servo, ServoStep
from minorloop_head.vision.sighting import sighted_angles
from minorloop_head.vision.tracking import TRACKED, PatchTracker, Track, TrackState

CONE = Cone(half=REACH)
"""Directions in which the head may look."""


@dataclass(frozen=True, eq=False, kw_only=True)
class CentreState:
    """State of centring.

    ``place`` (2,) is phi and z of the point, as the first frame shows it once there is one;
    ``pixel`` (2,) its pixel in the first frame, if known; ``shown`` (2,) the pixel where it was
    tracked last; ``sighted`` (2,) the angles of a head without sensors by the last frame.
    ``verdict`` is that of the tracker, or ``not in view`` if the first frame does not show the
    point whole; ``error`` in pixels from the middle, NaN if the point is not tracked. The point
    has been in the middle without a break from ``near_since``, and lost from ``lost_since``. It
    was ``least`` pixels from the middle from ``least_since`` on, and is ``stuck`` if it comes no
    nearer.
    """

    place: FloatArray
    pixel: FloatArray | None = None
    track: TrackState | None = None
    hold: HoldState | None = None
    shown: FloatArray | None = None
    sighted: FloatArray | None = None
    verdict: str = ""
    error: float = math.nan
    began: float | None = None
    near_since: float | None = None
    lost_since: float | None = None
    least: float = math.inf
    least_since: float = 0.0
    stuck: bool = False
    done: bool = False


NOT_IN_VIEW = "not in view"
LOST_FOR = 3.0
"""Seconds without the point after which it is not centred: what comes back does so within 1 s."""
STUCK_FOR, STUCK_PX, NEARER = 5.0, 20.0, 0.95
"""Seconds without coming nearer, to this share of the distance, after which a point farther than
this from the middle does not come there: wires out of reach, which turn within 3 s if they do."""
TWO_TICKS = 0.08
"""Seconds between frames of a tracker that works alone: the head turns by less than a degree."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Centring(Procedure[CentreState]):
    """Tracker and hold in one loop: the wanted angles are those at which the point is centred.

    Parameters
    ----------
    calibration : HeadCalibration
    integral_gain : float
        Of the hold, in 1/s; 0 is without its integral.
    gain : float
        Of `turn`, in 1/s: the error falls to a third in 2 s. With 0.8 a head with weak wires
        overshoots, and needs 9 s instead of 6 to stay within 2 pixels of a 320 by 240 image.
    delay : float
        Of `turn`: delay from the wanted angles to the image in seconds, that of the sensors, and
        most of that of the wires.
    soft : float
        Of `turn`: error in pixels below which the gain falls, since most of it is noise of the
        joints.
    rate_limit : float
        Fastest change of the wanted direction in rad/s: up to it the tracker is tested. Wires turn
        at up to twice that, and the blur then moves what is tracked by a pixel.
    cone : Cone
        Directions in which the head may look.
    in_middle : float
        Distance from the middle in pixels at which the point is centred.
    still : float
        Seconds for which it stays there; infinite to hold it there, also if it is lost.
    patience : float
        Longest duration in seconds.
    interval : float
        Time between frames in seconds, of one tick of 40 ms or of two.
    by_image : bool
        Whether the angles of the head are estimated from the image, because its joints have no
        sensors.
    """

    calibration: HeadCalibration
    integral_gain: float = PointHold.integral_gain
    gain: float = 0.5
    delay: float = 0.2
    soft: float = 6.0
    rate_limit: float = math.radians(10.0)
    cone: Cone = CONE
    in_middle: float = 2.0
    still: float = 0.44
    patience: float = 15.0
    interval: float = 0.04
    by_image: bool = False

    def begin(self, place: npt.ArrayLike, pixel: npt.ArrayLike | None = None) -> CentreState:
        """Return the state before centring phi and z (2,) of the wall, or what a pixel shows."""
        shown = None if pixel is None else np.asarray(pixel, dtype=np.float64)
        return CentreState(place=np.asarray(place, dtype=np.float64), pixel=shown)

    def _next(self, state: CentreState, reading: Reading) -> tuple[CentreState, Request]:
        state = replace(state, began=reading.t if state.began is None else state.began)
        if reading.image is None:
            return state, Request(frame=True)
        if state.track is None:
            state = self._picked(state, reading, reading.image)
            return state, Request(focus=self._distance(state, reading), frame=not state.done)
        near = reading if state.sighted is None else replace(reading, angles=state.sighted)
        track, tracked = self.follow(state.track, near, reading.image)
        seen = track.pixel if track.verdict == TRACKED else None
        shown = state.shown if seen is None else seen
        angles, sighted = self._angles(state.place, seen, reading)
        state = replace(state, track=tracked, shown=shown, sighted=sighted, verdict=track.verdict)
        assert state.hold is not None
        move, hold = self._hold(reading).step(state.hold, seen, angles)
        state = replace(state, hold=hold)
        state = self._checked(state, move, reading.t)
        # Without a frame now, the next tick requests one.
        every_tick = self.interval < TWO_TICKS
        return state, Request(angles=move.angles, sighted=sighted, frame=every_tick)

    def pick(
        self, image: Image, pixel: npt.ArrayLike, reading: Reading
    ) -> tuple[Track, TrackState]:
        """Begin to track what a pixel shows.

        Raises
        ------
        SignalError
            If the image does not show it whole, or shows no texture that could be found again.
        """
        pan, tilt = reading.angles.tolist()
        return self._tracker(reading).begin(image, pixel, pan, tilt)

    def outlined(
        self,
        frames: Sequence[LitFrame],
        pixel: npt.ArrayLike,
        reading: Reading,
        *,
        reach: float = CLICKED,
    ) -> FloatArray:
        """Return the middle (2,) of the round outline about a pixel; the pixel if there is none.

        A person clicks some pixels beside what is meant. ``frames``, ``pixel`` and ``reach`` are
        as in `outline_about`; the reading says where the catheter is.
        """
        clicked = np.asarray(pixel, dtype=np.float64)
        camera = self.calibration.camera_at(reading.place)
        found = outline_about(frames, camera, clicked, reach=reach)
        return clicked if found is None else found.pixel

    def follow(self, track: TrackState, reading: Reading, image: Any) -> tuple[Track, TrackState]:
        """Track it in the next frame."""
        pan, tilt = reading.angles.tolist()
        return self._tracker(reading).step(track, image, pan, tilt)

    def turn(
        self, commanded: npt.ArrayLike, pixel: npt.ArrayLike | None, reading: Reading
    ) -> ServoStep:
        """Return the next wanted angles of a head at (2,) wanted angles, to centre a pixel."""
        servo = self._servo(reading)
        step, _ = servo.step(servo.begin(commanded), pixel, reading.angles)
        return step

    def _tracker(self, reading: Reading) -> PatchTracker:
        return PatchTracker(self.calibration.camera_at(reading.place))

    def _servo(self, reading: Reading) -> Servo:
        return Servo(
            self.calibration.camera_at(reading.place),
            gain=self.gain,
            delay=self.delay,
            interval=self.interval,
            cone=self.cone,
            rate_limit=self.rate_limit,
            soft=self.soft,
        )

    def _hold(self, reading: Reading) -> PointHold:
        return PointHold(servo=self._servo(reading), integral_gain=self.integral_gain)

    def _picked(self, state: CentreState, reading: Reading, image: Image) -> CentreState:
        """Return the state with the patch about the point, as the first frame shows it."""
        camera = self.calibration.camera_at(reading.place)
        pixel = state.pixel
        if pixel is None:
            pixel = np.asarray(camera.pixel(state.place, *reading.angles.tolist()))
        try:
            picked, track = self.pick(image, pixel, reading)
        except SignalError:
            return replace(state, verdict=NOT_IN_VIEW, done=True)
        return replace(
            state,
            place=picked.place,
            track=track,
            shown=pixel,
            hold=self._hold(reading).begin(reading.angles),
        )

    def _distance(self, state: CentreState, reading: Reading) -> float | None:
        """Return the distance of the point in the first frame, within the limits of the focus."""
        if state.shown is None:
            return None
        camera = self.calibration.camera_at(reading.place)
        point = camera.lens.normalised(state.shown)
        return LIMITS.focus(wall_depth(camera, point, *reading.angles.tolist()))

    def _angles(
        self, place: FloatArray, seen: FloatArray | None, reading: Reading
    ) -> tuple[FloatArray, FloatArray | None]:
        """Return the angles of the head, and those that the image gives."""
        if not self.by_image or seen is None:
            return reading.angles, None
        camera = self.calibration.camera_at(reading.place)
        sighted = sighted_angles(camera, place, seen, reading.angles)
        return (reading.angles, None) if sighted is None else (sighted, sighted)

    def _checked(self, state: CentreState, move: ServoStep, t: float) -> CentreState:
        """Return the state with the error, done if that was small, unknown or large for long."""
        if move.error < NEARER * state.least:
            state = replace(state, least=move.error, least_since=t)
        since = held_since(state.near_since, t, move.error < self.in_middle)
        lost = held_since(state.lost_since, t, state.verdict != TRACKED)
        still = since is not None and passed(since, t, self.still)
        late = passed(state.began or 0.0, t, self.patience)
        gone = math.isfinite(self.still) and lost is not None and passed(lost, t, LOST_FOR)
        far = math.isfinite(self.still) and move.error > STUCK_PX
        stuck = far and passed(state.least_since, t, STUCK_FOR)
        done = still or late or gone or stuck
        state = replace(state, error=move.error, near_since=since, lost_since=lost)
        return replace(state, stuck=stuck, done=done)
