"""Bring the probe over a place, let water in, and fire a burst at each point of a raster.

Along the pipe the head bends from point to point. Around it the catheter rolls from row to row: a
beam that is normal to the wall moves around the pipe by a third of what the head bends only.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError
from minorloop_head.control.flooded_reach import SLEEVE_BAND, SLEEVED, WATER_BAND, flooded_reach
from minorloop_head.control.head import HeadControl
from minorloop_head.geometry import AXES, REACH, wrapped
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.go import GO, Go, GoState
from minorloop_head.procedures.measure import burst_of, has_coupling
from minorloop_head.procedures.meter import Metering, MeterState
from minorloop_head.procedures.values import NOTHING, Procedure, Reading, Request, passed
from minorloop_head.sources import Shot
from minorloop_head.ultrasound.echoes import Burst
from minorloop_head.ultrasound.pits import PITCH, POINTS, raster

ScanStage: TypeAlias = Literal["travel", "light", "turn", "points", "retreat", "roll", "back"]
RETREAT, MOST_AGAIN = math.radians(6.0), 2
"""Roll in radians by which the catheter turns back before it comes to a row again: three times what
it jumps when it breaks away, so that it slides to the row. And how often it does so in a scan."""
_ROLLS = 4
"""Steps of the search for a roll; each divides its error by 20, the radius over the offset."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ScanState:
    """State of a scan.

    ``centre`` is phi and z of the middle; ``shift`` the displacement of the raster in pitches;
    ``onward`` is 1 if the catheter rolls on towards greater phi after its travel, -1 if towards
    smaller phi: friction makes it jump where it turns back. ``again`` counts how often it has
    turned back, because it had jumped beyond a row, and come to the row once more. ``home`` place
    and angles to return to, None to stay; ``go`` the state of the way there or back; ``targets``
    (N, 2) pan and tilt of the points, ``point`` the next of them. The head was sent there, or the
    burst was ``requested``, at ``since``. ``meter`` is the state of the exposure. ``bursts`` are
    filled if the readings contain shots; their angles hold at the ``reference``, a place (2,) from
    which the beam is square to the middle. ``refused`` says why a scan was not begun.
    """

    centre: tuple[float, float]
    shift: float = 0.0
    onward: int = 1
    again: int = 0
    home: tuple[FloatArray, FloatArray] | None = None
    stage: ScanStage = "travel"
    go: GoState | None = None
    meter: MeterState = field(default_factory=MeterState)
    targets: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    reference: FloatArray = field(default_factory=lambda: np.zeros(2))
    point: int = 0
    since: float = 0.0
    requested: bool = False
    bursts: tuple[Burst, ...] = ()
    refused: str = ""
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
    unseen : float
        Seconds for which a burst is fired again whose picture does not show the pose.
    metering : Metering, optional
        Exposes the camera before the pipe is flooded, where the loop does not do so all the time.
    reach : float
        Half-angle of the cone in which the head may turn, in radians.
    tilt : float
        Of the head, in radians: as little as the pan, since cold wires reach little in water.
    go : Go
        Of the way there.
    rolling : float
        ``patience`` of the way to the next row, which takes 1.3 s. What then remains of it, or is
        too much, is tilted; if the head cannot, the catheter turns back and comes again.
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
    unseen: float = 0.2
    metering: Metering | None = None
    reach: float = REACH
    tilt: float = math.radians(-15.0)
    go: Go = GO
    rolling: float = 4.0
    homing: float = 6.0

    def begin(
        self,
        centre: tuple[float, float],
        *,
        shift: float = 0.0,
        home: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
        control: HeadControl | None = None,
        gain: float = 1.0,
        before: ScanState | None = None,
    ) -> ScanState:
        """Return the state before a scan about a phi and a z, after which the head returns home.

        ``gain`` is that of the camera. ``before`` is a state of the same scan, which was cut off:
        it goes on with its next point; point, bursts, direction and reference count.

        With the control of the head, a scan that it cannot reach in the water is refused: it is
        done, and its state says why.
        """
        refused = "" if control is None else self.out_of_reach(control)
        back = None
        if home is not None:
            back = np.asarray(home[0], dtype=np.float64), np.asarray(home[1], dtype=np.float64)
        known = before or ScanState(centre=centre)
        return ScanState(
            onward=known.onward,
            point=known.point,
            bursts=known.bursts,
            reference=known.reference,
            centre=centre,
            shift=shift,
            home=back,
            meter=MeterState(gain=gain),
            refused=refused,
            done=bool(refused),
        )

    def out_of_reach(self, control: HeadControl) -> str:
        """Return why the wires of a head do not reach the points in water; empty if they do."""
        view = self.calibration
        water, middle = view.temperature, view.joints(self.perpendicular)
        wanted = np.array([view.joints(pair) for pair in self.needs.T]).T
        has, worst, best = (
            flooded_reach(control, middle, water + warmer, cooling=SLEEVED * share)
            for warmer, share in (
                (0.0, 1.0),
                (-WATER_BAND, 1 + SLEEVE_BAND),
                (WATER_BAND, 1 - SLEEVE_BAND),
            )
        )
        for axis, name in enumerate(AXES):
            for end, beyond in ((1, 1.0), (0, -1.0)):
                need, mine = wanted[axis, end], has[axis, end]
                if beyond * (need - mine) > 0:
                    words = "has" if end else "stays above"
                    band = f"{worst[axis, end]:.0f} to {best[axis, end]:.0f}"
                    return (
                        f"out of reach: {name} needs {need:.0f} degrees, {words} {mine:.0f} "
                        f"({band}) in water of {water:.0f} C"
                    )
        return ""

    @property
    def perpendicular(self) -> FloatArray:
        """(2,) pan and tilt at which the beam meets the wall at a right angle."""
        mount = self.calibration.mount_at(np.zeros(2))
        return np.array([self.calibration.probe.perpendicular(mount, self.tilt), self.tilt])

    @property
    def needs(self) -> FloatArray:
        """(2, 2) least and largest pan and tilt of a raster, in radians."""
        half = 0.5 * (self.points - 1) * self.pitch / self.calibration.radius
        pan, tilt = self.perpendicular.tolist()
        left = self.go.near[1] / abs(math.sin(pan))
        return np.array([[pan - half, pan + half], [tilt - left, tilt + left]])

    def rolled(self, phi: float, place: npt.ArrayLike) -> FloatArray:
        """Return a place (2,) rolled, by the shorter way, until the beam is square to a phi."""
        advance, roll = np.asarray(place, dtype=np.float64).tolist()
        for _ in range(_ROLLS):
            spot = self.calibration.probe_at((advance, roll)).spots(self.perpendicular)
            roll += float(wrapped(phi - spot[0, 0]))
        return np.array([advance, roll])

    def targets(
        self,
        centre: tuple[float, float],
        place: npt.ArrayLike,
        shift: float = 0.0,
        onward: int = 1,
    ) -> FloatArray:
        """Return pan and tilt (N, 2) of the points about a phi and a z; none if out of reach.

        ``place`` (2,) is that of the catheter at the first row; it rolls ``onward`` for each other
        row.
        """
        advance, roll = np.asarray(place, dtype=np.float64).tolist()
        step = onward * self.pitch / self.calibration.radius
        rows = [
            self._row(centre, (advance, roll + n * step), shift, self._index(n, onward))
            for n in range(self.points)
        ]
        return np.concatenate(rows) if all(map(len, rows)) else np.empty((0, 2))

    def _row(
        self, centre: tuple[float, float], place: npt.ArrayLike, shift: float, row: int
    ) -> FloatArray:
        """Return pan and tilt (points, 2) of a row from a place; none if out of reach."""
        off, probe = shift * self.pitch, self.calibration.probe_at(place)
        middle = centre[0] + off / probe.radius, centre[1] + off
        try:
            aims = raster(probe, middle, points=self.points, pitch=self.pitch)
        except ParameterError:
            return np.empty((0, 2))
        aims = aims[row * self.points : (row + 1) * self.points]
        return aims if np.hypot(*aims.T).max() <= self.reach else np.empty((0, 2))

    def _index(self, n: int, onward: int) -> int:
        """Return the place of the n-th row in the raster, by growing phi."""
        return n if onward > 0 else self.points - 1 - n

    def _phi(self, state: ScanState, n: int) -> float:
        """Return the phi of the n-th row."""
        steps = self._index(n, state.onward) - 0.5 * (self.points - 1) + state.shift
        return state.centre[0] + steps * self.pitch / self.calibration.radius

    def _next(self, state: ScanState, reading: Reading) -> tuple[ScanState, Request]:
        if state.stage == "points":
            return self._points(state, reading)
        if state.stage == "light":
            return self._lit(state, reading)
        if state.stage == "travel" and state.go is None and not state.point:
            roll = self.rolled(state.centre[0], reading.place)[1] - reading.place[1]
            state = replace(state, onward=1 if roll >= 0 else -1)
        go = self._way(state, reading) if state.go is None else state.go
        longest = {"back": self.homing, "retreat": self.rolling, "roll": self.rolling}
        patience = longest.get(state.stage, self.go.patience)
        go, request = replace(self.go, patience=patience).step(go, reading)
        state = replace(state, go=go)
        if not go.done:
            return state, request
        if state.stage == "travel":
            rows = state.point // self.points * state.onward
            first = reading.place - (0.0, rows * self.pitch / self.calibration.radius)
            targets = self.targets(state.centre, first, state.shift, state.onward)
            if not len(targets):
                return self._passed(state, reading), request
            reference = state.reference
            if not state.point:
                reference = self.rolled(state.centre[0], reading.place)
            state = replace(state, targets=targets, reference=reference, stage="light", go=None)
            return self._lit(state, reading)
        if state.stage == "retreat":
            onto: ScanStage = "roll" if len(state.targets) else "travel"
            return replace(state, stage=onto, go=None), request
        if state.stage in ("turn", "roll"):
            return self._arrived(state, reading)
        return replace(state, done=True), request

    def _lit(self, state: ScanState, reading: Reading) -> tuple[ScanState, Request]:
        """Expose the camera for the wall ahead, and then let the water in."""
        request = NOTHING
        if self.metering is not None:
            meter, request = self.metering.step(state.meter, reading)
            state = replace(state, meter=meter)
            if not meter.done:
                return state, request
        return replace(state, stage="turn"), replace(request, water=True)

    def _arrived(self, state: ScanState, reading: Reading) -> tuple[ScanState, Request]:
        """Begin a row from where the catheter is, or come to it again if it is not near enough."""
        n, targets = state.point // self.points, state.targets.copy()
        row = self._index(n, state.onward)
        aims = self._row(state.centre, reading.place, state.shift, row)
        if not len(aims):
            return self._passed(state, reading), NOTHING
        targets[n * self.points : (n + 1) * self.points] = aims
        state = replace(state, targets=targets, stage="points", since=reading.t - self.dwell)
        return state, Request(angles=targets[state.point])

    def _passed(self, state: ScanState, reading: Reading) -> ScanState:
        """Return the state that turns back for a row that was jumped past; some times at most."""
        row = self.rolled(self._phi(state, state.point // self.points), reading.place)
        if state.again >= MOST_AGAIN or abs(row[1] - reading.place[1]) > RETREAT:
            return self._back(state)
        return replace(state, stage="retreat", go=None, again=state.again + 1)

    def _way(self, state: ScanState, reading: Reading) -> GoState:
        """Return the move with which a stage begins."""
        if state.stage == "turn":
            return self.go.begin(angles=state.targets[state.point])
        if state.stage in ("retreat", "roll"):
            row = self.rolled(self._phi(state, state.point // self.points), reading.place)
            row[1] -= state.onward * RETREAT * (state.stage == "retreat")
            return self.go.begin(place=row)
        if state.stage == "back" and state.home is not None:
            place, angles = state.home
            return self.go.begin(place=place, angles=angles)
        place = self.rolled(self._phi(state, state.point // self.points), reading.place)
        place[0] = state.centre[1] + state.shift * self.pitch
        return self.go.begin(place=place, angles=self.perpendicular)

    def _points(self, state: ScanState, reading: Reading) -> tuple[ScanState, Request]:
        """Fire once the head is at rest, and stay until the burst has arrived."""
        target = state.targets[state.point]
        if not state.requested:
            near = float(np.hypot(*(reading.angles - target))) < self.aimed
            if not passed(state.since, reading.t, self.dwell if near else self.most_dwell):
                return state, Request(angles=target)
            state = replace(state, requested=True, since=reading.t)
            return state, Request(angles=target, shots=self.shots, frame=True)
        late = passed(state.since, reading.t, self.silent)
        if not (reading.fired or reading.shots or late):
            return state, Request(angles=target)
        seen = bool(np.isfinite(reading.base).all())
        if not seen and not passed(state.since, reading.t, self.unseen):
            return state, Request(angles=target, shots=self.shots, frame=True)
        if reading.shots and seen:
            burst = self.burst(
                reading.shots,
                reading.line_of_sight,
                target,
                reading.place,
                state.reference,
                coupled=has_coupling(state.bursts),
            )
            state = replace(state, bursts=(*state.bursts, burst))
        state = replace(state, point=state.point + 1, requested=False, since=reading.t)
        if state.point == len(state.targets):
            return self._back(state), Request(angles=target)
        if state.point % self.points == 0:
            return replace(state, stage="roll", go=None), Request(angles=state.targets[state.point])
        return state, Request(angles=state.targets[state.point])

    def burst(
        self,
        shots: Sequence[Shot],
        angles: npt.ArrayLike,
        target: npt.ArrayLike,
        place: npt.ArrayLike,
        reference: npt.ArrayLike,
        *,
        coupled: bool,
    ) -> Burst:
        """Average the shots of a point to a burst whose angles hold at a reference.

        Parameters
        ----------
        shots : sequence of Shot
        angles, target : (2,) array_like
            Line of sight as measured and as wanted, in radians.
        place, reference : (2,) array_like
            Advance and roll of the catheter, and those of the whole raster. The advance is that of
            the raster: it has not moved.
        coupled : bool
            As in `burst_of`.
        """
        there, here = self.calibration.mount_at(reference), self.calibration.mount_at(place)
        probe = self.calibration.probe
        seen, wanted = (
            probe.moved(here, float(pan), float(tilt), there)
            for pan, tilt in (np.asarray(angles), np.asarray(target))
        )
        return burst_of(shots, seen, wanted, self.calibration.probe_at(reference), coupled=coupled)

    def _back(self, state: ScanState) -> ScanState:
        return replace(state, stage="back", go=None, done=state.home is None)
