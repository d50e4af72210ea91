"""Bring the probe over a place, let water in, and fire a burst at each point of a raster.

Along the pipe the head bends from point to point. Around it the catheter rolls from row to row:
while the beam stays normal to the wall, it moves around the pipe by a third of the bend only.

Angles that the wires reach in water are predicted from their identification in air. Under a current
i, a wire that was identified at an ambient T_0 with a convection h_0 settles in water of T with a
convection c h_0 at the effective power i^2 / c + (T - T_0) / (rise resistance), see
`minorloop_head.control.hypotheses`. The resistance, over that of a hot wire, falls as it turns.
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
from minorloop_head.control.guard import Guard
from minorloop_head.control.head import HeadControl
from minorloop_head.control.reach import STROKE_SHARE, ReachWatch
from minorloop_head.geometry import AXES, REACH, wall_distance, wrapped
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.go import NEAR, go
from minorloop_head.procedures.meter import Light, meter
from minorloop_head.procedures.values import (
    NOTHING,
    NOW,
    LogEntry,
    Procedure,
    Reading,
    Request,
    passed,
)
from minorloop_head.sources import Shot
from minorloop_head.ultrasound.echoes import Burst, average, has_wall_echo
from minorloop_head.ultrasound.field import CalibratedProbe
from minorloop_head.ultrasound.pits import PITCH, POINTS, raster

SLEEVED = 4.0 / 3.0
"""Convection of a wire in its sleeve under water over that at identification in still air: 100 and
75 W/(m^2 K)."""
_SLEEVE_BAND = 0.04
"""Largest relative deviation of the convection of a sleeve: its bore is 10 % wider or narrower."""
_WATER_BAND = 0.6
"""Half of the 95 % band of the temperature of the water, in K: that of a thermometer."""
_ITERATIONS = 30
"""Iterations of the fixed point for the resistance; each halves its error."""
_ScanStage: TypeAlias = Literal["travel", "light", "turn", "points", "retreat", "roll", "back"]
_RETREAT, _MOST_AGAIN = math.radians(6.0), 2
"""Roll in radians by which the catheter turns back to approach a row again: three times its jump
when it breaks away, so that it slides to the row. And most such retreats in a scan."""
SHOTS = 16
"""Number in a burst: they take 16 ms, in which the head hardly moves."""
AIMED = math.radians(0.6)
"""Tolerance of a point in radians, 0.1 mm on the wall. No smaller one is needed, because a burst is
fitted where it was measured."""
DWELL, _MOST_DWELL = 0.48, 1.2
"""Seconds at a point, and longest seconds if the head does not come near: in 0.5 s a wire moves by
a step of the raster and comes to rest."""
_SILENT, _UNSEEN = 2.0, 0.2
"""Seconds after which a burst that was not fired is skipped, and for which a burst is repeated if
its picture does not show the pose."""
_TILT = math.radians(-15.0)
"""Tilt of the head: small, as the pan, since cold wires reach little in water."""
_ROLLING = 4.0
"""Longest seconds of the roll to the next row, which takes 1.3 s. The head tilts by the remaining
error; if it cannot, the catheter turns back and approaches the row again."""
_ROLLS = 4
"""Iterations of the search for a roll; each divides its error by 20, the radius over the offset."""
MOST_OFF = 0.8e-3
"""Largest distance in metres of a burst from its point of the raster, two and a half steps. A burst
is fitted where it was measured, so that only bursts outside the raster are refused."""
NO_COUPLING = "no coupling"


@dataclass(eq=False, kw_only=True)
class ScannedRaster:
    """State of the scan of a raster, which the scan keeps up to date."""

    reference: FloatArray = field(default_factory=lambda: np.zeros(2))
    """Shape (2,). Advance and roll of the catheter, in metres and radians, from which the beam is
    square to the middle: the angles of the bursts hold there."""
    bursts: tuple[Burst, ...] = ()
    """Bursts of the points whose readings had shots."""
    point: int = 0
    """The next one, from 0."""
    onward: int = 1
    """1 if the catheter rolls on towards greater phi after its travel, -1 if towards smaller phi:
    friction makes it jump where it turns back."""
    done: bool = True
    """Whether the scan has ended."""
    stage: _ScanStage = "travel"
    """Present stage of the scan."""
    targets: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    """Shape (N, 2). Pan and tilt of the points; none before the catheter has arrived, or if it did
    not."""
    again: int = 0
    """Number of times that the catheter turned back because it had jumped beyond a row."""
    refused: str = ""
    """Reason why it was not scanned; empty if it was."""
    steps: tuple[LogEntry, ...] = ()
    """Steps of the visit until its end, from its beginning or the scan before, to be kept."""
    centre: tuple[float, float] = (0.0, 0.0)
    """Phi and z of its middle, in radians and metres."""
    shift: float = 0.0
    """Its displacement in pitches, in both directions."""

    @property
    def progress(self) -> float:
        """Share of the points that have been measured."""
        return self.point / len(self.targets) if len(self.targets) else 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class RasterScan:
    """A raster of bursts."""

    calibration: HeadCalibration
    points: int = POINTS
    """Number of points in a row of the raster."""
    tilt: float = _TILT
    """Tilt of the head in radians at which the beam is square to the wall."""

    def scan(
        self,
        made: ScannedRaster,
        centre: tuple[float, float],
        shift: float = 0.0,
        light: Light | None = None,
    ) -> Procedure[ScannedRaster]:
        """Scan about a phi and a z in the drained pipe, which is flooded once the probe is there.

        Returns the scan as made.

        ``made``: new, or of the same scan, which was interrupted: it continues with the next point;
        ``centre``: in radians and metres; ``shift``: displacement of the raster in pitches;
        ``light``: of a camera that is exposed for the wall ahead before the pipe is flooded, where
        the loop does not do so all the time.
        """
        made.centre, made.shift, made.done = centre, shift, False
        if (yield from self._approach_row(made)):
            made.stage = "light"
            if light is None:
                yield Request(water=True)
            else:
                light.place = None
                yield from meter(self.calibration, light, last=Request(water=True))
            made.stage = "turn"
            yield from go(angles=made.targets[made.point])
            while (yield from self._scan_row(made)):
                yield from self._roll(made)
        made.done = True
        return made

    def _approach_row(self, made: ScannedRaster) -> Procedure[bool]:
        """Bring the probe over the next row of the raster; return whether it gets there."""
        while True:
            made.stage = "travel"
            now = yield NOW
            if not made.point:
                roll = self.rolled(made.centre[0], now.place)[1] - now.place[1]
                made.onward = 1 if roll >= 0 else -1
            place = self._rolled_to(made, now)
            place[0] = made.centre[1] + made.shift * PITCH
            yield from go(place, self.perpendicular)
            now = yield NOW
            rows = made.point // self.points * made.onward
            first = now.place - (0.0, rows * PITCH / self.calibration.radius)
            made.targets = self.targets(made.centre, first, made.shift, made.onward)
            if len(made.targets):
                break
            if not (yield from self._retreat(made)):
                return False
        if not made.point:
            made.reference = self.rolled(made.centre[0], now.place)
        return True

    def _scan_row(self, made: ScannedRaster) -> Procedure[bool]:
        """Fire at the points of a row, from where the catheter is; return whether points are left.

        If the row is not within reach from there, the catheter retreats to approach it again.
        """
        now, n = (yield NOW), made.point // self.points
        aims = self._row(made.centre, now.place, made.shift, self._index(n, made.onward))
        if not len(aims):
            return (yield from self._retreat(made))
        made.targets[n * self.points : (n + 1) * self.points] = aims
        made.stage, since = "points", now.t - DWELL
        while True:
            now = yield Request(angles=made.targets[made.point])
            now = yield from self._fire_at_point(made, now, since)
            made.point, since = made.point + 1, now.t
            if made.point == len(made.targets):
                return False
            if made.point % self.points == 0:
                yield Request(angles=made.targets[made.point])
                return True

    def _fire_at_point(self, made: ScannedRaster, now: Reading, since: float) -> Procedure[Reading]:
        """Fire at a point once the head is at rest, and stay until the burst has arrived.

        ``since`` is the time of the command to go there.
        """
        target = made.targets[made.point]
        fire = Request(angles=target, shots=SHOTS, frame=True)
        while not passed(since, now.t, DWELL if _near(now, target) else _MOST_DWELL):
            now = yield Request(angles=target)
        since = now.t
        now = yield fire
        while True:
            seen = bool(np.isfinite(now.base).all())
            if not (now.fired or now.shots or passed(since, now.t, _SILENT)):
                now = yield Request(angles=target)
            elif not seen and not passed(since, now.t, _UNSEEN):
                now = yield fire
            else:
                break
        if now.shots and seen:
            about = now.line_of_sight, target, now.place, made.reference
            burst = self.burst(now.shots, *about, coupled=has_coupling(made.bursts))
            made.bursts = (*made.bursts, burst)
        return now

    def _roll(self, made: ScannedRaster) -> Procedure[None]:
        """Roll to the next row."""
        made.stage = "roll"
        now = yield NOW
        yield from go(self._rolled_to(made, now), patience=_ROLLING)

    def _retreat(self, made: ScannedRaster) -> Procedure[bool]:
        """Turn back before a row that was jumped past; False if it is too far, or too often."""
        now = yield NOW
        row = self._rolled_to(made, now)
        if made.again >= _MOST_AGAIN or abs(row[1] - now.place[1]) > _RETREAT:
            return False
        made.stage, made.again = "retreat", made.again + 1
        now = yield NOTHING
        row = self._rolled_to(made, now)
        yield from go(row - (0.0, made.onward * _RETREAT), patience=_ROLLING)
        yield NOTHING
        return True

    def out_of_reach(self, control: HeadControl) -> str:
        """Return why the wires of a head do not reach the points in water; empty if they do."""
        view = self.calibration
        water, middle, wanted = view.temperature, view.joints(self.perpendicular), self.joints
        has, worst, best = (
            flooded_reach(control, middle, water + warmer, cooling=SLEEVED * share)
            for warmer, share in (
                (0.0, 1.0),
                (-_WATER_BAND, 1 + _SLEEVE_BAND),
                (_WATER_BAND, 1 - _SLEEVE_BAND),
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

    def in_water(self, control: HeadControl) -> RasterScan:
        """Return the scan with the tilt nearest to its own that the wires surely reach in water.

        The beam can be square to the wall at any tilt, and the line of sight stays in the cone.
        """
        view, (pan, _) = self.calibration, self.perpendicular.tolist()
        coldest, most_cooled = view.temperature - _WATER_BAND, SLEEVED * (1 + _SLEEVE_BAND)
        middle = view.joints(self.perpendicular)
        has = flooded_reach(control, middle, coldest, cooling=most_cooled)[1, 1]
        beyond = max(float(self.joints[1, 1] - has), 0.0)
        steepest = -math.sqrt(REACH**2 - pan**2)
        return replace(self, tilt=max(self.tilt - math.radians(beyond), steepest))

    @property
    def perpendicular(self) -> FloatArray:
        """(2,) pan and tilt at which the beam meets the wall at a right angle."""
        mount = self.calibration.mount_at(np.zeros(2))
        return np.array([self.calibration.probe.perpendicular(mount, self.tilt), self.tilt])

    @property
    def needs(self) -> FloatArray:
        """(2, 2) least and largest pan and tilt of a raster, in radians."""
        half = 0.5 * (self.points - 1) * PITCH / self.calibration.radius
        pan, tilt = self.perpendicular.tolist()
        left = NEAR[1] / abs(math.sin(pan))
        return np.array([[pan - half, pan + half], [tilt - left, tilt + left]])

    @property
    def joints(self) -> FloatArray:
        """(2, 2) least and largest reading of pan and tilt in a raster, in degrees."""
        return np.array([self.calibration.joints(pair) for pair in self.needs.T]).T

    def rolled(self, phi: float, place: npt.ArrayLike) -> FloatArray:
        """Return a place (2,) rolled, by the shorter way, until the beam is square to a phi."""
        advance, roll = np.asarray(place, dtype=np.float64).tolist()
        for _ in range(_ROLLS):
            spot = self.calibration.probe_at((advance, roll)).spots(self.perpendicular)
            roll += float(wrapped(phi - spot[0, 0]))
        return np.array([advance, roll])

    def targets(
        self, centre: tuple[float, float], place: npt.ArrayLike, shift: float = 0.0, onward: int = 1
    ) -> FloatArray:
        """Return pan and tilt (N, 2) of the points about a phi and a z; none if out of reach.

        ``place`` (2,) is that of the catheter at the first row; it rolls ``onward`` for each other
        row.
        """
        advance, roll = np.asarray(place, dtype=np.float64).tolist()
        step = onward * PITCH / self.calibration.radius
        rows = [
            self._row(centre, (advance, roll + n * step), shift, self._index(n, onward))
            for n in range(self.points)
        ]
        return np.concatenate(rows) if all(map(len, rows)) else np.empty((0, 2))

    def _row(
        self, centre: tuple[float, float], place: npt.ArrayLike, shift: float, row: int
    ) -> FloatArray:
        """Return pan and tilt (points, 2) of a row from a place; none if out of reach."""
        off, probe = shift * PITCH, self.calibration.probe_at(place)
        middle = centre[0] + off / probe.radius, centre[1] + off
        try:
            aims = raster(probe, middle, points=self.points, pitch=PITCH)
        except ParameterError:
            return np.empty((0, 2))
        aims = aims[row * self.points : (row + 1) * self.points]
        return aims if np.hypot(*aims.T).max() <= REACH else np.empty((0, 2))

    def _index(self, n: int, onward: int) -> int:
        """Return the place of the n-th row in the raster, by growing phi."""
        return n if onward > 0 else self.points - 1 - n

    def _rolled_to(self, made: ScannedRaster, now: Reading) -> FloatArray:
        """Return the place (2,) of the catheter for the next row, from where it is."""
        n = self._index(made.point // self.points, made.onward)
        steps = n - 0.5 * (self.points - 1) + made.shift
        return self.rolled(made.centre[0] + steps * PITCH / self.calibration.radius, now.place)

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

        ``angles``, ``target`` (2,): measured and wanted line of sight, in radians. ``place``,
        ``reference`` (2,): advance and roll of the catheter, and those of the whole raster. The
        advance is that of the raster: it has not moved. ``coupled``: as in `burst_of`.
        """
        there, here = self.calibration.mount_at(reference), self.calibration.mount_at(place)
        probe = self.calibration.probe
        seen, wanted = (
            probe.moved(here, float(pan), float(tilt), there)
            for pan, tilt in (np.asarray(angles), np.asarray(target))
        )
        return burst_of(shots, seen, wanted, self.calibration.probe_at(reference), coupled=coupled)


