"""A head whose angles are read from the pictures of its camera.

A head without sensors at its joints has two currents and a camera. `SeenHead` joins them to an
actuator with two currents and two angles, so that it is identified as any other. The angles are
counted from the picture of the cold head, which is taken when the actuator is opened, and so again
when a stopped run is continued.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import InstrumentError, ParameterError
from minorloop.head.procedures.calibration import HeadCalibration
from minorloop.head.procedures.meter import LIMITS
from minorloop.head.vision.wall_angles import WallAngles
from minorloop.head.vision.wall_patches import SEEN, Sight, WallState
from minorloop.head.vision.wall_refinement import refined
from minorloop.lab.actuator import Actuator, Channel, Frame, Value
from minorloop.lab.records import Record, Timing
from minorloop.lab.wrapped_actuator import WrappedActuator

OUTPUTS = Channel("pan", "deg"), Channel("tilt", "deg")
_LEAST, _MOST = -6.0, 90.0
"""Pan and tilt of the joints between which a lost view is looked for, in degrees: a strong head
turns by 78, and beyond these angles a picture does not count as seen."""
_SWEEP = np.concatenate([np.linspace(0.5, 0.95, 45), np.linspace(0.85, 0.3, 30), np.zeros(15)])
_SLOWLY = 0.8
"""Shares of the largest current that turn an axis up and down, slowly, and seconds for each: the
view changes by less than half of a patch from a picture to the next."""
_STILL, _LONGEST, _MOVED = 5.0, 120.0, 0.1
"""A head is cold that turns less than 0.1 degrees in 5 s; seconds that are waited for that."""
_PATIENCE = 250
"""Pictures in a row without angles after which a run stops: 10 s at 25 in a second."""


def seen_by(view: HeadCalibration) -> WallAngles:
    """Return the estimator of the angles of a calibrated head."""
    ends = np.radians([[_LEAST, _LEAST], [_MOST, _MOST]])
    low, high = view.line_of_sight(ends).tolist()
    return WallAngles(view.camera_at((0.0, 0.0)), low=(low[0], low[1]), high=(high[0], high[1]))


def refined_view(view: HeadCalibration, frames: Sequence[Frame]) -> HeadCalibration:
    """Return a calibration that was corrected by pictures of a sweep, the first of the cold head.

    Raises
    ------
    SignalError
        As `minorloop.head.vision.wall_refinement.refined`.
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


