"""Identification of the head that the console steers."""

from __future__ import annotations

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError
from minorloop.identification import excitation
from minorloop.lab.actuator import Actuator
from minorloop_head.console.settings import PIPE, is_pipe
from minorloop_head.control.head import HeadControl, head_control
from minorloop_head.control.heating import identify_coupling, identify_heating, moving_levels
from minorloop_head.heated_wire import HeatedWire
from minorloop_head.procedures.identify import HeadExcitation

_HOW = HeadExcitation()


def head_of(address: str, specimen: int | None) -> HeadControl:
    """Identify the head at an address, one axis after the other, and return its control.

    Each axis is measured by a loop, reversal curves and a step. This takes some hours with a real
    head and a second with a simulated one.

    Raises a `ParameterError` if nothing can be steered at the address.
    """
    if not is_pipe(address):
        raise ParameterError(
            f"there is nothing to steer at {address!r} without the file of the head, which "
            f"minorloop head identify writes; {PIPE} needs none"
        )
    from minorloop_head.twins.head import Head

    head = Head(specimen, 0.05, 1)
    wires, moves = zip(*(_identified(head, axis) for axis in (0, 1)), strict=True)
    return head_control("observer", wires, coupling=identify_coupling(moves))


def _identified(head: Actuator, axis: int) -> tuple[HeatedWire, FloatArray]:
    loop = _HOW.highest * np.concatenate([np.linspace(0, 1, 17), np.linspace(1, 0, 17)[1:]])
    angles = _settled(head, axis, loop)
    levels = moving_levels(loop, angles[axis], _HOW.bands)
    _settled(head, axis, np.zeros(1))
    holds = excitation.reversal_curves(levels)
    steady = _settled(head, axis, holds)
    _settled(head, axis, np.zeros(1))
    t = np.arange(0.0, 40.0, 0.08)
    current = np.where((t >= 0.16) & (t < 25.0), _HOW.highest, 0.0)
    y = [0.0, *(float(_moved(head, axis, u, 0.08)[axis]) for u in current[:-1])]
    found = identify_heating(holds, steady[axis], step=(t, current, np.array(y)), levels=levels)
    return found.model, angles


def _settled(head: Actuator, axis: int, currents: FloatArray) -> FloatArray:
    """Return (2, T) angles after each hold of the current of one axis."""
    return np.array([_moved(head, axis, float(i), _HOW.hold) for i in currents]).T


def _moved(head: Actuator, axis: int, current: float, seconds: float) -> FloatArray:
    u = np.zeros(2)
    u[axis] = current
    last: FloatArray = np.asarray(head.apply(u, seconds, seconds).y)[:, -1]
    return last
