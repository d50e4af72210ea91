"""Scans and sweeps of the probe, one at a time, tick by tick of the console.

Their mode is SCAN. The camera process has the probe; it fires the bursts and keeps the echoes. At
the end the head returns to its former position. Leaving the mode ends a scan, and stops a sweep,
whose bursts until then are mapped; the head returns from it before another mode begins.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from minorloop.errors import ParameterError
from minorloop_head.console import messages
from minorloop_head.console.messages import Mode, Pair, ReportedFinding
from minorloop_head.console.plant import reading_at
from minorloop_head.console.reports import Outgoing, in_si
from minorloop_head.console.units import Position, pair_of
from minorloop_head.control.head import HeadControl
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.go import go
from minorloop_head.procedures.scan import RasterScan, ScannedRaster
from minorloop_head.procedures.sweep import ProbeSweep, SweptArea
from minorloop_head.procedures.values import NOTHING, Procedure, Request, Running

Probed: TypeAlias = ScannedRaster | SweptArea
AROUND, ALONG = math.radians(20.0), 1.5e-3
"""Largest distance around the pipe, in radians, and along it, in metres, from the place in the
middle of the picture to the edge of a sweep: twice a pit of 1.5 mm, in a minute of the head."""
FARTHEST = 40e-3
"""Distance in metres from head to place beyond which the picture looks along the pipe."""
_HOMING = 8.0
"""Longest seconds of the way back; friction may hold the catheter before the end of its travel."""
_LOOK_AT_THE_WALL = (
    "a sweep maps the wall in the middle of the picture; look at a place of it that is at least "
    f"{1e3 * ALONG:g} mm from the start of the catheter and at most {1e3 * FARTHEST:g} mm ahead"
)
_STOPPED = (
    "the sweep was stopped; its bursts are mapped; press Head or Track, and the head first goes "
    "back to where it was"
)


class _ScanTick(NamedTuple):
    """Requests of a tick: angles and rates, a hold with its reason, a mode to enter."""

    requested: tuple[Pair, Pair] | None = None
    hold: str = ""
    mode: Mode | None = None


@dataclass(eq=False)
class ProbeRun:
    """A running scan or sweep, with its way back."""

    number: int
    """Number of the finding; 0 for a sweep."""
    home: Position
    """Pan, tilt, advance and roll to which the head returns, in rad and m."""
    made: Probed
    """The state without bursts, which are in the camera process."""
    running: Running[None]
    waited: float = 0.0
    """Seconds since it began."""
    fired: bool = False
    """Whether the burst of this point was fired."""

    @property
    def stage(self) -> str:
        """Stage of the procedure, then ``back`` and ``done``."""
        return "done" if self.running.done else self.made.stage

    def advance(self, here: Position, interval: float) -> Request:
        """Return the request of a tick of some seconds, at a position."""
        now = reading_at(here, t=self.waited, fired=self.fired)
        self.waited, self.fired = self.waited + interval, False
        return self.running.advance(now)


class Scanning:
    """The running scan or sweep, and a stopped sweep whose head has still to return.

    Its ``scan``: the running scan or sweep. ``interval``: of a tick, in seconds.
    """

    def __init__(
        self, view: HeadCalibration, control: HeadControl, interval: float, out: Outgoing
    ) -> None:
        self._view, self._control, self._interval, self._out = view, control, interval, out
        self.scan: ProbeRun | None = None
        self._left: ProbeRun | None = None  # was cut, and the head has still to go back
        self._after: Mode | None = None  # is entered when it is back

    def begin_scan(self, found: ReportedFinding, command: Pair, here: Position) -> bool:
        """Begin a scan about a finding, and return whether it was begun."""
        scan, hole = RasterScan(calibration=self._view), in_si(found)
        if refused := scan.out_of_reach(self._control):
            self._out.notice(f"finding {found.number} is {refused}")
            return False
        centre, made = (hole.phi, hole.z), ScannedRaster(done=False)

        def carry_out(request: Request) -> None:
            if request.water:
                self._out.command("begin_scan", found.number, *centre, hole.width)
            if request.water is False:
                self._out.command("end_scan")
            if request.shots and request.angles is not None:
                self._out.command("fire", *request.angles)

        def ended() -> None:
            if len(made.targets):  # without any, the camera process has not begun
                self._out.command("finish_scan")

        # The head returns to where it was commanded, the catheter to where it was measured.
        home = *command, *here[2:]
        procedure = _with_return(scan.scan(made, centre), made, home, ended)
        running = Running(procedure, carry_out, Request(water=False))
        self.scan = ProbeRun(found.number, home, made, running)
        return True

    def begin_sweep(self, command: Pair, here: Position) -> bool:
        """Begin a sweep about the middle of the picture, and return whether it was begun."""
        if self.scan is not None and not self.scan.number:
            self._out.notice("a sweep is on already; press Hold to stop it")
            return False
        sweep = ProbeSweep(calibration=self._view, tick=self._interval)
        camera = self._view.camera_at(here[2:])
        phi, z = np.asarray(camera.place(self._view.lens.centre, *here[:2])).tolist()
        if not ALONG <= z <= here[2] + FARTHEST:  # or it is not known
            self._out.notice(_LOOK_AT_THE_WALL)
            return False
        try:
            made = sweep.area((phi - AROUND, phi + AROUND), (z - ALONG, z + ALONG))
        except ParameterError as error:
            self._out.notice(str(error))
            return False
        if refused := sweep.point.out_of_reach(self._control):
            self._out.notice(f"the sweep is {refused}")
            return False

        def carry_out(request: Request) -> None:
            if request.water:
                self._out.command("begin_sweep", *made.phi, *made.z)
            if request.water is False:
                self._out.command("end_sweep", 0.0)
            if request.shots:
                self._out.command("fire_on")

        def ended() -> None:
            self._out.command("end_sweep", not made.trouble)

        home = (*command, *here[2:]) if self._left is None else self._left.home
        procedure = _with_return(sweep.sweep(made), made, home, ended)
        running = Running(procedure, carry_out, Request(water=False))
        self.scan, self._left, self._after = ProbeRun(0, home, made, running), None, None
        return True

    def fired(self) -> None:
        """Note that the burst of a scan was fired."""
        if self.scan is not None:
            self.scan.fired = True

    def back_first(self, request: Mode | None) -> Mode | None:
        """Return the mode to enter for a request: first the way back from a stopped sweep."""
        sweep = self._left if self.scan is None else self.scan
        if sweep is None or sweep.number or request not in ("HEAD", "TRACK"):
            return request
        if sweep is self._left or sweep.stage != "back":
            sweep.running.close()
            sweep.made.stage = "back"
            sweep.running = Running(_back(sweep.home), lambda request: None)
        self.scan, self._left, self._after = sweep, None, request
        return "SCAN"

    def tick(self, mode: Mode, command: Pair, here: Position) -> _ScanTick:
        """Return the request of scan or sweep, which advance only in their mode."""
        scan = self.scan
        if scan is None or scan.stage == "done":
            return _ScanTick()
        if mode != "SCAN":
            return _ScanTick((command, (0.0, 0.0)))
        request = scan.advance(here, self._interval)
        if scan.stage != "done":
            angles = command if request.angles is None else pair_of(request.angles)
            return _ScanTick((angles, pair_of(request.rates)))
        if isinstance(scan.made, ScannedRaster):
            self._out.send(messages.ScanEnded(finding=scan.number))
            if len(scan.made.targets):
                return _ScanTick(hold="the scan is done; press a mode to continue")
            return _ScanTick(
                hold="the probe could not be brought over the finding; press Depth again"
            )
        if self._after is not None:
            after, self._after = self._after, None
            return _ScanTick(mode=after)
        trouble = scan.made.trouble
        how = f"has ended early: {trouble}; its bursts are mapped" if trouble else "is done"
        return _ScanTick(hold=f"the sweep {how}, and the head is back; press a mode to continue")

    def leave(self) -> None:
        """End a scan or sweep whose mode has ended."""
        scan, self.scan = self.scan, None
        if scan is None or scan.running.done:
            return
        scan.running.close()
        if scan.number:
            self._out.notice("the scan was stopped; press Depth to start it again")
        elif scan.made.stage == "back":
            self._out.notice("the head was stopped on its way back from the sweep")
        else:
            self._left = scan
            self._out.notice(_STOPPED)

    def progress(self) -> messages.ScanProgress | None:
        """Return the progress for the pages."""
        if self.scan is None:
            return None
        return messages.ScanProgress(
            finding=self.scan.number,
            stage=self.scan.stage,
            progress=round(self.scan.made.progress, 3),
        )


def _with_return(
    procedure: Procedure[Probed], made: Probed, home: Position, ended: Callable[[], None]
) -> Procedure[None]:
    """Carry out a scan or a sweep, report its end, and bring the head back."""
    yield from procedure
    made.stage = "back"
    ended()
    yield NOTHING
    yield from _back(home)


def _back(home: Position) -> Procedure[None]:
    yield from go(home[2:], home[:2], patience=_HOMING)
