"""The probe in an inspection: it scans each finding, and is rolled once round the pipe at the end.

Each result is kept at once, so that an interrupted inspection continues from there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from minorloop_head.procedures.inspected_view import AGAIN, InspectedView, first_visit, with_finding
from minorloop_head.procedures.probe_steps import (
    Scan,
    drain,
    reach_words,
    scan,
    scanned_crack,
    scanned_pit,
)
from minorloop_head.procedures.rig import InspectionRig
from minorloop_head.procedures.ring import Ring, ring_scan, ring_sweep
from minorloop_head.procedures.scan import ScannedRaster
from minorloop_head.procedures.steps import REFUSED, approach, go, meter, touch
from minorloop_head.procedures.values import LogEntry, Request
from minorloop_head.ultrasound.crack_depth import CrackDepth
from minorloop_head.ultrasound.pits import PitDepth
from minorloop_head.vision.defects import Hole


@dataclass(eq=False, kw_only=True)
class Kept:
    """Results of an inspection so far, from which an interrupted inspection continues."""

    views: dict[str, InspectedView] = field(default_factory=dict)
    """Views by the names of their pictures, in the order in which they were taken."""
    scans: dict[str, ScannedRaster] = field(default_factory=dict)
    """Scans by the name of the finding; a second scan has ``again`` after it."""
    ring: Ring | None = None
    """The pipe once round."""

    def view(self, name: str, take: Callable[[], InspectedView]) -> InspectedView:
        """Return the kept view of a name; take and keep it if there is none."""
        if name not in self.views:
            self.add_view(take())
        return self.views[name]

    def add_view(self, view: InspectedView) -> None:
        """Keep a view; it replaces an older view of the same name."""
        self.views[view.picture.name] = view

    def add_scan(self, name: str, scanned: ScannedRaster) -> None:
        """Keep a scan so far."""
        self.scans[name] = scanned

    def add_ring(self, ring: Ring) -> None:
        """Keep the sweep round the pipe."""
        self.ring = ring

    def scan_of(self, view: InspectedView) -> ScannedRaster | None:
        """Return the scan that gave the depth of the finding of a view; None if there is no scan.

        It is the second scan if that gave a depth.
        """
        name, probed = first_visit(view.picture.name), view.probed
        first = self.scans.get(name)
        measured = isinstance(probed, PitDepth) and probed.measured
        return self.scans.get(f"{name}{AGAIN}", first) if measured else first


@dataclass(eq=False)
class Probing:
    """The probe of an inspection."""

    rig: InspectionRig
    """With a micro-tool, it touches a hole or a pit before it is scanned."""
    kept: Kept
    """Stores each result; a finding that has a scan there is not scanned again."""
    refused: str = ""
    """Reason why nothing is scanned, such as ``no water``; empty if findings are scanned. `begin`
    sets it if the probe does not reach the wall in the water."""

    def begin(self) -> None:
        """Drain the pipe for the camera, and say whether the probe reaches the wall in water."""
        drain(self.rig)
        if not self.refused:
            said, within = reach_words(self.rig)
            self.refused = "" if within else said
            self.rig.say("reach", said, succeeded=within)

    def scanned(self, view: InspectedView) -> InspectedView:
        """Touch and scan the finding of a view, and return the view with the depth by its echoes.

        Raises an `InstrumentError` if a device fails or a sensor is lost.
        """
        rig, (shown,), name = self.rig, view.seen, first_visit(view.picture.name)
        visit = _Visit(rig)
        if isinstance(shown, Hole) and rig.has_tool and name not in self.kept.scans:
            approach(rig, shown.place)
            touch(rig, shown)
        probed: PitDepth | CrackDepth
        if self.refused:
            step = "reach" if self.refused.startswith(REFUSED) else "scan"
            rig.say(step, self.refused, succeeded=False)
            probed = CrackDepth(self.refused)
            if isinstance(shown, Hole):
                probed = PitDepth(self.refused, *shown.place.tolist())
        elif isinstance(shown, Hole):
            probed, _ = scanned_pit(rig, shown, self._resumable_scan(name, visit))
        else:
            probed, _ = scanned_crack(rig, shown, self._resumable_scan(name, visit))
        drain(rig)
        rig.check_sensors()
        steps = (*view.steps, *visit.steps())
        return with_finding(replace(view, steps=steps, probed=probed), rig.calibration.radius)

    def roll_round(self, z: float) -> None:
        """Sweep once round the flooded pipe at a place along it in metres, unless it is done.

        Its one point is within reach in colder water than a raster.
        """
        rig, dry = self.rig, self.refused and not self.refused.startswith(REFUSED)
        if self.kept.ring is not None or dry:
            return
        sweep = ring_scan(rig)
        if refused := sweep.out_of_reach(rig.control):
            rig.say("water line", refused, succeeded=False)
            return
        go(rig, place=np.array([z, 0.0]))
        go(rig, angles=sweep.perpendicular)
        meter(rig)
        rig.reading(Request(water=True))
        ring = ring_sweep(rig)
        drain(rig)
        self.kept.add_ring(ring)

    def _resumable_scan(self, name: str, visit: _Visit) -> Scan:
        """Return a scan of a finding that continues from its kept part."""

        def scanned(rig: InspectionRig, place: tuple[float, float], shift: float) -> ScannedRaster:
            called = f"{name}{AGAIN}" if shift else name
            start = len(visit.steps()) if shift else 0

            def keep(found: ScannedRaster) -> None:
                self.kept.add_scan(called, replace(found, steps=visit.steps()[start:]))

            part = self.kept.scans.get(called)
            if part is not None:
                visit.add(part.steps)
            if part is None or not part.done:
                keep(scan(rig, place, shift, before=part, told=keep))
            return self.kept.scans[called]

        return scanned


class _Visit:
    """Steps of a visit: new entries of the log, and kept steps of an earlier visit."""

    def __init__(self, rig: InspectionRig) -> None:
        self._rig, self._taken, self._mark = rig, list[LogEntry](), len(rig.log)

    def steps(self) -> tuple[LogEntry, ...]:
        """Return them in their order."""
        self.add(())
        return tuple(self._taken)

    def add(self, kept: tuple[LogEntry, ...]) -> None:
        """Add kept steps after the entries of the log until now."""
        self._taken += [*self._rig.log[self._mark :], *kept]
        self._mark = len(self._rig.log)
