"""The catheter head: two heated wires that turn a camera and an ultrasonic probe in a pipe.

Its public names are here, and are imported at their first use.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from minorloop_head.control.head import HeadControl, head_control
    from minorloop_head.control.heating import identify_heating, moving_levels, wire_holds
    from minorloop_head.control.limits import WireLimits
    from minorloop_head.heated_wire import HeatedWire
    from minorloop_head.inspection.heads import HeadAddress, drive_head, inspected_head, swept_head
    from minorloop_head.inspection.identification import identify_head
    from minorloop_head.inspection.inspect_pipe import inspect
    from minorloop_head.inspection.sweep_wall import sweep
    from minorloop_head.twins.sensor import SimulatedFault
    from minorloop_head.twins.surroundings import Course, Surroundings, convection
    from minorloop_head.ultrasound.recorded_scan import RecordedScan, read_scan
    from minorloop_head.ultrasound.scan_flaws import ScanFlaws, scan_flaws

__all__ = [
    "Course",
    "HeadAddress",
    "HeadControl",
    "HeatedWire",
    "RecordedScan",
    "ScanFlaws",
    "SimulatedFault",
    "Surroundings",
    "WireLimits",
    "convection",
    "drive_head",
    "head_control",
    "identify_head",
    "identify_heating",
    "inspect",
    "inspected_head",
    "moving_levels",
    "read_scan",
    "scan_flaws",
    "sweep",
    "swept_head",
    "wire_holds",
]

_MODULES = {
    "heated_wire": ("HeatedWire",),
    "inspection.heads": ("HeadAddress", "drive_head", "inspected_head", "swept_head"),
    "inspection.identification": ("identify_head",),
    "inspection.inspect_pipe": ("inspect",),
    "inspection.sweep_wall": ("sweep",),
    "control.head": ("HeadControl", "head_control"),
    "control.heating": ("identify_heating", "moving_levels", "wire_holds"),
    "control.limits": ("WireLimits",),
    "twins.sensor": ("SimulatedFault",),
    "twins.surroundings": ("Course", "Surroundings", "convection"),
    "ultrasound.recorded_scan": ("RecordedScan", "read_scan"),
    "ultrasound.scan_flaws": ("ScanFlaws", "scan_flaws"),
}
_MODULE = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name in _MODULE:
        return getattr(import_module(f"minorloop_head.{_MODULE[name]}"), name)
    raise AttributeError(f"module 'minorloop_head' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
