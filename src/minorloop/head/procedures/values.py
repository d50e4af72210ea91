"""What passes between a procedure and the loop that drives it, and what the loop drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol, TypeVar, runtime_checkable

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.head.vision.calibrated_camera import Image
from minorloop.lab.actuator import FrameSource, Shot

ALL_LIGHTS = (True, True, True)


def _zeros() -> FloatArray:
    return np.zeros(2)


@dataclass(frozen=True, eq=False, kw_only=True)
class Reading:
    """What a tick of the loop told.

    Parameters
    ----------
    t : float
        Time of the tick.
    angles : (2,) array
        Pan and tilt of the line of sight as the joints measure them, 0 along the pipe.
    place : (2,) array
        Advance and roll of the catheter as measured.
    base : (2,) array
        By how much the flow of the water has turned the base of the head, as a gyroscope
        measures it; the joints do not measure that. Zero where there is no gyroscope.
    image : array, optional
        A frame that was taken at these angles; None where none was asked for.
    shots : tuple of Shot
        The burst that was asked for.
    heard : bool
        Whether the burst that was asked for has been fired.
    """

    t: float
    angles: FloatArray
    place: FloatArray = field(default_factory=_zeros)
    base: FloatArray = field(default_factory=_zeros)
    image: Image | None = None
    shots: tuple[Shot, ...] = ()
    heard: bool = False

    @property
    def line_of_sight(self) -> FloatArray:
        """(2,) pan and tilt in the pipe: of the joints and of the base."""
        return self.angles + self.base


@dataclass(frozen=True, eq=False, kw_only=True)
class Request:
    """What a procedure asks for; what it does not name stays as it is.

    Parameters
    ----------
    angles : (2,) array, optional
        Pan and tilt that the head is to go to.
    rates : (2,) array
        Of advance and roll, for one tick.
    sighted : (2,) array, optional
        Pan and tilt of the head as the image tells them; they stand for the readings of joints
        that have no sensors.
    lights : tuple of bool, optional
        Which lights are on from the next frame.
    exposure : (float, float), optional
        Exposure time and gain from the next frame.
    focus : float, optional
        Distance that the focus is sent to.
    water : bool, optional
        Whether the pipe is to be full of water.
    frame : bool
        Whether the next reading is to have a frame.
    shots : int
        Number of shots in the burst of the next reading.
    """

    angles: FloatArray | None = None
    rates: FloatArray = field(default_factory=_zeros)
    sighted: FloatArray | None = None
    lights: tuple[bool, ...] | None = None
    exposure: tuple[float, float] | None = None
    focus: float | None = None
    water: bool | None = None
    frame: bool = False
    shots: int = 0


NOTHING = Request()


class ProcedureState(Protocol):
    """What a procedure remembers."""

    @property
    def done(self) -> bool:
        """Whether the procedure has ended; it asks for nothing from then on."""


State = TypeVar("State", bound=ProcedureState)


class Procedure(Protocol[State]):
    """Steps that a loop drives."""

    def step(self, state: State, reading: Reading) -> tuple[State, Request]:
        """The next state, and what is asked for."""


@runtime_checkable
class Plant(Protocol):
    """A catheter with its head."""

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

    def stance(self) -> tuple[float, ...]:
        """What a simulated tip has to be told of where it is; a real one needs nothing."""

    def safe(self) -> None:
        """Let the wires cool and stop the catheter."""


class LitCamera(FrameSource, Protocol):
    """A camera with lights that are switched one by one."""

    def switch(self, lights: Sequence[bool]) -> None:
        """Say which lights are on from the next frame."""

    def expose(self, exposure: float, gain: float = 1.0) -> None:
        """Set how long the shutter is open, in seconds, and the gain."""


@runtime_checkable
class Tip(LitCamera, Protocol):
    """A camera with lights, and a probe."""

    def stand(self, stance: tuple[float, ...]) -> None:
        """Take in what the plant says of where it is."""

    def focus_at(self, distance: float) -> None:
        """Send the focus of the camera to a distance in metres."""

    def flood(self, on: bool) -> None:
        """Fill the pipe with water for the probe, or let it out."""

    def shots(self, count: int) -> list[Shot]:
        """Fire pulses, one after the other."""


def apply_to_tip(tip: Tip, request: Request) -> None:
    """Set lights, exposure, focus and water as a request asks."""
    if request.lights is not None:
        tip.switch(request.lights)
    if request.exposure is not None:
        tip.expose(*request.exposure)
    if request.focus is not None:
        tip.focus_at(request.focus)
    if request.water is not None:
        tip.flood(request.water)


def passed(since: float, now: float, seconds: float) -> bool:
    """Whether so many seconds have passed, rounding of the clock apart."""
    return now - since >= seconds - 1e-6
