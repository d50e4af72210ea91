"""Turn of the base of a head by what its camera sees of the wall.

Flow sways the base of the head, which the sensors of the joints do not measure. A picture of the
wall shows the whole line of sight; what the joints do not explain of it is the turn of the base.
Angles and pictures have times, and the turn is given for the time of a burst.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import SignalError
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.vision.calibrated_camera import Image
from minorloop_head.vision.wall_angles import WallAngles
from minorloop_head.vision.wall_patches import SEEN, WallState

_KEPT = 50
"""Readings of the joints that are kept: 2 s, more than the latency of a usual camera."""
_RESTED = 10
"""Readings whose mean is the line of sight of the first picture: 0.4 s, for which a head that has
arrived is at rest."""
_FARTHEST = math.radians(3.0)
"""Largest change of the base from one picture to the next: a sway of 1 degree makes 2."""
_TRIES = 16
"""Angles that are tried if the view is not found at the expected ones: all that are near, 2 degrees
apart."""
_ROLLED = math.radians(5.0)
"""Roll of the catheter after which what is newly in view is remembered: a tenth of a picture."""
_NEAR, _BETWEEN = 0.02, 0.25
"""Seconds from a picture within which the turn is that of the picture, and between two pictures
between which it is interpolated: either is off by less than 0.04 degrees in a sway of 1 degree at
0.3 Hz."""


class SeenBase:
    """Pan and tilt of the base by pictures, counted from a picture of the base at rest.

    Its ``why``: why the last picture did not show the turn; empty if it did.
    """

    def __init__(self, view: HeadCalibration) -> None:
        self._view = view
        self._read: deque[tuple[float, FloatArray, FloatArray]] = deque(maxlen=_KEPT)
        self._seen: deque[tuple[float, FloatArray]] = deque(maxlen=_KEPT)
        self._state: WallState | None = None
        self._rolls: list[float] = []
        self.why = "no picture was taken while the base was at rest"

    @property
    def begun(self) -> bool:
        """Whether there is a picture of the base at rest."""
        return self._state is not None

    def read(self, t: float, angles: npt.ArrayLike, place: npt.ArrayLike) -> None:
        """Note what joints and catheter read at a time.

        ``t``: in seconds. ``angles`` and ``place`` (2,): pan and tilt by the joints in radians;
        advance in metres and roll in radians.
        """
        if self._read and t <= self._read[-1][0]:
            self._read.pop()
        self._read.append((t, np.asarray(angles, np.float64), np.asarray(place, np.float64)))

    def begin(self, image: Image, t: float) -> None:
        """Take a picture of a head at rest under all lights as that of a base that is not turned.

        ``image`` (height, width). ``t``: when it was taken, in seconds. Joints and catheter have
        been read about then.
        """
        before = [angles for at, angles, _ in self._read if at <= t][-_RESTED:]
        rested = np.mean(before or [self._read[0][1]], axis=0)
        self._state = None
        self._seen.clear()
        self._rolls = [self._place(t)[1]]
        try:
            _, self._state = self._estimator(t).begin(image, rested, t)
        except SignalError as error:
            self.why = str(error)
            return
        self._seen.append((t, np.zeros(2)))
        self.why = ""

    def see(self, image: Image, t: float) -> None:
        """Find the turn of the base in a picture under all lights, taken at a time in seconds."""
        if self._state is None:
            return
        angles, last = self._angles(t), self._seen[-1][1]
        expected = angles + last
        estimator = replace(
            self._estimator(t),
            low=tuple((expected - _FARTHEST).tolist()),
            high=tuple((expected + _FARTHEST).tolist()),
            tries=_TRIES,
        )
        # The joints say where the head has turned since; a picture may be long after the last one.
        before = replace(self._state, angles=expected, rates=np.zeros(2), missed=1)
        sight, state = estimator.step(before, image, t)
        if sight.verdict == SEEN:
            # After a turn of a degree, some tenths remain; from there, a hundredth does.
            sight, state = estimator.step(replace(before, angles=sight.angles, missed=0), image, t)
        roll = self._place(t)[1]
        if sight.verdict == SEEN and min(abs(roll - one) for one in self._rolls) > _ROLLED:
            state = estimator.rolled(state, image, sight.sd)
            self._rolls.append(roll)
        self._state, self.why = state, sight.reason
        if sight.verdict == SEEN:
            self._seen.append((t, sight.angles - angles))

    def at(self, t: float) -> FloatArray:
        """Return the turn (2,) of the base at a time, in radians; NaN where it was not seen."""
        times = [at for at, _ in self._seen]
        after = int(np.searchsorted(times, t))
        near = [n for n in (after - 1, after) if 0 <= n < len(times)]
        best = min(near, key=lambda n: abs(times[n] - t), default=None)
        if best is None:
            return np.full(2, np.nan)
        if abs(times[best] - t) <= _NEAR:
            return self._seen[best][1].copy()
        if len(near) < 2 or times[after] - times[after - 1] > _BETWEEN:
            return np.full(2, np.nan)
        (begin, one), (end, other) = self._seen[after - 1], self._seen[after]
        share = (t - begin) / (end - begin)
        return np.asarray((1.0 - share) * one + share * other)

    def _estimator(self, t: float) -> WallAngles:
        """Return the estimator where the catheter was at a time."""
        return WallAngles(self._view.camera_at(self._place(t)))

    def _place(self, t: float) -> FloatArray:
        """Return advance and roll (2,) of the catheter at a time."""
        return min(self._read, key=lambda each: abs(each[0] - t))[2]

    def _angles(self, t: float) -> FloatArray:
        """Return what the joints read at a time, between two readings if need be."""
        times = [at for at, _, _ in self._read]
        each = np.array([angles for _, angles, _ in self._read])
        return np.array([np.interp(t, times, each[:, n]) for n in range(2)])
