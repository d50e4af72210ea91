"""Sweep the probe along the wall while it fires, line by line, for a map of echoes.

The head holds pan and tilt, so that the beam is square to the wall. The catheter rolls along each
line and rolls back fast; all the while it advances slowly, by a line's distance for each line. It
never stops in between: friction would hold it, and then let it jump farther than the next line.

A request moves the catheter for one tick only. Whoever calls no further step has stopped it, and
has all bursts in the last state.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError
from minorloop_head.control.head import HeadControl
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.go import GO, Go, GoState
from minorloop_head.procedures.scan import RasterScan
from minorloop_head.procedures.values import Procedure, Reading, Request, passed
from minorloop_head.ultrasound.echoes import average
from minorloop_head.ultrasound.wall_echoes import SweptBurst, beam_width

SweepStage: TypeAlias = Literal["travel", "run up", "line", "return"]
STUCK = "the catheter does not follow"
NOT_THERE = "the catheter did not reach the first line"
_BEAMS = 2.0
"""Least size of an area in widths of the beam: one burst shows no wall beside a defect."""
_LONGEST = 10e-3
"""Longest part of the pipe in metres: with half an hour of the head for 1 cm."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SweepState:
    """State of a sweep.

    ``phi`` and ``z`` are the ends of the area, ``phi`` growing beyond pi where needed; ``rolls``
    those of a line, as the catheter measures them. ``go`` is the state of the way there. The line
    began at ``since`` and takes ``cycle`` seconds with the way back; ``pace`` is the rate of
    advance. The last burst was requested at the roll ``fired``; ``last`` is time and place (2,) of
    the last reading, ``moved`` of the last one at which the catheter had moved on. ``bursts`` are
    all that were fired; ``lines`` have ended. ``refused`` says why a sweep was not begun,
    ``trouble`` why it ended early.
    """

    phi: tuple[float, float]
    z: tuple[float, float]
    stage: SweepStage = "travel"
    go: GoState | None = None
    rolls: tuple[float, float] = (0.0, 0.0)
    since: float = 0.0
    pace: float = 0.0
    cycle: float = 0.0
    fired: float = math.nan
    last: tuple[float, FloatArray] = field(default_factory=lambda: (0.0, np.full(2, np.nan)))
    moved: tuple[float, FloatArray] = field(default_factory=lambda: (0.0, np.full(2, np.nan)))
    bursts: tuple[SweptBurst, ...] = ()
    lines: int = 0
    progress: float = 0.0
    refused: str = ""
    trouble: str = ""
    done: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class ProbeSweep(Procedure[SweepState]):
    """Lines round the pipe, fired while the catheter rolls.

    Parameters
    ----------
    calibration : HeadCalibration
    shots : int
        In a burst. Four take 4 ms, in which the spot moves by a tenth of its width.
    tick : float
        Of the loop, in seconds: there is one burst in each.
    overlap : float
        Distance of lines and of bursts over the width of the beam.
    fastest : float
        Highest rate of roll in rad/s, that of the way back. The motor has 60 degrees a second.
    margin : float
        By which a line is longer at either end, in radians.
    run_up : float
        Way in metres on which the tip breaks away from friction before the first line; it jumps
        by 0.4 mm.
    hurry : float
        Rate of advance in m/s on that way.
    turning : float
        Seconds of a turn back, until friction lets the tip follow, for the first guess of the pace.
    stalled : float
        Seconds without a move after which the sweep ends. To break away from friction takes 2.5 s
        on the way to the first line, and half a second of a turn.
    go : Go
        Of the way there.
    """

    calibration: HeadCalibration
    shots: int = 4
    tick: float = 0.04
    overlap: float = 1.0
    fastest: float = math.radians(55.0)
    margin: float = math.radians(2.0)
    run_up: float = 1e-3
    hurry: float = 0.8e-3
    turning: float = 0.5
    stalled: float = 4.0
    go: Go = GO

    @property
    def point(self) -> RasterScan:
        """A raster of one point: its angles, and whether they are within reach, are a sweep's."""
        return RasterScan(calibration=self.calibration, points=1)

    @property
    def pitch(self) -> float:
        """Distance of lines, and of bursts on a line, in metres."""
        view = self.calibration
        return self.overlap * beam_width(view.probe_at((0.0, 0.0)))

    @property
    def rate(self) -> float:
        """Rate of roll on a line, in rad/s."""
        return min(self.pitch / (self.tick * self.calibration.radius), self.fastest)

    def begin(
        self,
        phi: tuple[float, float],
        z: tuple[float, float],
        *,
        control: HeadControl | None = None,
        bursts: Sequence[SweptBurst] = (),
    ) -> SweepState:
        """Return the state before a sweep of an area.

        Parameters
        ----------
        phi : (float, float)
            First and last, in radians. The last is greater, by a turn at most.
        z : (float, float)
            First and last, in metres.
        control : HeadControl, optional
            Of the head. A sweep whose angles it does not reach in the water is refused: it is done,
            and its state says why.
        bursts : sequence of SweptBurst
            Of the same sweep, in their order, which was cut off: it goes on with their last line.

        Raises
        ------
        ParameterError
            If the area is smaller than two beams, too large, or not in the pipe.
        """
        self._check(phi, z)
        around = phi[1] - phi[0]
        refused = "" if control is None else self.point.out_of_reach(control)
        cycle = around * (1 / self.rate + 1 / self.fastest) + 2 * self.turning
        rolls = np.array([each.place[1] for each in bursts])
        # Within a line the roll falls by the noise of its sensor only.
        back = -0.5 * (around + 2 * self.margin)
        lines = int(np.count_nonzero(np.diff(rolls) < back))
        return SweepState(
            phi=phi,
            z=z,
            cycle=cycle,
            bursts=tuple(bursts),
            lines=lines,
            progress=min(lines * self.pitch / (z[1] - z[0]), 1.0),
            refused=refused,
            done=bool(refused),
        )

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

    def _first(self, state: SweepState) -> float:
        """Return the advance at which the next line begins."""
        return state.z[0] + state.lines * self.pitch

    def _next(self, state: SweepState, reading: Reading) -> tuple[SweepState, Request]:
        if reading.shots:
            state = replace(state, bursts=(*state.bursts, self.burst(state.last, reading)))
        state, request = self._moved(state, reading)
        return replace(state, last=(reading.t, reading.place)), request

    def _moved(self, state: SweepState, reading: Reading) -> tuple[SweepState, Request]:
        if state.stage == "travel":
            return self._travel(state, reading)
        since, place = state.moved
        off = np.hypot(*((reading.place - place) * (1.0, self.calibration.radius)))
        if not off < 0.5 * self.pitch:  # the first time there is nothing to compare with
            state = replace(state, moved=(reading.t, reading.place))
        elif passed(since, reading.t, self.stalled):
            return replace(state, trouble=STUCK, done=True), Request()
        advance, roll = reading.place.tolist()
        if state.stage == "run up" and advance < self._first(state):
            return state, self._rates(self.hurry, 0.0)
        if state.stage == "return" and roll > state.rolls[0]:
            return state, self._rates(state.pace, -self.fastest)
        if state.stage != "line":
            return self._begun(state, reading)
        return self._fired(state, roll) if roll < state.rolls[1] else self._ended(state, advance)

    def _fired(self, state: SweepState, roll: float) -> tuple[SweepState, Request]:
        """Roll on, and fire if the spot has moved."""
        off = abs(roll - state.fired) * self.calibration.radius
        if off < 0.5 * self.pitch:
            return state, self._rates(state.pace, self.rate)
        return replace(state, fired=roll), self._rates(state.pace, self.rate, shots=self.shots)

    def _ended(self, state: SweepState, advance: float) -> tuple[SweepState, Request]:
        """Return to the start of the next line, or end behind the last one."""
        low, high = state.z
        share = float(np.clip((advance - low) / (high - low), 0.0, 1.0))
        state = replace(state, stage="return", lines=state.lines + 1, progress=share)
        if share == 1.0:
            return replace(state, done=True), Request()
        return state, self._rates(state.pace, -self.fastest)

    def _travel(self, state: SweepState, reading: Reading) -> tuple[SweepState, Request]:
        """Go to before the first line, and let the water in."""
        if state.go is None:
            start = float(self.point.rolled(state.phi[0], reading.place)[1]) - self.margin
            end = start + state.phi[1] - state.phi[0] + 2 * self.margin
            place = (max(self._first(state) - self.run_up, 0.0), start)
            go = self.go.begin(place=place, angles=self.point.perpendicular)
            state = replace(state, rolls=(start, end), go=go)
        assert state.go is not None
        go, request = self.go.step(state.go, reading)
        state = replace(state, go=go)
        if not go.done:
            return state, request
        assert go.place is not None
        off = np.abs(go.place - reading.place)
        if not (off <= (self.run_up, 2 * self.margin)).all():
            return replace(state, trouble=NOT_THERE, done=True), Request()
        return replace(state, stage="run up"), Request(water=True)

    def _begun(self, state: SweepState, reading: Reading) -> tuple[SweepState, Request]:
        """Begin a line, at the pace that brings the next one to its place."""
        cycle = state.cycle if state.stage == "run up" else reading.t - state.since
        due = self._first(state) + self.pitch - float(reading.place[0])
        pace = float(np.clip(due, 0.5 * self.pitch, 1.5 * self.pitch)) / cycle
        state = replace(
            state, stage="line", since=reading.t, cycle=cycle, pace=pace, fired=math.nan
        )
        return state, self._rates(pace, self.rate)

    def _rates(self, advance: float, roll: float, *, shots: int = 0) -> Request:
        return Request(rates=np.array([advance, roll]), shots=shots)

    def burst(self, last: tuple[float, FloatArray], reading: Reading) -> SweptBurst:
        """Return the burst of a reading at the place in its middle; ``last`` as in the state."""
        (before, place), count = last, len(reading.shots)
        half = 0.5 * (reading.shots[-1].t - reading.shots[0].t)
        rate = (reading.place - place) / max(reading.t - before, 1e-3)
        here = reading.place + half * np.nan_to_num(rate)
        sight = reading.line_of_sight
        burst = average(reading.shots, np.tile(sight, (count, 1)), np.zeros(count))
        spot = self.calibration.probe_at(here).spots(sight)[0]
        return SweptBurst(reading.t + half, here, spot, burst)