class SeenHead(WrappedActuator):
    """Two currents of an actuator, and the angles that its camera sees.

    Parameters
    ----------
    actuator : Actuator
        Its first two inputs are the currents of pan and tilt, in A; its outputs are not used.
    picture : callable
        Returns the newest picture; it may raise `InstrumentError` where there is none in time.
    view : HeadCalibration
        Of the camera.
    expose : callable, optional
        Sets exposure time in s and gain of the camera; without it the camera does so itself.
    every : int
        Ticks from a picture to the next while a current is held.

    Raises
    ------
    ParameterError
        If the actuator has not two currents.
    InstrumentError
        If the head does not come to rest, or its camera does not show the wall.
    """

    def __init__(
        self,
        actuator: Actuator,
        picture: Callable[[], Frame],
        view: HeadCalibration,
        *,
        expose: Callable[[float, float], None] | None = None,
        every: int = 1,
    ) -> None:
        super().__init__(actuator)
        if [channel.unit for channel in actuator.inputs[:2]] != ["A", "A"]:
            known = ", ".join(str(channel) for channel in actuator.inputs)
            raise ParameterError(
                f"the actuator has the inputs {known}; a head has two currents in A first"
            )
        self.inputs, self.outputs = tuple(actuator.inputs[:2]), OUTPUTS
        self._view, self._eyes = view, seen_by(view)
        self._picture, self._expose, self._every = picture, expose, every
        self._gain, self._clock = 1.0, 0.0
        self._state = self._zero()

    @property
    def serial(self) -> str | None:
        """Serial number of the head; None if the actuator does not know it."""
        found: str | None = getattr(self._actuator, "serial", None)
        return found

    def apply(self, u: Value, duration: float, sample_interval: float) -> Record:
        """Hold two currents, and return a record of them and of the angles.

        Raises
        ------
        LimitError
            If a current is beyond its limits.
        InstrumentError
            If the camera does not show the angles for 10 s.
        """
        count = max(round(duration / sample_interval), 1)
        began, t, y = self._clock, np.empty(count), np.empty((2, count))
        for k in range(count):
            due = began + duration * (k + 1) / count
            ticks = max(round((due - self._clock) / self.tick), 1)
            for left in reversed(range(ticks)):
                self._hold(u)
                if left % self._every == 0:
                    angles = self._look()
            t[k], y[:, k] = self._clock, self._known(u, angles)
        held = np.tile(np.asarray(u, dtype=np.float64)[:, None], count)
        names = [str(each) for each in self.inputs], [str(each) for each in self.outputs]
        timing = Timing(began=began, ended=self._clock, uncertainty=0.5 * self.tick)
        return Record(t, held, y, *names, timing=timing)

    def exchange(self, u: Value) -> FloatArray:
        """Hold two currents for one tick; return pan and tilt in degrees, NaN where not seen."""
        self._hold(u)
        return self._look()

    def survey(self, highest: float = 0.4) -> HeadCalibration:
        """Turn each axis up and down, and return the calibration corrected by the pictures.

        The head is hot then; open it again to count from the cold head.

        Parameters
        ----------
        highest : float
            Largest current, in A.

        Raises
        ------
        SignalError
            If the pictures do not show the wall, as `refined_view`.
        InstrumentError
            If the camera gives no picture.
        """

        def hold(u: FloatArray, seconds: float) -> None:
            for _ in range(round(seconds / self.tick)):
                self._hold(u)

        return refined_view(self._view, sweep(hold, self._taken, highest))

    @property
    def why(self) -> str:
        """Why the last picture did not show the angles; empty if it did."""
        return self._why

    def _hold(self, u: Value) -> None:
        every = np.zeros(len(self._actuator.inputs))
        every[:2] = u
        self._actuator.exchange(every)
        self._clock += self.tick

    def _known(self, u: Value, angles: FloatArray) -> FloatArray:
        """Return angles, of later pictures if this one does not show them."""
        for _ in range(_PATIENCE):
            if np.isfinite(angles).all():
                return angles
            self._hold(u)
            angles = self._look()
        raise InstrumentError(
            f"the camera does not show the angles: {self._why}; check lights, lens and cable"
        )

    def _look(self) -> FloatArray:
        try:
            frame = self._taken()
        except InstrumentError as error:
            self._why = str(error)
            return np.full(2, np.nan)
        sight: Sight
        sight, self._state = self._eyes.step(self._state, frame.image, frame.t)
        self._why = sight.reason
        return self._view.joints(sight.angles)

    def _taken(self) -> Frame:
        if self._expose is not None:
            self._expose(LIMITS.exposure, self._gain)
        frame = self._picture()
        self._gain = LIMITS.gain(self._gain, frame.image)
        return frame

    def _zero(self) -> WallState:
        """Take the picture of the cold head as that of the angles 0, once it stands still."""
        self._why, cold = "", np.zeros(len(self.inputs))
        rest = self._view.line_of_sight(np.zeros(2))
        ticks = round(_STILL / self.tick)
        for _ in range(round(_LONGEST / _STILL)):
            for _ in range(ticks):
                self._hold(cold)
                frame = self._taken()
            _, state = self._eyes.begin(frame.image, rest, frame.t)
            for _ in range(ticks):
                self._hold(cold)
                frame = self._taken()
            sight, _ = self._eyes.step(state, frame.image, frame.t)
            if sight.verdict == SEEN and np.degrees(np.abs(sight.angles - rest)).max() < _MOVED:
                return state
        raise InstrumentError(
            f"the head without current still moves after {_LONGEST:g} s; let it cool, and check "
            "that nothing else moves before the camera"
        )
