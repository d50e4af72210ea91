"""The catheter head: two heated wires that turn a camera and an ultrasonic probe in a pipe.

Its public names are here, and are imported when they are first asked for. The core of the
package imports nothing from it; ``pip install 'minorloop[head]'`` has what it needs besides.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from minorloop.dynamics.heated_wire import HeatedWire
    from minorloop.head.control.head import HeadControl, head_control
    from minorloop.head.control.heating import identify_heating, moving_levels, wire_holds
    from minorloop.head.control.limits import WireLimits
    from minorloop.head.control.planning import Planner
    from minorloop.head.twins.sensor import Fault
    from minorloop.head.twins.surroundings import Course, Surroundings, convection

__all__ = [
    "Course",
    "Fault",
    "HeadControl",
    "HeatedWire",
    "Planner",
    "Surroundings",
    "WireLimits",
    "convection",
    "head_control",
    "identify_heating",
    "moving_levels",
    "wire_holds",
]

_MODULES = {
    "dynamics.heated_wire": ("HeatedWire",),
    "head.control.head": ("HeadControl", "head_control"),
    "head.control.heating": ("identify_heating", "moving_levels", "wire_holds"),
    "head.control.limits": ("WireLimits",),
    "head.control.planning": ("Planner",),
    "head.twins.sensor": ("Fault",),
    "head.twins.surroundings": ("Course", "Surroundings", "convection"),
}
_MODULE = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name in _MODULE:
        return getattr(import_module(f"minorloop.{_MODULE[name]}"), name)
    raise AttributeError(f"module 'minorloop.head' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
