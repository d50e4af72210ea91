"""Bring the probe over a place, let water in, and fire a burst at each point of a raster."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError
from minorloop.head.geometry import REACH, wrapped
from minorloop.head.procedures.calibration import HeadCalibration
from minorloop.head.procedures.go import GO, Go, GoState
from minorloop.head.procedures.measure import burst_of
from minorloop.head.procedures.values import Procedure, Reading, Request, passed
from minorloop.head.ultrasound.echoes import Burst
from minorloop.head.ultrasound.pits import PITCH, POINTS, raster

ScanStage: TypeAlias = Literal["travel", "turn", "points", "back"]


@dataclass(frozen=True, eq=False, kw_only=True)
class ScanState:
    """State of a scan.

    ``centre`` is phi and z of the middle; ``shift`` the displacement of the raster in pitches;
    ``home`` place and angles to return to, None to stay; ``go`` the state of the way there or
    back; ``targets`` (N, 2) pan and tilt of the points, ``point`` the next of them. The head was
    sent there, or the burst was ``requested``, at ``since``. ``bursts`` are filled if the readings
    contain shots.
    """

    centre: tuple[float, float]
    shift: float = 0.0
    home: tuple[FloatArray, FloatArray] | None = None
    stage: ScanStage = "travel"
    go: GoState | None = None
    targets: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    point: int = 0
    since: float = 0.0
    requested: bool = False
    bursts: tuple[Burst, ...] = ()
    done: bool = False

    @property
    def progress(self) -> float:
        """Share of the points that have been measured."""
        return self.point / len(self.targets) if len(self.targets) else 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class RasterScan(Procedure[ScanState]):
    """A raster of bursts.

    Parameters
    ----------
    calibration : HeadCalibration
    points : int
        In a row of the raster.
    pitch : float
        Between points, in metres.
    shots : int
        In a burst. Sixteen take 16 ms, in which the head hardly moves.
    aimed : float
        Tolerance of a point in radians: 0.6 degrees are 0.1 mm of the wall. A burst is fitted
        where it was measured, so that a smaller one is not needed.
    dwell, most_dwell : float
        Seconds at a point at least, and at most if the head does not come near: in 0.5 s a wire
        has moved by a step of the raster and is at rest.
    silent : float
        Seconds after which a burst that has not been fired is skipped.
    reach : float
        Half-angle of the cone in which the head may turn, in radians.
    go : Go
        Of the way there.
    homing : float
        ``patience`` of the way back; at the end of its travel friction holds the catheter off.
    """

    calibration: HeadCalibration
    points: int = POINTS
    pitch: float = PITCH
    shots: int = 16
    aimed: float = math.radians(0.6)
    dwell: float = 0.48
    most_dwell: float = 1.2
    silent: float = 2.0
    reach: float = REACH
    go: Go = GO
    homing: float = 6.0

    def begin(
        self,
        centre: tuple[float, float],
        *,
        shift: float = 0.0,
        home: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    ) -> ScanState:
        """Return the state before a scan about a phi and a z, after which the head returns home."""
        back = None
        if home is not None:
            back = np.asarray(home[0], dtype=np.float64), np.asarray(home[1], dtype=np.float64)
        return ScanState(centre=centre, shift=shift, home=back)

    @property
    def perpendicular(self) -> FloatArray:
        """(2,) pan and tilt at which the beam meets the wall at a right angle."""
        return np.array([math.pi / 2 - self.calibration.probe.squint, 0.0])

    def targets(
        self, centre: tuple[float, float], place: npt.ArrayLike, shift: float = 0.0
    ) -> FloatArray:
        """Return pan and tilt (N, 2) of the points about a phi and a z; none if out of reach."""
        probe, off = self.calibration.probe_at(place), shift * self.pitch
        middle = centre[0] + off / probe.radius, centre[1] + off
        try:
            aims = raster(probe, middle, points=self.points, pitch=self.pitch)
        except ParameterError:
            return np.empty((0, 2))
        within = np.hypot(*aims.T).max() <= self.reach
        return aims if within else np.empty((0, 2))

    def _next(self, state: ScanState, reading: Reading) -> tuple[ScanState, Request]:
        if state.stage == "points":
            return self._points(state, reading)
        go = self._way(state, reading) if state.go is None else state.go
        how = replace(self.go, patience=self.homing) if state.stage == "back" else self.go
        go, request = how.step(go, reading)
        state = replace(state, go=go)
        if not go.done:
            return state, request
        if state.stage == "travel":
            targets = self.targets(state.centre, reading.place, state.shift)
            if not len(targets):
                return self._back(state), request
            state = replace(state, targets=targets, stage="turn", go=None)
            return state, Request(angles=targets[0], water=True)
        if state.stage == "turn":
            state = replace(state, stage="points", since=reading.t - self.dwell)
            return state, Request(angles=state.targets[0])
        return replace(state, done=True), request

    def _way(self, state: ScanState, reading: Reading) -> GoState:
        """Return the move with which a stage begins."""
        if state.stage == "turn":
            return self.go.begin(angles=state.targets[0])
        if state.stage == "back" and state.home is not None:
            place, angles = state.home
            return self.go.begin(place=place, angles=angles)
        (phi, z), roll = state.centre, float(reading.place[1])
        off = float(wrapped(phi - self.calibration.roll - roll))  # the shorter way round
        return self.go.begin(place=(z, roll + off), angles=self.perpendicular)

    def _points(self, state: ScanState, reading: Reading) -> tuple[ScanState, Request]:
        """Fire once the head is at rest, and stay until the burst has arrived."""
        target = state.targets[state.point]
        if not state.requested:
            near = float(np.hypot(*(reading.angles - target))) < self.aimed
            if not passed(state.since, reading.t, self.dwell if near else self.most_dwell):
                return state, Request(angles=target)
            state = replace(state, requested=True, since=reading.t)
            return state, Request(angles=target, shots=self.shots)
        late = passed(state.since, reading.t, self.silent)
        if not (reading.fired or reading.shots or late):
            return state, Request(angles=target)
        if reading.shots:
            state = replace(state, bursts=(*state.bursts, self._burst(state, reading, target)))
        state = replace(state, point=state.point + 1, requested=False, since=reading.t)
        if state.point == len(state.targets):
            return self._back(state), Request(angles=target)
        return state, Request(angles=state.targets[state.point])

    def _burst(self, state: ScanState, reading: Reading, target: FloatArray) -> Burst:
        probe, angles = self.calibration.probe_at(reading.place), reading.line_of_sight
        return burst_of(reading.shots, angles, target, probe, first=not state.bursts)

    def _back(self, state: ScanState) -> ScanState:
        return replace(state, stage="back", go=None, done=state.home is None)