def _near(now: Reading, target: FloatArray) -> bool:
    """Return whether the head is at a point (2,)."""
    return float(np.hypot(*(now.angles - target))) < AIMED


def flooded_reach(
    control: HeadControl, wanted: npt.ArrayLike, temperature: float, *, cooling: float = SLEEVED
) -> FloatArray:
    """Return the least and largest reading (axes, 2) of the joints in water, in degrees.

    ``wanted`` (axes,): wanted readings in degrees, which give the positions of the other wires;
    ``temperature``: of the water, in degrees Celsius; ``cooling``: convection over that at
    identification.
    """
    ends = np.array([_ends(axis, temperature, cooling) for axis in control.axes])
    return control.reach(wanted, ends)


def _ends(guard: Guard, temperature: float, cooling: float) -> tuple[float, float]:
    """Return the least and largest angle of a wire in degrees."""
    wire, limits = guard.observer.wire, guard.limits
    low, top = wire.operator.range
    strongest = min(guard.observer.highest**2 / cooling, limits.highest_power)
    least = float(wire.operator.levels[0])
    most = float(wire.operator.levels[-1])
    found = []
    for power, begin in ((0.0, wire.begin(most)), (strongest, wire.begin(least))):
        angle = begin.angle
        for _ in range(_ITERATIONS):
            cold = (top - angle) / (top - low)
            resistance = 1.0 - cold * (1.0 - ReachWatch.cold_resistance)
            bias = (temperature - limits.ambient) / (limits.rise * resistance)
            settled = wire.moved(begin, float(np.clip(power + bias, least, most)))
            angle = 0.5 * (angle + settled.angle)
        found.append(angle)
    return found[0], min(found[1], STROKE_SHARE * top)


