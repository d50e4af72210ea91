"""A simulated head whose angles are read only from the pictures of its simulated camera.

Pictures begin at the ends of ticks. The angles of a picture are used two ticks later: one for its
arrival, and one for its evaluation. Some pictures are lost on the way.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np

from minorloop.arrays import FloatArray
from minorloop_head.control.head import AGE
from minorloop_head.geometry import Mount
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.meter import LIMITS
from minorloop_head.procedures.seen_angles import refined_view, seen_by, sweep
from minorloop_head.sources import Frame
from minorloop_head.twins.camera import LENS
from minorloop_head.twins.catheter import Catheter
from minorloop_head.twins.head import Head
from minorloop_head.twins.pipe import Bore, Pipe
from minorloop_head.twins.rig import Rig, SimulatedTip
from minorloop_head.vision.wall_patches import Sight

DROPPED = 0.02
"""Share of the pictures that do not arrive: some of a long cable, chosen without a measurement."""
ANGLE, _SCALE = math.radians(0.3), 0.5
"""Largest error of an angle of the mount in rad, and scale of the pictures, of 320 by 240 pixels.
"""
_WAY = (0.2,) * 15 + (0.6,) * 5 + (2.0,) * 3
"""Times in seconds between pictures on the way to another angle, of three time constants: even if
one picture is lost, the fastest wire turns by 4 degrees in the shortest, a quarter of the view; and
after the first seconds it is slow."""
_SEARCH = 40
"""Most pictures at the end of a hold: 21 are enough to try angles in the whole reach."""
Disturbance: TypeAlias = Callable[[int, Frame], Frame | None]
"""Changes or loses the picture of a tick, for tests of bad input."""


def known_view(tip: SimulatedTip, mount: Mount, seed: int) -> HeadCalibration:
    """Return the calibration of a tip on its true mount, with typical errors by seed.

    Each is drawn uniformly within the bounds of tests of ``head calibrate``: 0.3 % of the focal
    length, 1 pixel of 640 of the principal point, 0.3 degrees of the angles of the mount; 0.1 mm of
    pivot and lever; and 20 micrometres of a gauge of the pipe.
    """
    rng = np.random.default_rng([seed, 57])
    lens = tip.camera.calibration

    def error(most: float, count: int = 1) -> list[float]:
        return [float(each) for each in rng.uniform(-most, most, count)]

    pan, tilt, squint, roll = error(ANGLE, 4)
    rig = Rig(Head())
    straight = -rig.stance()[0]
    across, down = error(1.0 * _SCALE, 2)
    x, y, lever = error(0.1e-3, 3)
    return HeadCalibration(
        lens=replace(
            lens,
            focal=lens.focal * (1.0 + error(0.003)[0]),
            centre=(lens.centre[0] + across, lens.centre[1] + down),
        ),
        leds=tip.camera.leds,
        offset=(mount.offset[0] + x, mount.offset[1] + y),
        lever=mount.lever + lever,
        radius=tip.pipe.radius + error(20e-6)[0],
        straight=(straight + pan, straight + tilt),
        squint=mount.squint + squint,
        camera_roll=mount.camera_roll + roll,
    )


class Missed(NamedTuple):
    """A picture that did not show the angles: tick and reason."""

    tick: int
    reason: str


class PictureSensor:
    """A head whose only sensor is its camera; it is cold, and its own sensors are not read.

    ``ticks`` counts its pictures, ``missed`` lists those that did not show the angles, ``latest``
    has the joints (2,) in degrees by the newest one, and ``view`` is the known calibration of the
    camera: the passed one, or one with errors. The seed draws pipe, camera, these errors, and the
    lost pictures, a share of ``dropped``; ``disturb`` changes the others.
    """

    def __init__(
        self,
        head: Head,
        seed: int,
        *,
        view: HeadCalibration | None = None,
        bores: tuple[Bore, ...] = (),
        dropped: float = DROPPED,
        disturb: Disturbance | None = None,
    ) -> None:
        self.rig = Rig(head, Catheter())
        rng = np.random.default_rng([seed, 58])
        self.mount = Mount(
            offset=tuple(rng.uniform(-0.2e-3, 0.2e-3, 2).tolist()),
            squint=float(rng.uniform(-ANGLE, ANGLE)),
        )
        pipe = replace(Pipe.draw(seed), bores=bores)
        self.tip = SimulatedTip(
            pipe, mount=self.mount, specimen=seed, seed=seed, optics=LENS.scaled(_SCALE)
        )
        self.tip.focus_at(10e-3)  # the wall ahead of a cold head is at 7 mm, further for others
        self.view = view or known_view(self.tip, self.mount, seed)
        self.estimator = seen_by(self.view)
        self.missed: list[Missed] = []
        self.sight: Sight | None = None
        self.latest: FloatArray = np.zeros(2)
        self._rng, self._dropped, self._disturb = rng, dropped, disturb
        self._gain, self.ticks = 1.0, 0
        self._taken_with: dict[float, float] = {}
        # The gain has settled after 12 pictures; that of the angle 0 is the next one.
        for _ in range(12):
            self._lit()
        frame = self._frame()
        straight = self.view.line_of_sight(np.zeros(2))
        _, self._state = self.estimator.begin(frame.image, straight, frame.t)
        self._coming: list[FloatArray] = [np.zeros(2)] * (AGE - 1)

    def exchange(self, u: FloatArray) -> FloatArray:
        """Hold two currents for a tick; return the joints in degrees known to a loop then."""
        self.rig.exchange(np.append(u, [0.0, 0.0]))
        self.latest = self.look()
        self._coming.append(self.latest)
        return self._coming.pop(0)

    def pass_over(self, u: FloatArray) -> None:
        """Hold two currents for a tick without a picture."""
        self.rig.exchange(np.append(u, [0.0, 0.0]))
        self.tip.wait(self.rig.tick)

    def look(self) -> FloatArray:
        """Take a picture now, and return its joints (2,) in degrees; NaN if they are not seen."""
        frame: Frame | None = self._frame()
        self.ticks += 1
        if self._disturb is not None and frame is not None:
            frame = self._disturb(self.ticks, frame)
        if frame is None or self._rng.random() < self._dropped:
            self.missed.append(Missed(self.ticks, "no picture came"))
            return np.full(2, np.nan)
        self._meter(frame)
        self.sight, self._state = self.estimator.step(self._state, frame.image, frame.t)
        if self.sight.reason:
            self.missed.append(Missed(self.ticks, self.sight.reason))
            return np.full(2, np.nan)
        return self.view.joints(self.sight.angles)

    def survey(self) -> HeadCalibration:
        """Turn each axis up and down, and return the calibration corrected by the pictures.

        The head is hot then.
        """
        return refined_view(self.view, sweep(self._wait, self._lit))

    def hold(
        self, u: FloatArray, seconds: float, pictures: int, *, follow: bool = False
    ) -> FloatArray:
        """Hold two currents in A, and return the mean angles (2,) of so many pictures at the end.

        They are in degrees. If the angles are far from the last ones, the view has to be found
        again; NaN if it is not. With ``follow`` there are pictures on the way too: past unknown
        wall, the view at the end can only be found with them.
        """
        way = _WAY if follow else ()
        for pause in way:
            self._wait(u, pause - self.rig.tick)
            self.look()
        self._wait(u, seconds - _SEARCH * self.rig.tick - sum(way))
        good: list[FloatArray] = []
        for _ in range(_SEARCH):
            angles = self.look()
            if np.isfinite(angles).all():
                good.append(angles)
            if len(good) == pictures:
                return np.asarray(np.mean(good, axis=0))
            self.rig.exchange(np.append(u, [0.0, 0.0]))
        return np.full(2, np.nan)

    def _wait(self, u: FloatArray, seconds: float) -> None:
        """Hold two currents without a picture, except for the last tick."""
        self.rig.head.apply(u, seconds, seconds)
        self.tip.wait(seconds)
        self.rig.exchange(np.append(u, [0.0, 0.0]))

    def _lit(self) -> Frame:
        """Take a picture, and set the gain for the next one."""
        frame = self._frame()
        self._meter(frame)
        return frame

    def _meter(self, frame: Frame) -> None:
        """Set the gain by a picture, relative to the gain with which it was taken."""
        self._gain = LIMITS.gain(self._taken_with.get(frame.t, self._gain), frame.image)

    def _frame(self) -> Frame:
        self.tip.expose(LIMITS.exposure, self._gain)
        self.tip.move_to(self.rig.stance())
        frame = self.tip.frame()
        self._taken_with[frame.t] = self._gain
        return frame
