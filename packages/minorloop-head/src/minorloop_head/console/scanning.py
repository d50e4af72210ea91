"""Scans and sweeps of the probe, one at a time: what a tick of the console does for them.

SCAN is their mode. A sweep that is left is cut, and the head goes back from it before another mode
begins.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from minorloop.errors import ParameterError
from minorloop_head.console import messages
from minorloop_head.console.messages import Mode, Pair, ReportedFinding
from minorloop_head.console.outgoing import Outgoing
from minorloop_head.console.reports import in_si
from minorloop_head.console.scan import ConsoleScan, begin_scan, scanned
from minorloop_head.console.sweep import (
    LOOK_AT_THE_WALL,
    STOPPED,
    ConsoleSweep,
    begin_sweep,
    cut,
    swept,
)
from minorloop_head.console.units import Position
from minorloop_head.control.head import HeadControl
from minorloop_head.procedures.calibration import HeadCalibration


class ScanTick(NamedTuple):
    """What a tick requests: angles and rates, a hold with its reason, a mode to enter."""

    requested: tuple[Pair, Pair] | None = None
    hold: str = ""
    mode: Mode | None = None


class Scanning:
    """The scan or sweep that is on, and one whose head has still to go back.

    Parameters
    ----------
    view : HeadCalibration
    control : HeadControl
    interval : float
        Of a tick, in seconds.
    out : Outgoing

    Attributes
    ----------
    scan : ConsoleScan, ConsoleSweep or None
        That is on.
    """

    def __init__(
        self, view: HeadCalibration, control: HeadControl, interval: float, out: Outgoing
    ) -> None:
        self._view, self._control, self._interval, self._out = view, control, interval, out
        self.scan: ConsoleScan | ConsoleSweep | None = None
        self._left: ConsoleSweep | None = None  # was cut, and the head has still to go back
        self._after: Mode | None = None  # is entered when it is back

    def begin_scan(self, found: ReportedFinding, command: Pair, here: Position) -> bool:
        """Begin a scan about a finding, and return whether it was begun."""
        # The head returns to where it was commanded, the catheter to where it was measured.
        home = *command, *here[2:]
        hole = in_si(found)
        place = hole.phi, hole.z
        scan = begin_scan(found.number, place, hole.width, self._view, home, self._control)
        if scan.state.refused:
            self._out.notice(f"finding {found.number} is {scan.state.refused}")
            return False
        self.scan = scan
        return True

    def begin_sweep(self, command: Pair, here: Position) -> bool:
        """Begin a sweep about what is looked at, and return whether it was begun."""
        if isinstance(self.scan, ConsoleSweep):
            self._out.notice("a sweep is on already; press Hold to stop it")
            return False
        home = (*command, *here[2:]) if self._left is None else self._left.home
        try:
            sweep = begin_sweep(self._view, here, home, self._control)
        except ParameterError as error:
            self._out.notice(str(error))
            return False
        if sweep is None:
            self._out.notice(LOOK_AT_THE_WALL)
        elif sweep.state.refused:
            self._out.notice(f"the sweep is {sweep.state.refused}")
        else:
            self.scan, self._left, self._after = sweep, None, None
            return True
        return False

    def fired(self) -> None:
        """Take notice that the burst of a scan was fired."""
        if isinstance(self.scan, ConsoleScan):
            self.scan = replace(self.scan, fired=True)

    def back_first(self, request: Mode | None) -> Mode | None:
        """Return the mode to enter for a request: first the way back from a sweep, which is cut."""
        sweep = self.scan if isinstance(self.scan, ConsoleSweep) else self._left
        if sweep is None or request not in ("HEAD", "TRACK"):
            return request
        self.scan, self._left, self._after = cut(sweep), None, request
        return "SCAN"

    def tick(self, mode: Mode, command: Pair, here: Position) -> ScanTick:
        """Return what scan or sweep requests; they advance only in their mode."""
        if self.scan is None or self.scan.stage == "done":
            return ScanTick()
        if mode != "SCAN":
            return ScanTick((command, (0.0, 0.0)))
        if isinstance(self.scan, ConsoleSweep):
            return self._swept(self.scan, command, here)
        self.scan, requested = scanned(self.scan, self._view, here, command, self._interval)
        self._out.commands += requested.commands
        if self.scan.stage != "done":
            return ScanTick((requested.angles, requested.rates))
        self._out.send(messages.ScanEnded(finding=self.scan.number))
        if len(self.scan.state.targets):
            return ScanTick(hold="the scan is done; press a mode to continue")
        return ScanTick(hold="the probe could not be brought over the finding; press Depth again")

    def _swept(self, sweep: ConsoleSweep, command: Pair, here: Position) -> ScanTick:
        sweep, requested = swept(sweep, self._view, here, command, self._interval)
        self.scan = sweep
        self._out.commands += requested.commands
        if sweep.stage != "done":
            return ScanTick((requested.angles, requested.rates))
        if self._after is not None:
            mode, self._after = self._after, None
            return ScanTick(mode=mode)
        trouble = sweep.state.trouble
        how = f"has ended early: {trouble}; what was fired is mapped" if trouble else "is done"
        return ScanTick(hold=f"the sweep {how}, and the head is back; press a mode to continue")

    def leave(self) -> None:
        """End a scan or sweep whose mode has ended."""
        scan, self.scan = self.scan, None
        if isinstance(scan, ConsoleScan):
            if scan.stage != "done":
                self._out.notice("the scan was stopped; press Depth to start it again")
            self._out.command("end_scan")
        elif scan is not None and scan.back is None:
            self._left = scan
            self._out.commands.append(scan.ending)
            if not scan.state.done:
                self._out.notice(STOPPED)
        elif scan is not None and scan.stage != "done":
            self._out.notice("the head was stopped on its way back from the sweep")

    def progress(self) -> messages.ScanProgress | None:
        """Return the progress for the pages."""
        if self.scan is None:
            return None
        return messages.ScanProgress(
            finding=self.scan.number,
            stage=self.scan.stage,
            progress=round(self.scan.state.progress, 3),
        )
