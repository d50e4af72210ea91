"""What the seat steers, and what the seat knows of it.

`Plant` is the door: a head with two wires, a catheter with two motors, and a camera. The seat knows
the wires as they were identified through that door, and the camera as it was calibrated.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.control.head import HeadControl, head_control
from minorloop.errors import ParameterError
from minorloop.identification import excitation
from minorloop.identification.heating import (
    HeatedWire,
    identify_coupling,
    identify_heating,
    moving_levels,
)
from minorloop.lab.actuator import Actuator, FrameSource

MIDDLE = 30.0
"""Pan and tilt at which the head looks straight ahead, in degrees."""
ADDRESSES = ("twin:rig", "twin:pipe")
_HOLD = 40.0
_BANDS = 12
_HIGHEST = 0.4


@runtime_checkable
class Plant(FrameSource, Protocol):
    """A catheter with its head and its camera."""

    @property
    def tick(self) -> float:
        """How long one ``exchange`` takes, in seconds."""

    def exchange(self, u: FloatArray) -> FloatArray:
        """Hold pan and tilt currents in A, advance in mm/s and roll in degrees/s for a tick.

        Returns
        -------
        (4,) array
            Pan, tilt, advance and roll at its end, in degrees and mm; NaN where a sensor is lost.
        """

    def focus_at(self, distance: float) -> None:
        """Send the focus of the camera to a distance in metres."""

    def safe(self) -> None:
        """Let the wires cool and stop the catheter."""


@dataclass(frozen=True, kw_only=True)
class View:
    """A calibrated camera and how it sits on the head.

    Parameters
    ----------
    width, height : int
        Of an image, in pixels.
    focal : float
        In pixels.
    lever : float
        From the pivot of the head to the lens, in metres.
    radius : float
        Of the pipe, in metres.
    """

    width: int
    height: int
    focal: float
    lever: float = 8e-3
    radius: float = 10e-3


def open_plant(address: str, *, specimen: int | None = None, seed: int = 0) -> tuple[Plant, View]:
    """The plant at an address, and its camera.

    Raises
    ------
    ParameterError
        If there is none at the address.
    """
    check_address(address)
    from minorloop.twins.catheter import Catheter
    from minorloop.twins.head import Head
    from minorloop.twins.rig import Rig

    head = Head(specimen, 0.05, seed, delay=0.04)
    catheter = Catheter(specimen, 0.02, seed)
    if address == "twin:rig":
        from minorloop.twins import picture

        drawn = picture.Picture(seed)
        view = View(
            width=picture.WIDTH,
            height=picture.HEIGHT,
            focal=picture.FOCAL,
            lever=picture.LEVER,
            radius=picture.RADIUS,
        )
        return Rig(drawn, head, catheter), view
    from minorloop.geometry import Mount
    from minorloop.twins.camera import Camera
    from minorloop.twins.pipe import Pipe
    from minorloop.twins.rig import InPipe

    pipe = Pipe.draw(seed, length=0.1024, holes=6)
    camera = Camera(pipe, specimen=specimen, seed=seed)
    lens = camera.calibration
    view = View(
        width=lens.width,
        height=lens.height,
        focal=lens.focal,
        lever=Mount().lever,
        radius=pipe.radius,
    )
    return Rig(InPipe(camera), head, catheter), view


def head_of(address: str, specimen: int | None) -> HeadControl:
    """Identify the head at an address, one axis after the other, and give its control.

    A loop, reversal curves and a step of each axis: some hours of a real head, a second of a
    simulated one.

    Raises
    ------
    ParameterError
        If there is none at the address.
    """
    check_address(address)
    from minorloop.twins.head import Head

    head = Head(specimen, 0.05, 1)
    wires, moves = zip(*(_identified(head, axis) for axis in (0, 1)), strict=True)
    return head_control("observer", wires, coupling=identify_coupling(moves))


def _identified(head: Actuator, axis: int) -> tuple[HeatedWire, FloatArray]:
    loop = _HIGHEST * np.concatenate([np.linspace(0, 1, 17), np.linspace(1, 0, 17)[1:]])
    angles = _settled(head, axis, loop)
    levels = moving_levels(loop, angles[axis], _BANDS)
    _settled(head, axis, np.zeros(1))
    holds = excitation.reversal_curves(levels)
    steady = _settled(head, axis, holds)
    _settled(head, axis, np.zeros(1))
    t = np.arange(0.0, 40.0, 0.08)
    current = np.where((t >= 0.16) & (t < 25.0), _HIGHEST, 0.0)
    y = [0.0, *(float(_moved(head, axis, u, 0.08)[axis]) for u in current[:-1])]
    found = identify_heating(holds, steady[axis], step=(t, current, np.array(y)), levels=levels)
    return found.model, angles


def _settled(head: Actuator, axis: int, currents: FloatArray) -> FloatArray:
    """(2, T) angles after each hold of the current of one axis."""
    return np.array([_moved(head, axis, float(i), _HOLD) for i in currents]).T


def _moved(head: Actuator, axis: int, current: float, seconds: float) -> FloatArray:
    u = np.zeros(2)
    u[axis] = current
    last: FloatArray = np.asarray(head.apply(u, seconds, seconds).y)[:, -1]
    return last


def check_address(address: str) -> None:
    """Refuse an address at which there is nothing to steer.

    Raises
    ------
    ParameterError
        If there is nothing.
    """
    if address not in ADDRESSES:
        known = ", ".join(f"'{name}'" for name in ADDRESSES)
        raise ParameterError(f"there is nothing to steer at {address!r}; what exists is {known}")
