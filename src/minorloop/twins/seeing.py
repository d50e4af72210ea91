"""A head in a pipe that sees and hears: wires, joints, catheter, lens and probe.

Pan and tilt of the wires are 30 degrees when the camera looks along the pipe, for a wire pulls
one way only. Flow may sway the base of the head; camera and probe feel that, the sensors of the
joints do not. `SeeingHead` has its camera beside it; a `Rig` and its `Tip` may be far apart, for
all that passes between them is a `Stance`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError
from minorloop.geometry import Mount, Pinhole
from minorloop.lab.actuator import Channel, Frame, Shot
from minorloop.twins.camera import LENS, Camera
from minorloop.twins.catheter import Catheter
from minorloop.twins.head import Head
from minorloop.twins.pipe import Pipe
from minorloop.twins.ultrasound import Ultrasound

STRAIGHT = 30.0
"""Pan and tilt of the joints of a head that looks along the pipe, in degrees."""
MOST_SWAY = 10.0
_BRIM = 0.9999  # of the radius, as the height of the water in a pipe that is full

Stance: TypeAlias = tuple[float, float, float, float, float, float]
"""True pan and tilt in radians, their rates, advance in metres and roll in radians."""


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


class _Joints:
    """A head that sways, and where it really points."""

    def __init__(self, head: Head, sway: Sway | None) -> None:
        self.head, self.sway = head, sway
        self._before = self._line_of_sight()

    def _move(self, u: FloatArray) -> FloatArray:
        self._before = self._line_of_sight()
        return np.asarray(self.head.exchange(u), dtype=np.float64)

    def _line_of_sight(self) -> FloatArray:
        """(2,) pan and tilt of the camera in radians. For scoring only."""
        swayed = np.zeros(2) if self.sway is None else self.sway.at(self.head.clock)
        return np.asarray(np.radians(self.head._output_now() - STRAIGHT + swayed))

    def _pointing(self) -> tuple[float, float, float, float]:
        """Pan, tilt and their rates, in radians and radians per second."""
        now = self._line_of_sight()
        rates = (now - self._before) / self.head.tick
        return float(now[0]), float(now[1]), float(rates[0]), float(rates[1])


class SeeingHead(_Joints):
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
        super().__init__(head, sway)
        self.camera = camera
        self._framed = False

    def exchange(self, u: FloatArray) -> FloatArray:
        """Hold two currents for a tick; pan and tilt of the joints at its end, in degrees.

        The time of a frame is that of the tick after it; without one, the lens moves on as well.
        """
        if not self._framed:
            self.camera._pass(self.head.tick)
        self._framed = False
        return self._move(u)

    def frame(self) -> Frame:
        """The image that begins now; it does not take time from the wires."""
        pan, tilt, *rates = self._pointing()
        self.camera.look(pan, tilt, rates=(rates[0], rates[1]))
        self._framed = True
        return self.camera.frame()

    def safe(self) -> None:
        """Let the wires cool."""
        self.head.safe()


class Rig(_Joints):
    """A head and the catheter that carries it, on one clock.

    Channels, in this order: ``pan current``, ``tilt current``, ``advance rate`` and ``roll rate``
    in; ``pan``, ``tilt``, ``advance`` and ``roll`` out.

    Parameters
    ----------
    head : Head, optional
        Nominal, with 0.05 degrees of noise and a delay of one tick, without it.
    catheter : Catheter, optional
        Nominal, with a noise of 0.02 mm and degrees, without it.
    sway : Sway, optional
        Of the base of the head; none without it.
    """

    kind = "rig"
    inputs: tuple[Channel, ...] = (*Head.inputs, *Catheter.inputs)
    outputs: tuple[Channel, ...] = (*Head.outputs, *Catheter.outputs)

    def __init__(
        self,
        head: Head | None = None,
        catheter: Catheter | None = None,
        *,
        sway: Sway | None = None,
    ) -> None:
        super().__init__(head or Head(noise=0.05, delay=0.04), sway)
        self.catheter = catheter or Catheter(noise=0.02)
        self.tick = self.head.tick

    def exchange(self, u: FloatArray) -> FloatArray:
        """Hold the four inputs for one tick and give the four outputs at its end.

        Raises
        ------
        LimitError
            If an input is beyond its limits.
        """
        angles = self._move(np.asarray(u[:2]))
        place = np.asarray(self.catheter.exchange(np.asarray(u[2:])), dtype=np.float64)
        return np.concatenate([angles, place])

    def safe(self) -> None:
        """Let the wires cool and stop the catheter."""
        self.head.safe()
        self.catheter.safe()

    def stance(self) -> Stance:
        """Where it truly is, for the twins of what it carries and for nobody else."""
        advance, roll = self.catheter._output_now().tolist()
        return (*self._pointing(), 1e-3 * advance, math.radians(roll))


class Tip:
    """What a rig carries: a camera with its lights, and a probe that hears in water.

    Parameters
    ----------
    pipe : Pipe
        Dry; ``flood`` fills it for the probe, and the picture stays that of the dry pipe.
    offset : (float, float)
        Of the pivot off the axis of the pipe, in metres.
    specimen : int, optional
        Of camera and probe; nominal without it.
    seed : int
        Of their noise.
    optics : Pinhole, optional
        Of the camera; its own without it.
    """

    def __init__(
        self,
        pipe: Pipe,
        *,
        offset: tuple[float, float] = (0.0, 0.0),
        specimen: int | None = None,
        seed: int = 0,
        optics: Pinhole = LENS,
    ) -> None:
        self._mount = Mount(offset=offset)
        self.pipe = pipe
        self.camera = Camera(pipe, self._mount, optics, specimen=specimen, seed=seed)
        full = replace(pipe, water=-_BRIM * pipe.radius)
        self._probes = {
            wet: Ultrasound(filled, self._mount, specimen=specimen, seed=seed)
            for wet, filled in ((False, pipe), (True, full))
        }
        self._wet = False

    def stand(self, stance: tuple[float, ...]) -> None:
        """Say where the rig stands, by its `Stance`."""
        pan, tilt, pan_rate, tilt_rate, advance, roll = stance
        mount = replace(self._mount, advance=advance, roll=roll)
        self.camera.move(mount)
        self.camera.look(pan, tilt, rates=(pan_rate, tilt_rate))
        probe = self._probes[self._wet]
        probe.move(mount)
        probe.look(pan, tilt, rates=(pan_rate, tilt_rate))

    def frame(self) -> Frame:
        """The image that begins now."""
        return self.camera.frame()

    def switch(self, lights: Sequence[bool]) -> None:
        """Say which lights are on from the next frame."""
        self.camera.switch(lights)

    def expose(self, exposure: float, gain: float = 1.0) -> None:
        """Set how long the shutter is open, in seconds, and the gain."""
        self.camera.expose(exposure, gain)

    def focus_at(self, distance: float) -> None:
        """Send the focus to a distance in metres."""
        self.camera.focus_at(distance)

    def flood(self, on: bool) -> None:
        """Fill the pipe with water, or let it out."""
        self._wet = on

    def shots(self, count: int) -> list[Shot]:
        """Fire pulses, one after the other."""
        return [self._probes[self._wet].shot() for _ in range(count)]
