"""A scan of a finding from the console: the procedure, and its commands to the camera process.

SCAN is a mode: leaving it ends the scan. The camera process has the probe; it fires the bursts and
keeps the echoes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from minorloop_head.console.camera_protocol import CameraCommand
from minorloop_head.console.messages import Pair
from minorloop_head.console.plant import reading_at
from minorloop_head.console.units import Position, pair_of
from minorloop_head.control.head import HeadControl
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.scan import RasterScan, ScanState


@dataclass(frozen=True, kw_only=True)
class ConsoleScan:
    """A scan in progress.

    Parameters
    ----------
    number : int
        Of the finding.
    diameter : float
        In metres.
    state : ScanState
    waited : float
        Seconds since it began.
    fired : bool
        Whether the probe has fired at the present point.
    """

    number: int
    diameter: float
    state: ScanState
    waited: float = 0.0
    fired: bool = False

    @property
    def stage(self) -> str:
        """Of the procedure, or ``done``."""
        return "done" if self.state.done else self.state.stage


@dataclass(frozen=True)
class ScanRequest:
    """Request of a tick of a scan: angles in rad, rates in m/s and rad/s, camera commands."""

    angles: Pair
    rates: Pair = (0.0, 0.0)
    commands: tuple[CameraCommand, ...] = ()


def begin_scan(
    number: int,
    centre: Pair,
    diameter: float,
    view: HeadCalibration,
    home: Position,
    control: HeadControl | None = None,
) -> ConsoleScan:
    """Return a scan about phi and z; in the end the head returns to ``home``.

    With the control of the head, a scan that is out of reach in the water is done at once.
    """
    back = reading_at(home)
    state = RasterScan(calibration=view).begin(
        centre, home=(back.place, back.angles), control=control
    )
    return ConsoleScan(number=number, diameter=diameter, state=state)


def scanned(
    scan: ConsoleScan, view: HeadCalibration, position: Position, command: Pair, interval: float
) -> tuple[ConsoleScan, ScanRequest]:
    """Return the scan after a tick and its request; ``command`` is the present one, in rad."""
    reading = reading_at(position, t=scan.waited, fired=scan.fired)
    state, request = RasterScan(calibration=view).step(scan.state, reading)
    commands: list[CameraCommand] = []
    if request.water:
        commands.append(("begin_scan", [float(scan.number), *state.centre, scan.diameter]))
    if request.shots:
        commands.append(("fire", [float(angle) for angle in state.targets[state.point]]))
    ended = state.stage == "back" != scan.state.stage
    if ended and len(state.targets):  # without any, the camera process has not begun
        commands.append(("finish_scan", []))
    angles = command if request.angles is None else pair_of(request.angles)
    after = replace(scan, state=state, waited=scan.waited + interval, fired=False)
    return after, ScanRequest(angles, pair_of(request.rates), tuple(commands))
