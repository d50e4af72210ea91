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
from minorloop_head.procedures.values import NOW, Procedure, Reading, Request, held_since, passed
from minorloop_head.vision.calibrated_camera import Image
from minorloop_head.vision.recentre import CLICKED, outline_about
from minorloop_head.vision.reflectance_map import LitFrame
from minorloop_head.vision.servo import (
    Cone,
    PointHold,
    Servo,
    ServoStep,
    sighted_angles,
    wall_depth,
)
from minorloop_head.vision.tracking import TRACKED, PatchTracker, Track, TrackState

CONE = Cone(half=REACH)
"""Directions in which the head may look."""


@dataclass(eq=False, kw_only=True)
class Centred:
    """State of the centring of a point, which the procedure keeps up to date."""

    place: FloatArray
    """Shape (2,). Phi and z of the point; after the first frame, as that frame shows it."""
    verdict: str = ""
    """Verdict of the tracker, or ``not in view`` if the first frame does not show the point whole;
    empty before it was tracked."""
    error: float = math.nan
    """Distance from the middle in pixels; NaN if the point is not tracked."""
    shown: FloatArray | None = None
    """Shape (2,). The pixel where it was tracked last; before, that in the first frame, if it is
    known."""
    track: TrackState | None = None
    stuck: bool = False
    """Whether it has stopped moving towards the middle."""


NOT_IN_VIEW = "not in view"
LOST_FOR = 3.0
"""Longest time in seconds without the point: a point that comes back does so within 1 s."""
STUCK_FOR, STUCK_PX, _NEARER = 5.0, 20.0, 0.95
"""Seconds without coming nearer, to this share of the distance, after which a point farther than
this from the middle does not come there: wires out of reach, which turn within 3 s if they do."""
TWO_TICKS = 0.08
"""Seconds between frames of a tracker that works alone: the head turns by less than a degree."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Centring:
    """Tracker and integral controller that turn the head until the tracked point is centred."""

    calibration: HeadCalibration
    integral_gain: float = PointHold.integral_gain
    """Integral gain of the hold, in 1/s; 0 switches it off."""
    gain: float = 0.5
    """Gain of `turn` in 1/s: the error falls to a third in 2 s. With 0.8 a head with weak wires
    overshoots, and needs 9 s instead of 6 to stay within 2 pixels of a 320 by 240 image."""
    delay: float = 0.2
    """Of `turn`: delay from the wanted angles to the image in seconds, that of the sensors, and
    most of that of the wires."""
    soft: float = 6.0
    """Of `turn`: error in pixels below which the gain falls, since most of it is noise of the
    joints."""
    rate_limit: float = math.radians(10.0)
    """Fastest change of the wanted direction in rad/s, the highest at which the tracker is tested.
    Wires turn at up to twice that; blur then moves the tracked patch by a pixel."""
    cone: Cone = CONE
    """Directions in which the head may look."""
    in_middle: float = 2.0
    """Distance from the middle in pixels at which the point is centred."""
    still: float = 0.44
    """Seconds for which it stays there; infinite to hold it there, even if it is lost."""
    patience: float = 15.0
    """Longest duration in seconds."""
    interval: float = 0.04
    """Time between frames in seconds, of one tick of 40 ms or of two."""
    by_image: bool = False
    """Whether the angles of the head are estimated from the image, because its joints have no
    sensors."""

    def centre(self, point: Centred) -> Procedure[Centred]:
        """Centre a point by its place, or by its pixel in the first frame; return it."""
        now = yield NOW
        began = now.t
        while now.image is None:
            now = yield Request(frame=True)
        camera = self.calibration.camera_at(now.place)
        if point.shown is None:
            point.shown = np.asarray(camera.pixel(point.place, *now.angles.tolist()))
        try:
            picked, point.track = self.pick(now.image, point.shown, now)
        except SignalError:
            point.verdict = NOT_IN_VIEW
            return point
        point.place, hold = picked.place, self._hold(now).begin(now.angles)
        depth = wall_depth(camera, camera.lens.normalised(point.shown), *now.angles.tolist())
        now = yield Request(focus=LIMITS.focus(depth), frame=True)
        sighted = near_since = lost_since = None
        least, least_since, ends = math.inf, 0.0, math.isfinite(self.still)
        while True:
            while now.image is None:
                now = yield Request(frame=True)
            then = now if sighted is None else replace(now, angles=sighted)
            found, point.track = self.follow(point.track, then, now.image)
            at = found.pixel if found.verdict == TRACKED else None
            point.verdict, point.shown = found.verdict, point.shown if at is None else at
            angles, sighted = self._angles(point.place, at, now)
            move, hold = self._hold(now).step(hold, at, angles)
            point.error = move.error
            if move.error < _NEARER * least:
                least, least_since = move.error, now.t
            near_since = held_since(near_since, now.t, move.error < self.in_middle)
            lost_since = held_since(lost_since, now.t, found.verdict != TRACKED)
            far = ends and move.error > STUCK_PX
            point.stuck = far and passed(least_since, now.t, STUCK_FOR)
            if (
                point.stuck
                or passed(near_since, now.t, self.still)
                or passed(began, now.t, self.patience)
                or (ends and passed(lost_since, now.t, LOST_FOR))
            ):
                return point
            # Without a frame now, the next tick requests one.
            every_tick = self.interval < TWO_TICKS
            now = yield Request(angles=move.angles, sighted=sighted, frame=every_tick)

    def pick(
        self, image: Image, pixel: npt.ArrayLike, reading: Reading
    ) -> tuple[Track, TrackState]:
        """Begin to track the patch of the wall at a pixel.

        Raises a `SignalError` if the image does not show it whole, or it has too little texture
        to be found again.
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

        An operator misses the intended point by some pixels. ``frames``, ``pixel`` and ``reach``
        are as in `outline_about`; the reading has the place of the catheter.
        """
        clicked = np.asarray(pixel, dtype=np.float64)
        camera = self.calibration.camera_at(reading.place)
        found = outline_about(frames, camera, clicked, reach=reach)
        return clicked if found is None else found.pixel

    def follow(self, track: TrackState, reading: Reading, image: Any) -> tuple[Track, TrackState]:
        """Find the tracked patch in the next frame."""
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

    def _angles(
        self, place: FloatArray, seen: FloatArray | None, reading: Reading
    ) -> tuple[FloatArray, FloatArray | None]:
        """Return the angles of the head, and those that the image gives."""
        if not self.by_image or seen is None:
            return reading.angles, None
        camera = self.calibration.camera_at(reading.place)
        sighted = sighted_angles(camera, place, seen, reading.angles)
        return (reading.angles, None) if sighted is None else (sighted, sighted)