def burst_of(
    shots: Sequence[Shot],
    angles: npt.ArrayLike,
    wanted: npt.ArrayLike,
    probe: CalibratedProbe,
    *,
    coupled: bool,
) -> Burst:
    """Average a burst to one trace with a verdict.

    ``shots``: of the burst. ``angles``, ``wanted`` (2,): measured and wanted line of sight, in
    radians. ``probe``: at the place of the catheter. ``coupled``: whether an earlier burst of the
    raster has an echo of the wall. If not, a burst without echo has the verdict ``no coupling``;
    if so, it may have met the flank of a dent, which returns none.
    """
    spot, aimed = probe.spots(np.array([angles, wanted]))[:, :2]
    off = float(wall_distance(spot, aimed, probe.radius))
    count = len(shots)
    burst = average(shots, np.tile(angles, (count, 1)), np.full(count, off), most_off=MOST_OFF)
    wall = probe.radius - probe.transducer.face
    if not coupled and not burst.verdict and not has_wall_echo(shots, wall, probe.speed):
        return replace(burst, trace=np.empty(0), used=0, verdict=NO_COUPLING)
    return burst


def has_coupling(bursts: Sequence[Burst]) -> bool:
    """Return whether one of the bursts of a raster has an echo of the wall."""
    return any(burst.verdict != NO_COUPLING for burst in bursts)
