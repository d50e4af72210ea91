"""A head that carries a camera: wires, joints and lens on one clock.

Pan and tilt of the wires are 30 degrees when the camera looks along the pipe, for a wire pulls
one way only. Flow may sway the base of the head; the camera sees that, the sensors of the
joints do not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError
from minorloop.lab.actuator import Frame
from minorloop.twins.camera import Camera
from minorloop.twins.head import Head

STRAIGHT = 30.0
"""Pan and tilt of the joints of a head that looks along the pipe, in degrees."""
MOST_SWAY = 10.0


@dataclass(frozen=True)
class Sway:
    """How flow turns the base of the head, one sine for each axis.

    Parameters
    ----------
    amplitude : float
        In degrees, 0 to 10.
    pan, tilt : float
        Frequencies in Hz.

    Raises
    ------
    ParameterError
        If the amplitude is out of its range.
    """

    amplitude: float = 1.0
    pan: float = 0.3
    tilt: float = 0.23

    def __post_init__(self) -> None:
        if not 0 <= self.amplitude <= MOST_SWAY:
            raise ParameterError(f"a sway of {self.amplitude} degrees; give 0 to {MOST_SWAY:g}")

    def at(self, t: float) -> FloatArray:
        """(2,) degrees at a time in seconds."""
        phases = 2 * math.pi * t * np.array([self.pan, self.tilt])
        return np.asarray(self.amplitude * np.sin(phases))


class SeeingHead:
    """A head and its camera.

    Parameters
    ----------
    head : Head
        The wires; its tick is that of the camera.
    camera : Camera
        What sees.
    sway : Sway, optional
        Of the base; none without it.
    """

    kind = "seeing head"
    inputs, outputs = Head.inputs, Head.outputs

    def __init__(self, head: Head, camera: Camera, *, sway: Sway | None = None) -> None:
        self.head, self.camera, self.sway = head, camera, sway
        self._before = self._line_of_sight()

    def exchange(self, u: FloatArray) -> FloatArray:
        """Hold two currents for a tick; pan and tilt of the joints at its end, in degrees."""
        self._before = self._line_of_sight()
        return np.asarray(self.head.exchange(u))

    def frame(self) -> Frame:
        """The image that begins now; it does not take time from the wires."""
        now = self._line_of_sight()
        rates = (now - self._before) / self.head.tick
        self.camera.look(float(now[0]), float(now[1]), rates=(float(rates[0]), float(rates[1])))
        return self.camera.frame()

    def safe(self) -> None:
        """Let the wires cool."""
        self.head.safe()

    def _line_of_sight(self) -> FloatArray:
        """(2,) pan and tilt of the camera in radians. For scoring only."""
        swayed = np.zeros(2) if self.sway is None else self.sway.at(self.head.clock)
        return np.asarray(np.radians(self.head._output_now() - STRAIGHT + swayed))
