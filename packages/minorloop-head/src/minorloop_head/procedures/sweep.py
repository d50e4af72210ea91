"""Sweep the probe along the wall while it fires, line by line, for a map of echoes.

The head holds pan and tilt, so that the beam is square to the wall. The catheter rolls along each
line and rolls back fast. Meanwhile it advances slowly, by the distance of lines for each line. It
never stops in between: friction would hold it, and then let it jump farther than the next line.

A request moves the catheter for one tick only: it stops if no other request follows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.go import go
from minorloop_head.procedures.scan import RasterScan
from minorloop_head.procedures.values import NOW, Procedure, Reading, Request, passed
from minorloop_head.ultrasound.echoes import average
from minorloop_head.ultrasound.wall_echoes import SweptBurst, beam_width

_SweepStage: TypeAlias = Literal["travel", "run up", "line", "return"]
STUCK = "the catheter does not follow"
NOT_THERE = "the catheter did not reach the first line"
SHOTS = 4
"""Number in a burst: they take 4 ms, in which the spot moves by a tenth of its width."""
_FASTEST = math.radians(55.0)
"""Highest rate of roll in rad/s, used on the way back. The motor reaches 60 degrees a second."""
_MARGIN = math.radians(2.0)
"""Extra length of a line at either end, in radians."""
_RUN_UP, _HURRY = 1e-3, 0.8e-3
"""Advance in metres before the first line, on which the tip breaks away from friction and jumps by
0.4 mm; and its rate in m/s."""
_TURNING = 0.5
"""Seconds of a reversal until friction lets the tip follow, for the first guess of the pace."""
_STALLED = 4.0
"""Seconds without motion after which the sweep ends. Breaking away from friction takes 2.5 s before
the first line, and half a second of a reversal."""
_BEAMS = 2.0
"""Least size of an area in widths of the beam: one burst shows no wall beside a defect."""
_LONGEST = 10e-3
"""Largest length of the area in metres: 1 cm takes half an hour."""


@dataclass(eq=False, kw_only=True)
class SweptArea:
    """State of the sweep of an area, which the sweep keeps up to date.

    ``phi`` and ``z`` are the ends of the area; ``phi`` may exceed pi. ``bursts`` are all fired
    bursts, ``lines`` the number of finished lines. ``moved`` is the time and place (2,) of the last
    motion of the catheter. ``trouble`` says why the sweep ended early.
    """

    phi: tuple[float, float]
    z: tuple[float, float]
    bursts: list[SweptBurst] = field(default_factory=list)
    stage: _SweepStage = "travel"
    lines: int = 0
    progress: float = 0.0
    moved: tuple[float, FloatArray] = field(default_factory=lambda: (0.0, np.full(2, np.nan)))
    trouble: str = ""


class _Stuck(Exception):
    """The catheter does not follow."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ProbeSweep:
    """Lines round the pipe, fired while the catheter rolls."""

    calibration: HeadCalibration
    tick: float = 0.04
    """Duration of a tick of the loop in seconds; there is at most one burst in each."""

    @property
    def point(self) -> RasterScan:
        """A raster of one point, which has the angles and the reach of a sweep."""
        return RasterScan(calibration=self.calibration, points=1)

    @property
    def pitch(self) -> float:
        """Distance of lines, and of bursts on a line, in metres."""
        view = self.calibration
        return beam_width(view.probe_at((0.0, 0.0)))

    @property
    def rate(self) -> float:
        """Rate of roll on a line, in rad/s."""
        return min(self.pitch / (self.tick * self.calibration.radius), _FASTEST)

    def area(
        self, phi: tuple[float, float], z: tuple[float, float], bursts: Sequence[SweptBurst] = ()
    ) -> SweptArea:
        """Return an area to be swept.

        Raises a `ParameterError` if the area is smaller than two beams, too large, or not in the
        pipe.

        ``phi``: first and last, in radians. The last is greater, by a turn at most. ``z``: first
        and last, in metres. ``bursts``: those of the same sweep, in their order, if it was
        interrupted: it continues with their last line.
        """
        self._check(phi, z)
        rolls = np.array([each.place[1] for each in bursts])
        # Within a line the roll falls by the noise of its sensor only.
        back = -0.5 * (phi[1] - phi[0] + 2 * _MARGIN)
        lines = int(np.count_nonzero(np.diff(rolls) < back))
        share = min(lines * self.pitch / (z[1] - z[0]), 1.0)
        return SweptArea(phi=phi, z=z, bursts=list(bursts), lines=lines, progress=share)

    def _check(self, phi: tuple[float, float], z: tuple[float, float]) -> None:
        """Refuse an area that cannot be swept."""
        degrees, mm = np.degrees(phi).tolist(), [1e3 * each for each in z]
        beams = _BEAMS * beam_width(self.calibration.probe_at((0.0, 0.0)))
        least = math.degrees(beams / self.calibration.radius)
        around = degrees[1] - degrees[0]
        if not least <= around <= 360.0 + 1e-6:
            raise ParameterError(
                f"the sweep goes from {degrees[0]:.4g} to {degrees[1]:.4g} degrees around the "
                f"pipe, that is {around:.4g} degree{'s' * (f'{around:.4g}' != '1')}; give at least "
                f"{least:.1f}, two widths of the beam, and at most 360 degrees, the greater angle "
                "last"
            )
        far = math.inf if self.calibration.length is None else 1e3 * self.calibration.length
        if not (mm[0] >= 0 and mm[1] <= far and math.isfinite(mm[1])):
            pipe = "" if math.isinf(far) else f", up to the end of the pipe at {far:.4g} mm"
            raise ParameterError(
                f"the sweep goes from {mm[0]:.4g} to {mm[1]:.4g} mm along the pipe; give places "
                f"from 0 mm on{pipe}"
            )
        if not 1e3 * beams <= mm[1] - mm[0] <= 1e3 * _LONGEST + 1e-6:
            raise ParameterError(
                f"the sweep goes from {mm[0]:.4g} to {mm[1]:.4g} mm along the pipe, which are "
                f"{mm[1] - mm[0]:.4g} mm; give at least {1e3 * beams:.2f}, two widths of the beam, "
                f"and at most {1e3 * _LONGEST:g} mm, the greater place last"
            )

    def sweep(self, made: SweptArea) -> Procedure[SweptArea]:
        """Sweep an area in the drained pipe, which is flooded before the first line; return it."""
        now = yield NOW
        start = float(self.point.rolled(made.phi[0], now.place)[1]) - _MARGIN
        end = start + made.phi[1] - made.phi[0] + 2 * _MARGIN
        place = np.array([max(self._first(made) - _RUN_UP, 0.0), start])
        yield from go(place, self.point.perpendicular)
        now = yield NOW
        if not (np.abs(place - now.place) <= (_RUN_UP, 2 * _MARGIN)).all():
            made.trouble = NOT_THERE
            return made
        made.stage = "run up"
        now = yield Request(water=True)
        made.moved = now.t, now.place
        try:
            yield from self._lines(made, now, start, end)
        except _Stuck:
            made.trouble = STUCK
        return made

    def _lines(self, made: SweptArea, now: Reading, start: float, end: float) -> Procedure[None]:
        """Fire on lines from one roll to another, until they cover the area."""
        while now.place[0] < self._first(made):
            now = yield from self._move(made, now, _HURRY, 0.0)
        cycle = (made.phi[1] - made.phi[0]) * (1 / self.rate + 1 / _FASTEST) + 2 * _TURNING
        while True:
            # The rate of advance that brings the next line to its place.
            due = self._first(made) + self.pitch - float(now.place[0])
            pace = float(np.clip(due, 0.5 * self.pitch, 1.5 * self.pitch)) / cycle
            made.stage, began, fired = "line", now.t, math.nan
            now = yield from self._move(made, now, pace, self.rate)
            while (roll := float(now.place[1])) < end:
                still = abs(roll - fired) * self.calibration.radius < 0.5 * self.pitch
                fired = fired if still else roll
                now = yield from self._move(made, now, pace, self.rate, 0 if still else SHOTS)
            low, high = made.z
            made.stage, made.lines = "return", made.lines + 1
            made.progress = float(np.clip((now.place[0] - low) / (high - low), 0.0, 1.0))
            if made.progress == 1.0:
                return
            now = yield from self._move(made, now, pace, -_FASTEST)
            while now.place[1] > start:
                now = yield from self._move(made, now, pace, -_FASTEST)
            cycle = now.t - began

    def _first(self, made: SweptArea) -> float:
        """Return the advance at which the next line begins."""
        return made.z[0] + made.lines * self.pitch

    def _move(
        self, made: SweptArea, before: Reading, advance: float, roll: float, shots: int = 0
    ) -> Procedure[Reading]:
        """Move for a tick at rates in m/s and rad/s, and keep the burst of the tick."""
        now = yield Request(rates=np.array([advance, roll]), shots=shots)
        if now.shots:
            made.bursts.append(self.burst((before.t, before.place), now))
        since, place = made.moved
        off = np.hypot(*((now.place - place) * (1.0, self.calibration.radius)))
        if not off < 0.5 * self.pitch:
            made.moved = now.t, now.place
        elif passed(since, now.t, _STALLED):
            raise _Stuck
        return now

    def burst(self, last: tuple[float, FloatArray], reading: Reading) -> SweptBurst:
        """Return the burst of a reading, at the place of the middle of its shots.

        ``last`` is time and place (2,) of the reading before.
        """
        (before, place), count = last, len(reading.shots)
        half = 0.5 * (reading.shots[-1].t - reading.shots[0].t)
        rate = (reading.place - place) / max(reading.t - before, 1e-3)
        here = reading.place + half * np.nan_to_num(rate)
        sight = reading.line_of_sight
        burst = average(reading.shots, np.tile(sight, (count, 1)), np.zeros(count))
        spot = self.calibration.probe_at(here).spots(sight)[0]
        return SweptBurst(reading.t + half, here, spot, burst)
