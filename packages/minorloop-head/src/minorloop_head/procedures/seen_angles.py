"""A head whose angles are read from the pictures of its camera.

A head without sensors at its joints has two currents and a camera. `SeenAngles` reads the angles
from its pictures, counted from the picture of the cold head. `SeenHead` joins currents and camera
to an actuator with two currents and two angles, so that it is identified and driven as any other.
It takes the picture of the cold head when it is opened, also for the rest of a stopped run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import InstrumentError, ParameterError, SignalError
from minorloop.lab.actuator import Actuator, Channel, Value
from minorloop.lab.drivers.bench import Clock
from minorloop.lab.records import Record, Timing
from minorloop.lab.run import left_safe
from minorloop.lab.wrapped_actuator import WrappedActuator
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.meter import LIMITS
from minorloop_head.sources import Frame
from minorloop_head.vision.frame_checks import SATURATED
from minorloop_head.vision.wall_angles import NOTHING_SEEN, WallAngles
from minorloop_head.vision.wall_patches import SEEN, Sight, WallState
from minorloop_head.vision.wall_refinement import refined

OUTPUTS = Channel("pan", "deg"), Channel("tilt", "deg")
_LEAST, _MOST = -6.0, 90.0
"""Pan and tilt of the joints between which a lost view is searched, in degrees: a strong head turns
by 78. Angles beyond do not count."""
_SWEEP = np.concatenate([np.linspace(0.5, 0.95, 45), np.linspace(0.85, 0.3, 30), np.zeros(15)])
_SLOWLY = 0.8
"""Shares of the largest current that turn an axis slowly up and down, and seconds for each: between
pictures the view changes by less than half of a patch."""
SWEEP_SECONDS = 2 * _SWEEP.size * _SLOWLY
"""Duration of a sweep of both axes."""
_SETTLING = 1.0
"""Seconds in which the camera adapts its exposure to the light."""
_STILL, LONGEST, _MOVED = 5.0, 120.0, 0.1
"""A head is cold if it turns by less than 0.1 degrees in 5 s; and longest wait for that."""
_WAITED = "the angles are counted from the cold head; it has to stand still first"
_WARM = "the angles are counted from the cold head, and it is heated"
_FRESH = 1.0
"""Seconds for which the last picture explains missing angles, if the camera gives few pictures."""
_PATIENCE = 10.0
"""Seconds without angles after which a run stops: as long as the control relies on its model."""


def seen_by(view: HeadCalibration) -> WallAngles:
    """Return the estimator of the angles of a calibrated head."""
    ends = np.radians([[_LEAST, _LEAST], [_MOST, _MOST]])
    low, high = view.line_of_sight(ends).tolist()
    return WallAngles(view.camera_at((0.0, 0.0)), low=(low[0], low[1]), high=(high[0], high[1]))


def refined_view(view: HeadCalibration, frames: Sequence[Frame]) -> HeadCalibration:
    """Return a calibration that was corrected by pictures of a sweep, the first of the cold head.

    Raises a `SignalError` as `minorloop_head.vision.wall_refinement.refined` does.
    """
    camera, rest = refined(seen_by(view), frames, view.line_of_sight(np.zeros(2)))
    mount, (pan, tilt) = camera.mount, rest.tolist()
    return replace(
        view,
        lens=camera.lens,
        lever=mount.lever,
        offset=mount.offset,
        squint=mount.squint,
        camera_roll=mount.camera_roll,
        straight=(-pan, -tilt),
    )


def sweep(
    hold: Callable[[FloatArray, float], None], picture: Callable[[], Frame], highest: float = 0.4
) -> list[Frame]:
    """Turn each axis of a cold head up and down, and return the pictures for `refined_view`.

    Parameters
    ----------
    hold : callable
        Holds two currents (2,) in A for a time in seconds.
    picture : callable
        Returns a picture taken now.
    highest : float
        Largest current, in A.
    """
    frames = [picture()]
    for axis in range(2):
        for share in _SWEEP:
            u = np.zeros(2)
            u[axis] = share * highest
            hold(u, _SLOWLY)
            frames.append(picture())
    return frames


class SeenAngles:
    """Pan and tilt of the joints by pictures, counted from the picture of the cold head.

    A head is cold if it has no current and stands still. Until that is known there are no angles.

    ``view``: of the camera; ``cold`` (2,): pan and tilt of the cold head in degrees, such as
    `HeadControl.cold`.

    Its ``known``: whether the picture of the cold head was found.
    Its ``why``: reason why the last picture gave no angles; empty if it did.
    Its ``searched``: whether it was searched for the view: not if it shows nothing.
    """

    def __init__(self, view: HeadCalibration, cold: npt.ArrayLike = (0.0, 0.0)) -> None:
        self._view, self._estimator = view, seen_by(view)
        self._rest = view.line_of_sight(np.radians(cold))
        self._state: WallState | None = None
        self._since: float | None = None
        self.known, self.why, self.searched = False, _WAITED, False

    def read(self, frame: Frame, *, cold: bool = False) -> FloatArray:
        """Return pan and tilt (2,) in degrees; NaN if the picture does not surely show them.

        ``frame``: under all lights; ``cold``: whether the head has no current.
        """
        if not self.known:
            self._look_for_zero(frame, cold)
        if not self.known or self._state is None:
            return np.full(2, np.nan)
        sight: Sight
        sight, self._state = self._estimator.step(self._state, frame.image, frame.t)
        self.why, self.searched = sight.reason, sight.searched
        return self._view.joints(sight.angles) if not sight.trial else np.full(2, np.nan)

    def _look_for_zero(self, frame: Frame, cold: bool) -> None:
        """Use the picture of the cold head as zero of the angles, once the head stands still."""
        if not cold:
            self._state = self._since = None
            self.why = _WARM
            return
        if self._since is None:
            self._since, self.why = frame.t, _WAITED
        passed = frame.t - self._since
        if self._state is None:
            if passed >= _SETTLING:
                self._begin(frame)
        elif passed >= _STILL:
            sight, _ = self._estimator.step(self._state, frame.image, frame.t)
            turned = np.degrees(np.abs(sight.angles - self._rest)).max()
            self.known = sight.verdict == SEEN and bool(turned < _MOVED)
            if not self.known:
                self._begin(frame)

    def _begin(self, frame: Frame) -> None:
        try:
            _, self._state = self._estimator.begin(frame.image, self._rest, frame.t)
            # A mirrored picture forces a search, which is so compiled before a current is on.
            self._estimator.step(
                self._state, np.ascontiguousarray(frame.image[:, ::-1]), frame.t + 1.0
            )
        except SignalError as error:
            self._state, self.why = None, str(error)
        else:
            self._since, self.why = frame.t, _WAITED


class _Ticks:
    """The clock of a simulated head, which only its ticks advance."""

    def __init__(self) -> None:
        self._t = 0.0

    def now(self) -> float:
        return self._t

    def sleep(self, seconds: float) -> None:
        self._t += seconds


class SeenHead(WrappedActuator):
    """Two currents of an actuator, and the angles that its camera sees.

    It waits until the head stands still. The actuator confirms at the end of the wait that it is
    safe, also if the wait ends early.

    Raises a `ParameterError` if the actuator has not two currents, or the camera another size than
    calibrated; an `InstrumentError` if the head does not come to rest, or its camera does not show
    the wall for 10 s.

    ``actuator``: its first two inputs are the currents of pan and tilt, in A; its outputs are not
    used.
    ``picture``: returns the newest picture; it may raise `InstrumentError` where there is none in
    time.
    ``view``: of the camera.
    ``expose``: sets exposure time in s and gain of the camera; without it the camera does so
    itself.
    ``every``: ticks from a picture to the next while a current is held.
    ``clock``: times the ticks, in which pictures are taken and searched; that of a simulated head,
    in which this takes no time, without it.
    ``cold`` (2,): as of `SeenAngles`.
    ``waits``: called when the wait begins, after a first picture of the right size.

    Its ``age``: age of the newest picture when it was received, in seconds; a lower bound if the
    time of the picture is that of its arrival.
    Its ``pictures``: number of received pictures.
    Its ``searched``: whether the newest picture was searched for the view: not if it is old, or
    shows nothing.
    """

    def __init__(
        self,
        actuator: Actuator,
        picture: Callable[[], Frame],
        view: HeadCalibration,
        *,
        expose: Callable[[float, float], None] | None = None,
        every: int = 1,
        clock: Clock | None = None,
        cold: npt.ArrayLike = (0.0, 0.0),
        waits: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__(actuator, restorable=False)
        if [channel.unit for channel in actuator.inputs[:2]] != ["A", "A"]:
            known = ", ".join(str(channel) for channel in actuator.inputs)
            raise ParameterError(
                f"the actuator has the inputs {known}; a head has two currents in A first"
            )
        self.inputs, self.outputs = tuple(actuator.inputs[:2]), OUTPUTS
        self._view, self._angles = view, SeenAngles(view, cold)
        self._picture, self._expose, self._every = picture, expose, every
        self._waits = waits
        self._exchange = getattr(actuator, "at_once", actuator.exchange)
        self._clock: Clock = _Ticks() if clock is None else clock
        self._began = self._due = self._clock.now()
        self._gain, self._why = 1.0, ""
        self._frame: Frame | None = None
        self.age, self.pictures, self.searched = math.nan, 0, False
        self._seen_at = self._t
        with left_safe(actuator):
            self._wait_for_zero()

    @property
    def serial(self) -> str | None:
        """Serial number of the head; None if the actuator does not know it."""
        found: str | None = getattr(self._actuator, "serial", None)
        return found

    def apply(self, u: Value, duration: float, sample_interval: float) -> Record:
        """Hold two currents, and return a record of them and of the angles.

        Raises a `LimitError` if a current is beyond its limits; an `InstrumentError` if the camera
        does not show the angles for 10 s.
        """
        count = max(round(duration / sample_interval), 1)
        began, t, y = self._t, np.empty(count), np.empty((2, count))
        for k in range(count):
            due = began + duration * (k + 1) / count
            ticks = max(round((due - self._t) / self.tick), 1)
            for left in reversed(range(ticks)):
                self._hold(u)
                if left % self._every == 0:
                    angles = self._look()
            y[:, k] = self._known(u, angles)
            t[k] = self._t
        held = np.tile(np.asarray(u, dtype=np.float64)[:, None], count)
        names = [str(each) for each in self.inputs], [str(each) for each in self.outputs]
        timing = Timing(began=began, ended=self._t, uncertainty=0.5 * self.tick)
        return Record(held, y, t, *names, timing=timing)

    def exchange(self, u: Value) -> FloatArray:
        """Hold two currents for one tick; return pan and tilt in degrees, NaN where not seen.

        Raises an `InstrumentError` if the camera does not show the angles for 10 s.
        """
        self._hold(u)
        return self._look()

    def survey(self, highest: float = 0.4) -> HeadCalibration:
        """Turn each axis up and down, and return the calibration corrected by the pictures.

        The head is hot then; open it again to count from the cold head.

        ``highest``: largest current, in A. Raises a `SignalError` if the pictures do not show the
        wall, as `refined_view`; an `InstrumentError` if the camera does not show the angles for 10
        s, and the head is safe then.
        """

        def hold(u: FloatArray, seconds: float) -> None:
            for _ in range(round(seconds / self.tick)):
                self._hold(u)

        def picture() -> Frame:
            self._look()
            assert self._frame is not None  # there is at least the frame of the zero
            return self._frame  # the last one again if none came: it counts as frozen

        with left_safe(self):
            frames = sweep(hold, picture, highest)
        return refined_view(self._view, frames)

    @property
    def time(self) -> float:
        """End of the last tick, in seconds since the head was opened."""
        return self._due - self._began

    @property
    def why(self) -> str:
        """Reason why the last picture did not show the angles; empty if it did."""
        return self._why

    @property
    def _t(self) -> float:
        """Seconds since the head was opened."""
        return self._clock.now() - self._began

    def _hold(self, u: Value) -> None:
        """Hold two currents until the end of a tick, which begins at the end of the last one."""
        every = np.zeros(len(self._actuator.inputs))
        every[:2] = u
        self._exchange(every)
        now = self._clock.now()
        # A picture that takes longer than a tick delays the end by whole ticks.
        late = math.ceil((now - self._due) / self.tick - 1e-6)
        self._due += self.tick * max(late, 1)
        self._clock.sleep(self._due - now)

    def _known(self, u: Value, angles: FloatArray) -> FloatArray:
        """Return angles; hold currents until a picture shows them if they are not known yet."""
        while not np.isfinite(angles).all():
            angles = self.exchange(u)
        return angles

    def _look(self, *, cold: bool = False) -> FloatArray:
        angles = np.full(2, np.nan)
        try:
            frame = self._take_picture()
        except InstrumentError as error:
            fresh = self._frame is not None and self._clock.now() - self._frame.t < _FRESH
            self._why = self._why if fresh and self._why else str(error)
            self.searched = self.searched and fresh
        else:
            angles = self._angles.read(frame, cold=cold)
            self._why, self.searched = self._angles.why, self._angles.searched
        if cold or np.isfinite(angles).all():
            self._seen_at = self._t
        elif self._t - self._seen_at > _PATIENCE:
            raise InstrumentError(unseen(self._why))
        return angles

    def _take_picture(self) -> Frame:
        if self._expose is not None:
            self._expose(LIMITS.exposure, self._gain)
        frame, lens = self._picture(), self._view.lens
        self._frame = frame
        self.pictures += 1
        self.age = self._clock.now() - frame.t
        height, width = frame.image.shape
        if (height, width) != (lens.height, lens.width):
            raise ParameterError(
                f"the camera gives pictures of {width} by {height} pixels and was calibrated with "
                f"{lens.width} by {lens.height}; set its size, or calibrate it again"
            )
        if self.pictures == 1:
            self._waits()
        self._gain = LIMITS.gain(self._gain, frame.image)
        return frame

    def _wait_for_zero(self) -> None:
        """Wait until the head without current stands still."""
        cold, shown_at = np.zeros(2), self._t
        while not self._angles.known:
            if self._t > LONGEST or self._t - shown_at > _PATIENCE:
                raise InstrumentError(unknown_zero(self._why))
            self._hold(cold)
            self._look(cold=True)
            if self._why == _WAITED:
                shown_at = self._t


def unseen(why: str) -> str:
    """Return the message that the camera does not show the angles, with advice."""
    if why in (_WAITED, _WARM):
        return why
    what, advised, advice = why.partition("; ")
    if SATURATED in what:
        advice = (
            "switch LEDs off, in the bench file with rest = false for their lines, or shorten the "
            "exposure of the camera: most of the picture is white"
        )
    elif not advised:
        advice = NOTHING_SEEN
    return f"the camera does not show the angles: {what}; {advice}"


def unknown_zero(why: str) -> str:
    """Return the message that the zero of a head was not found in time."""
    if why != _WAITED:
        return unseen(why)
    return (
        f"the head without current still moves after {LONGEST:g} s; let it cool, and check that "
        "nothing else moves before the camera"
    )
