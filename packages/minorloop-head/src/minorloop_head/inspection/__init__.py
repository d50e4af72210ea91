"""Unattended inspections and sweeps of a pipe, which resume from any line of their journal.

::

    head = inspected_head("bench:head.toml", "camera:0", "head.json")
    found = inspect(head, "inspected", (0.0, 5e-3))
    found.findings, found.seen, found.report
"""

from minorloop_head.inspection.heads import InspectedHead, Water, inspected_head, swept_head
from minorloop_head.inspection.inspect_pictures import inspect_pictures
from minorloop_head.inspection.inspect_pipe import Inspection, inspect
from minorloop_head.inspection.sweep_wall import SweptWall, sweep

__all__ = [
    "InspectedHead",
    "Inspection",
    "SweptWall",
    "Water",
    "inspect",
    "inspect_pictures",
    "inspected_head",
    "sweep",
    "swept_head",
]
