"""Control of a head by its camera alone: its angles are late, and sometimes missing."""

from __future__ import annotations

from typing import Any

from minorloop_head.control.head import HeadControl, Law, head_control
from minorloop_head.control.readings import SensorWatch
from minorloop_head.control.unread import UnreadWatch
from minorloop_head.heated_wire import HeatedWire

AGE = 2
"""Age in ticks of the pictures that a loop acts on: one to two frames, and those that come sooner
wait, since a law has one delay."""
PATIENCE = 250
"""Pictures in a row without angles after which the wires cool: for 10 s the head goes by its model,
whose error grows by a few degrees in that time. One picture with angles ends such a row, since a
camera may give fewer pictures than the loop has ticks."""
LEAD = 6.0
"""Most degrees by which a wanted angle is ahead of the newest one of a picture, for a camera that
may give fewer pictures than the loop has ticks. A head that is not seen stops within them, where it
is found again. The wires of `examples/simulated_board.py` turn by 55 degrees in 8 s so, and in 5 s
without."""


def camera_control(law: str | Law, wires: tuple[HeatedWire, ...], **options: Any) -> HeadControl:
    """Return the control of a head by its camera.

    Parameters
    ----------
    law, wires, **options
        As of `minorloop_head.control.head.head_control`.

    Raises
    ------
    ParameterError
        As `minorloop_head.control.head.head_control`.
    """
    watch = SensorWatch(patience=PATIENCE, makes_up=PATIENCE)
    known = {"delay": AGE, "sensor": watch, "unread": UnreadWatch()}
    return head_control(law, wires, **{**known, **options})
