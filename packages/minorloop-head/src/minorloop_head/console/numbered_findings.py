"""The findings of the console: a number is never used twice, and every change goes to the pages."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from minorloop_head.console import messages
from minorloop_head.console.messages import ReportedFinding
from minorloop_head.console.outgoing import Outgoing
from minorloop_head.console.reports import camera_finding, swept_finding, with_depth
from minorloop_head.geometry import wall_distance
from minorloop_head.procedures.extract import SAME
from minorloop_head.procedures.pictures import CRACK


class NumberedFindings:
    """All findings.

    Parameters
    ----------
    radius : float
        Of the pipe, in metres.
    out : Outgoing
    """

    def __init__(self, radius: float, out: Outgoing) -> None:
        self._radius, self._out = radius, out
        self.all: list[ReportedFinding] = []
        self._last_number = 0

    def extracted(self, hole: Any, t: float) -> None:
        """Add what the camera has measured at a time in seconds."""
        self._add(camera_finding, t, hole, self._radius)
        self.send()

    def swept(self, finds: Any, t: float) -> None:
        """Add what a sweep has found, known at a time in seconds, but for what is known before."""
        for found in finds:
            if not any(self._same(found, known) for known in self.all):
                self._add(swept_finding, t, found)
        self.send()

    def _same(self, found: Any, known: ReportedFinding) -> bool:
        """Return whether a find of a sweep is a known finding: both are cracks, or none is."""
        places = (found["phi"], found["z"]), (math.radians(known.phi), 1e-3 * known.z)
        near = float(wall_distance(*places, self._radius)) < SAME
        return near and (found["kind"] == CRACK) == (known.kind == CRACK)

    def add_depth(self, message: messages.DepthFitted) -> None:
        """Add the result of the echoes to its finding."""
        for k, finding in enumerate(self.all):
            if finding.number == message.finding:
                self.all[k] = with_depth(finding, message.result, self._radius)
        self.send()

    def restore(self, findings: list[ReportedFinding]) -> None:
        """Take over the findings of a loop that has ended."""
        if self._last_number == 0:
            self.all = list(findings)
            self._last_number = max((each.number for each in self.all), default=0)

    def forget(self, number: int) -> None:
        """Delete a finding."""
        self.all = [f for f in self.all if f.number != number]
        self.send()

    def wanted(self, number: int | None) -> ReportedFinding | str:
        """Return a finding by its number, the last one without; a sentence if it is not there."""
        wanted = [f for f in self.all if number is None or f.number == number]
        if wanted:
            return wanted[-1]
        if number is None or not self.all:
            return "there is nothing to scan; measure a finding first"
        known = ", ".join(str(f.number) for f in self.all)
        return f"there is no finding {number}; there is {known}"

    def send(self) -> None:
        """Send all findings to the pages."""
        self._out.send(messages.FindingList(findings=self.all))

    def _add(self, reported: Callable[..., ReportedFinding], t: float, *found: Any) -> None:
        self._last_number += 1  # never used again: a late fit must not meet another finding
        self.all.append(reported(self._last_number, round(t, 2), *found))
