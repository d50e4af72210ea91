"""Messages to the pages with findings and introduction, in degrees and mm.

A number of a finding is never used twice, and every change is sent to the pages.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import msgspec

from minorloop.arrays import FloatArray
from minorloop_head.console import messages
from minorloop_head.console.camera_protocol import CameraCommand
from minorloop_head.console.messages import DepthPatch, Pair, ReportedFinding
from minorloop_head.console.modes import TeleopConfig
from minorloop_head.console.units import degrees, mm
from minorloop_head.geometry import wall_distance
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.pictures import CRACK
from minorloop_head.procedures.trace import SAME
from minorloop_head.reconstruction import findings as tables
from minorloop_head.reconstruction.findings import kind_of

NO_ECHOES = "no echoes yet"
"""Verdict before the scan of a finding."""


def camera_finding(
    number: int, t: float, hole: Mapping[str, float], radius: float
) -> ReportedFinding:
    """Return a finding by its outline alone."""
    found = tables.outlined(hole["phi"], hole["z"], hole["diameter"], NO_ECHOES, radius=radius)
    return _reported(number, t, found, round(hole["evidence"], 2))


def _swept_finding(number: int, t: float, found: Mapping[str, Any]) -> ReportedFinding:
    """Return a find of a sweep; ``found`` has the fields of a `tables.Finding`."""
    return _reported(number, t, tables.Finding(**found), None)


def _reported(
    number: int, t: float, found: tables.Finding, evidence: float | None
) -> ReportedFinding:
    return ReportedFinding(
        number=number,
        t=t,
        kind=found.kind,
        verdict=found.verdict,
        phi=round(math.degrees(found.phi) % 360.0, 3),
        phi_sd=degrees(found.phi_sd, 3),
        z=mm(found.z),
        z_sd=mm(found.z_sd),
        diameter=mm(found.width),
        diameter_sd=mm(found.width_sd),
        depth=None if math.isnan(found.depth) else mm(found.depth),
        depth_sd=None if math.isnan(found.depth_sd) else mm(found.depth_sd),
        evidence=evidence,
    )


def with_depth(
    finding: ReportedFinding, result: Mapping[str, Any], radius: float
) -> ReportedFinding:
    """Return the finding with the result of its echoes; other values do not change."""
    changed: dict[str, Any] = {"verdict": result["verdict"], "kind": kind_of(result["verdict"])}
    if result.get("diameter") is not None:
        changed |= {
            "phi": round(math.degrees(result["phi"]) % 360.0, 4),
            "phi_sd": degrees(result["place_sd"] / radius),
            "z": mm(result["z"]),
            "z_sd": mm(result["place_sd"]),
            "diameter": mm(result["diameter"]),
            "diameter_sd": mm(result["diameter_sd"]),
        }
    for name in ("depth", "depth_sd"):
        value = result.get(name)
        changed[name] = None if value is None else mm(value)
    patch = result.get("patch")
    changed["patch"] = None if patch is None else msgspec.convert(patch, DepthPatch)
    return msgspec.structs.replace(finding, **changed)


def table_of(rows: Sequence[ReportedFinding]) -> str:
    """Return findings as CSV, under the numbers that the pages show."""
    header, *lines = tables.finding_table([in_si(row) for row in rows]).splitlines()
    numbered = (
        f"{row.number},{line.split(',', 1)[1]}" for row, line in zip(rows, lines, strict=True)
    )
    return "\n".join([header, *numbered, ""])


def in_si(row: ReportedFinding) -> tables.Finding:
    """Return a finding in radians and metres; its width and length are the diameter."""

    def m(value: float | None) -> float:
        return math.nan if value is None else 1e-3 * value

    size = m(row.diameter), m(row.diameter_sd)
    return tables.Finding(
        row.kind, row.verdict, math.radians(row.phi), math.radians(row.phi_sd), m(row.z),
        m(row.z_sd), *size, *size, m(row.depth), m(row.depth_sd),
    )  # fmt: skip


def introduction(
    interval: float,
    view: HeadCalibration,
    config: TeleopConfig,
    wires: Iterable[Any],
    no_probe: str = "",
) -> bytes:
    """Return the message with camera, cone, planes of the wires, and the reason of no probe."""
    lens = view.lens
    return messages.encode(
        messages.Hello(
            interval=interval,
            view=messages.CameraView(
                width=lens.width,
                height=lens.height,
                focal=lens.focal,
                centre=lens.centre,
                lever=view.lever,
                radius=view.radius,
            ),
            known=view.to_dict(),
            cone=degrees(config.gaze.cone),
            stick=(mm(config.stick.advance), degrees(config.stick.roll)),
            planes=[
                messages.PlaneWeights(levels=wire.levels.tolist(), weights=_rows(wire.weights))
                for wire in wires
            ],
            no_probe=no_probe,
        )
    )


def pair(values: Iterable[float], digits: int = 3) -> Pair:
    """Return two numbers, rounded for a message; NaN becomes null there."""
    first, second = values
    return round(float(first), digits), round(float(second), digits)


def _rows(rows: FloatArray) -> list[list[float]]:
    return [[round(float(x), 4) for x in row[: k + 1]] for k, row in enumerate(rows)]


class NumberedFindings:
    """All findings.

    ``radius``: of the pipe, in metres.
    """

    def __init__(self, radius: float, out: Outgoing) -> None:
        self._radius, self._out = radius, out
        self.all: list[ReportedFinding] = []
        self._last_number = 0

    def extracted(self, hole: Any, t: float) -> None:
        """Add a hole that the camera has measured at a time in seconds."""
        self._add(camera_finding, t, hole, self._radius)
        self.send()

    def swept(self, finds: Any, t: float) -> None:
        """Add the finds of a sweep at a time in seconds, except known findings."""
        for found in finds:
            if not any(self._same(found, known) for known in self.all):
                self._add(_swept_finding, t, found)
        self.send()

    def _same(self, found: Any, known: ReportedFinding) -> bool:
        """Return whether a find of a sweep may be a known finding: both or neither are cracks."""
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
        """Return a finding by its number, or the last one; a message if there is none."""
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
        self._last_number += 1  # never used again: a late fit must not change another finding
        self.all.append(reported(self._last_number, round(t, 2), *found))


class Outgoing:
    """Messages and commands, in their order.

    Its ``events``: encoded messages to the pages, as bytes; the sender removes them. Any thread may
    add some.
    Its ``commands``: of this tick.
    """

    def __init__(self) -> None:
        self.events: deque[bytes] = deque()
        self.commands: list[CameraCommand] = []

    def send(self, message: messages.ToPage) -> None:
        """Send a message to the pages."""
        self.events.append(messages.encode(message))

    def notice(self, text: str) -> None:
        """Send a sentence to the pages."""
        self.send(messages.Notice(text=text))

    def command(self, name: str, *numbers: float) -> None:
        """Send a command to the camera process."""
        self.commands.append((name, [float(number) for number in numbers]))
