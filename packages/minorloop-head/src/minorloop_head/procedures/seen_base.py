"""Turn of the base of a head, measured by its camera.

Flow sways the base of the head, which the sensors of the joints do not measure. A picture of the
wall shows the whole line of sight; less the angles of the joints, it is the turn of the base.
Angles and pictures have times, from which the turn at the time of a burst is computed.
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
"""Number of kept readings of the joints: 2 s, more than the latency of a usual camera."""
_RESTED = 10
"""Number of readings whose mean is the line of sight of the first picture: in these 0.4 s a head
that has arrived is at rest."""
_FARTHEST = math.radians(3.0)
"""Largest change of the base from one picture to the next: a sway of 1 degree makes 2."""
_TRIES = 16
"""Number of angles tried if the view is not at the expected ones: near ones, 2 degrees apart."""
_ROLLED = math.radians(5.0)
"""Roll of the catheter after which the new part of the view is stored: a tenth of a picture."""
_NEAR, _BETWEEN = 0.02, 0.25
"""Longest seconds from a picture for which its turn holds, and between two pictures for which the
turn is interpolated: either errs by less than 0.04 degrees in a sway of 1 degree at 0.3 Hz."""


class SeenBase:
    """Pan and tilt of the base by pictures, counted from a picture of the base at rest.

    Its ``why``: reason why the last picture did not show the turn; empty if it did.
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
        """Store the readings of joints and catheter at a time.

        ``t``: in seconds. ``angles`` and ``place`` (2,): pan and tilt by the joints in radians;
        advance in metres and roll in radians.
        """
        if self._read and t <= self._read[-1][0]:
            self._read.pop()
        self._read.append((t, np.asarray(angles, np.float64), np.asarray(place, np.float64)))

    def begin(self, image: Image, t: float) -> None:
        """Set the zero: a picture under all lights of a head at rest, whose base is not turned.

        ``image`` (height, width). ``t``: time of the picture, in seconds. `read` has stored
        readings about that time.
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
        # The joints give the turn of the head since the last picture, which may be long ago.
        before = replace(self._state, angles=expected, rates=np.zeros(2), missed=1)
        sight, state = estimator.step(before, image, t)
        if sight.verdict == SEEN:
            # A first step leaves tenths of a turn of one degree; a second step leaves a hundredth.
            sight, state = estimator.step(replace(before, angles=sight.angles, missed=0), image, t)
        roll = self._place(t)[1]
        if sight.verdict == SEEN and min(abs(roll - one) for one in self._rolls) > _ROLLED:
            state = estimator.rolled(state, image, sight.sd)
            self._rolls.append(roll)
        self._state, self.why = state, sight.reason
        if sight.verdict == SEEN:
            self._seen.append((t, sight.angles - angles))

    def at(self, t: float) -> FloatArray:
        """Return the turn (2,) of the base at a time, in radians; NaN where no picture shows it."""
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
        """Return the angles of the joints at a time, interpolated between two readings."""
        times = [at for at, _, _ in self._read]
        each = np.array([angles for _, angles, _ in self._read])
        return np.array([np.interp(t, times, each[:, n]) for n in range(2)])
