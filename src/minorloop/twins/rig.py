"""The whole catheter in a pipe: head, catheter and camera, one tick at a time.

Channels, in this order: ``pan current``, ``tilt current``, ``advance rate`` and ``roll rate`` in;
``pan``, ``tilt``, ``advance`` and ``roll`` out. The camera looks where the head points, as its
sensors see it, less the 30 degrees at which the head is straight.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.geometry import Mount
from minorloop.lab.actuator import Channel, Frame
from minorloop.twins.camera import Camera
from minorloop.twins.catheter import Catheter
from minorloop.twins.head import Head

STRAIGHT = 30.0
"""Pan and tilt of a head that looks along the pipe, in degrees."""
_GAIN, _BRIGHT, _HASTE, _SHORTEST = 4.0, 150.0, 0.2, 2e-4


class Looking(Protocol):
    """A simulated camera that has to be told where it is."""

    def look(self, pan: float, tilt: float, *, rates: tuple[float, float]) -> None:
        """Angles in radians, and their rates."""

    def place(self, advance: float, roll: float) -> None:
        """Position along the pipe in metres, and roll in radians."""

    def focus_at(self, distance: float) -> None:
        """Send the focus to a distance in metres."""

    def frame(self) -> Frame:
        """The next image."""


class InPipe:
    """The camera in a metal pipe, told its place by its mount, with an exposure that adapts.

    Parameters
    ----------
    camera : Camera
    """

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._exposure = 0.01

    def look(self, pan: float, tilt: float, *, rates: tuple[float, float]) -> None:
        """Angles in radians, and their rates."""
        self._camera.look(pan, tilt, rates=rates)

    def place(self, advance: float, roll: float) -> None:
        """Position along the pipe in metres, and roll in radians."""
        self._camera.move(Mount(advance=advance, roll=roll))

    def focus_at(self, distance: float) -> None:
        """Send the focus to a distance in metres."""
        self._camera.focus_at(distance)

    def frame(self) -> Frame:
        """The next image; the exposure follows its brighter part, so that little is washed out."""
        self._camera.expose(self._exposure, _GAIN)
        frame = self._camera.frame()
        bright = max(float(np.percentile(frame.image[::8, ::8], 85)), 4.0)
        wanted = self._exposure * (_BRIGHT / bright) ** _HASTE
        self._exposure = min(max(wanted, _SHORTEST), self._camera.sensor.interval / 2)
        return frame


class Rig:
    """A head, a catheter and a camera on one clock.

    Parameters
    ----------
    camera : Looking
        What sees.
    head : Head, optional
        Nominal, with 0.05 degrees of noise and a delay of one tick, without it.
    catheter : Catheter, optional
        Nominal, with a noise of 0.02 mm and degrees, without it.
    """

    kind = "rig"
    inputs: tuple[Channel, ...] = (*Head.inputs, *Catheter.inputs)
    outputs: tuple[Channel, ...] = (*Head.outputs, *Catheter.outputs)

    def __init__(
        self, camera: Looking, head: Head | None = None, catheter: Catheter | None = None
    ) -> None:
        self._camera = camera
        self._head = head or Head(noise=0.05, delay=0.04)
        self._catheter = catheter or Catheter(noise=0.02)
        self.tick = self._head.tick
        self._before = self._head._output_now()

    def exchange(self, u: FloatArray) -> FloatArray:
        """Hold the four inputs for one tick and give the four outputs at its end.

        Raises
        ------
        LimitError
            If an input is beyond its limits.
        """
        angles = np.asarray(self._head.exchange(np.asarray(u[:2])), dtype=np.float64)
        place = np.asarray(self._catheter.exchange(np.asarray(u[2:])), dtype=np.float64)
        return np.concatenate([angles, place])

    def safe(self) -> None:
        """Let the wires cool and stop the catheter."""
        self._head.safe()
        self._catheter.safe()

    def focus_at(self, distance: float) -> None:
        """Send the focus of the camera to a distance in metres."""
        self._camera.focus_at(distance)

    def frame(self) -> Frame:
        """What the camera sees now."""
        now = self._head._output_now()
        pan, tilt = np.radians(now - STRAIGHT).tolist()
        rates = np.radians((now - self._before) / self.tick).tolist()
        self._before = now
        advance, roll = self._catheter._output_now().tolist()
        self._camera.look(pan, tilt, rates=(rates[0], rates[1]))
        self._camera.place(1e-3 * advance, float(np.radians(roll)))
        return self._camera.frame()
