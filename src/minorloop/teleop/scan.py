"""A scan of a finding with the probe, as a procedure of ticks: go there, point by point, and back.

It asks for angles of the head and rates of the catheter, and says when the probe is to fire. It
moves nothing by itself: SCAN is a mode, and what ends the mode ends the scan.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from minorloop.errors import ParameterError
from minorloop.geometry import wrapped
from minorloop.teleop.gaze import Pair
from minorloop.teleop.plant import View, Where
from minorloop.teleop.sight import Wish
from minorloop.teleop.sounding import scan_targets

Stage: TypeAlias = Literal["travel", "settle", "turn", "points", "back", "done"]
_FASTEST, _NEAR = (8.0, 40.0), (0.05, 0.3)
# At the end of its travel the friction of the tube holds it off: then near enough will do.
_HOME, _NEARLY_HOME, _HOMING = (0.1, 0.5), (1.0, 3.0), 6.0
_GAIN = 2.0
_PATIENCE = {"travel": 40.0, "settle": 0.4, "turn": 5.0, "back": 10.0}
_DWELL, _MOST_DWELL, _AIMED = 0.48, 1.2, 0.6
_MOST_UNHEARD = 2.0
_SQUARELY = (25.0, 0.0)
_REACH = 30.0  # degrees: no head of ours turns farther


@dataclass(frozen=True, kw_only=True)
class Scan:
    """A scan that is going on.

    Parameters
    ----------
    number : int
        Of the finding.
    centre : (float, float)
        Phi in radians and z in metres.
    diameter : float
        In metres.
    home : (float, float, float, float)
        Where it goes back to: pan, tilt, advance and roll.
    stage : str
    point : int
        Which one is next.
    waited : float
        Seconds in this stage, or at this point.
    targets : tuple of (float, float)
        Pan and tilt of the points, in degrees.
    fired, heard : bool
        Whether the probe was told to fire at this point, and has.
    """

    number: int
    centre: tuple[float, float]
    diameter: float
    home: Where
    stage: Stage = "travel"
    point: int = 0
    waited: float = 0.0
    targets: tuple[Pair, ...] = ()
    fired: bool = False
    heard: bool = False

    @property
    def progress(self) -> float:
        """Share of the points that have been heard."""
        return self.point / len(self.targets) if self.targets else 0.0


@dataclass(frozen=True)
class Asked:
    """What a tick of a scan asks for: angles in degrees, rates in mm/s and degrees/s, wishes."""

    angles: Pair
    rates: Pair = (0.0, 0.0)
    wishes: tuple[Wish, ...] = ()


def scanned(scan: Scan, view: View, where: Where, interval: float) -> tuple[Scan, Asked]:
    """The scan after a tick, and what it asks for."""
    scan = replace(scan, waited=scan.waited + interval)
    late = scan.waited >= _PATIENCE.get(scan.stage, math.inf)
    if scan.stage == "travel":
        goal = 1e3 * scan.centre[1], _nearest_turn(math.degrees(scan.centre[0]), where[3])
        rates, there = _towards(goal, where)
        return _next(scan, "settle", there or late), Asked(_SQUARELY, rates)
    if scan.stage == "settle":
        if not late:
            return scan, Asked(_SQUARELY)
        try:
            targets = tuple(scan_targets(view, where, scan.centre))
        except ParameterError:
            targets = ()
        if not targets or max(math.hypot(*target) for target in targets) > _REACH:
            return _next(scan, "back", True), Asked(_SQUARELY)
        scan = _next(replace(scan, targets=targets), "turn", True)
        return scan, Asked(targets[0], wishes=(_begin(scan),))
    if scan.stage == "turn":
        there = scan.waited > _DWELL and math.dist(where[:2], scan.targets[0]) < _AIMED
        return _next(scan, "points", there or late), Asked(scan.targets[0])
    if scan.stage == "points":
        return _points(scan, where)
    near = _HOME if scan.waited < _HOMING else _NEARLY_HOME
    rates, there = _towards(scan.home[2:], where, near)
    return _next(scan, "done", there or late), Asked(scan.home[:2], rates)


def _points(scan: Scan, where: Where) -> tuple[Scan, Asked]:
    """Fire where the head has come to rest, and stay until the echoes are there."""
    target = scan.targets[scan.point]
    if not scan.fired:
        aimed = math.dist(where[:2], target) < _AIMED
        if scan.waited < (_DWELL if aimed else _MOST_DWELL):
            return scan, Asked(target)
        fire: Wish = ("shoot", list(target))
        return replace(scan, fired=True, heard=False, waited=0.0), Asked(target, wishes=(fire,))
    if not scan.heard and scan.waited < _MOST_UNHEARD:
        return scan, Asked(target)
    scan = replace(scan, point=scan.point + 1, fired=False, waited=0.0)
    if scan.point == len(scan.targets):
        return _next(scan, "back", True), Asked(target, wishes=(("heard", []),))
    return scan, Asked(target)


def _begin(scan: Scan) -> Wish:
    return "sound", [float(scan.number), *scan.centre, scan.diameter]


def _next(scan: Scan, stage: Stage, yes: bool) -> Scan:
    return replace(scan, stage=stage, waited=0.0) if yes else scan


def _nearest_turn(phi: float, roll: float) -> float:
    """The roll at which phi is ahead of the probe, on the shorter way."""
    return roll + math.degrees(float(wrapped(math.radians(phi - roll))))


def _towards(goal: Pair, where: Where, near: Pair = _NEAR) -> tuple[Pair, bool]:
    """Rates towards advance and roll, and whether they are reached."""
    off = goal[0] - where[2], goal[1] - where[3]
    if all(abs(o) < enough for o, enough in zip(off, near, strict=True)):
        return (0.0, 0.0), True
    advance, roll = (
        min(max(_GAIN * o, -most), most) for o, most in zip(off, _FASTEST, strict=True)
    )
    return (advance, roll), False
