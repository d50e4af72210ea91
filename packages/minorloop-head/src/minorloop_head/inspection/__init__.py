"""Unattended work of a head: its identification, drives, inspections and sweeps of a pipe.

Inspections and sweeps resume from any line of their journal, an identification from its last hold.

::

    identify_head(HeadAddress("bench:head.toml"), "runs", "head.json")
    head = inspected_head("bench:head.toml", "camera:0", "head.json")
    found = inspect(head, "inspected", (0.0, 5e-3))
    found.findings, found.seen, found.report
"""

from minorloop_head.inspection.heads import (
    HeadAddress,
    InspectedHead,
    Water,
    drive_head,
    inspected_head,
    opened_head,
    swept_head,
)
from minorloop_head.inspection.identification import identify_head
from minorloop_head.inspection.inspect_pictures import inspect_pictures, inspect_plates
from minorloop_head.inspection.inspect_pipe import Inspection, inspect
from minorloop_head.inspection.sweep_wall import SweptWall, sweep

__all__ = [
    "HeadAddress",
    "InspectedHead",
    "Inspection",
    "SweptWall",
    "Water",
    "drive_head",
    "identify_head",
    "inspect",
    "inspect_pictures",
    "inspect_plates",
    "inspected_head",
    "opened_head",
    "sweep",
    "swept_head",
]
