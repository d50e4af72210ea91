"""A scan of a finding from the console: the procedure in degrees and mm, and wishes to the eyes.

It moves nothing by itself: SCAN is a mode, and what ends the mode ends the scan. The eyes fire the
bursts and keep the echoes, since they have the probe.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from minorloop.head.console.camera_protocol import Wish
from minorloop.head.console.head_pose import Pair
from minorloop.head.console.plant import PlantView, Where, reading_of
from minorloop.head.procedures.scan import RasterScan, ScanState


@dataclass(frozen=True, kw_only=True)
class ConsoleScan:
    """A scan that is going on.

    Parameters
    ----------
    number : int
        Of the finding.
    diameter : float
        In metres.
    state : ScanState
    waited : float
        Seconds since it began.
    heard : bool
        Whether the probe has fired at this point.
    """

    number: int
    diameter: float
    state: ScanState
    waited: float = 0.0
    heard: bool = False

    @property
    def stage(self) -> str:
        """Of the procedure, or ``done``."""
        return "done" if self.state.done else self.state.stage

    @property
    def progress(self) -> float:
        """Share of the points that have been heard."""
        return self.state.progress


@dataclass(frozen=True)
class ScanRequest:
    """What a tick of a scan asks for: angles in degrees, rates in mm/s and degrees/s, wishes."""

    angles: Pair
    rates: Pair = (0.0, 0.0)
    wishes: tuple[Wish, ...] = field(default=())


def begin_scan(
    number: int, centre: tuple[float, float], diameter: float, view: PlantView, home: Where
) -> ConsoleScan:
    """A scan about a finding at phi in radians and z in metres, from which the head goes home."""
    back = reading_of(home)
    state = RasterScan(calibration=view).begin(centre, home=(back.place, back.angles))
    return ConsoleScan(number=number, diameter=diameter, state=state)


def scanned(
    scan: ConsoleScan, view: PlantView, where: Where, command: Pair, interval: float
) -> tuple[ConsoleScan, ScanRequest]:
    """The scan after a tick with the head commanded to angles in degrees, and what it asks for."""
    reading = reading_of(where, t=scan.waited, fired=scan.heard)
    state, request = RasterScan(calibration=view).step(scan.state, reading)
    wishes: list[Wish] = []
    if request.water:
        wishes.append(("sound", [float(scan.number), *state.centre, scan.diameter]))
    if request.shots:
        wishes.append(("shoot", np.degrees(state.targets[state.point]).tolist()))
    if scan.state.stage == "points" and state.stage == "back":
        wishes.append(("heard", []))
    angles = command if request.angles is None else _pair(np.degrees(request.angles).tolist())
    rates = 1e3 * float(request.rates[0]), math.degrees(float(request.rates[1]))
    after = replace(scan, state=state, waited=scan.waited + interval, heard=False)
    return after, ScanRequest(angles, rates, tuple(wishes))


def _pair(values: list[float]) -> Pair:
    return values[0], values[1]
