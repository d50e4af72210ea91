"""Requests and readings between a procedure and its loop, and protocols of the driven devices."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Generic, Protocol, TypeAlias, TypeVar, runtime_checkable

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import InstrumentError
from minorloop_head.sources import FrameSource, Shot

if TYPE_CHECKING:
    from minorloop_head.vision.calibrated_camera import Image

ALL_LIGHTS = (True, True, True)
NO_PROBE = "this head has no ultrasonic probe, so the depth cannot be measured"


def _zeros() -> FloatArray:
    return np.zeros(2)


@dataclass(frozen=True, eq=False, kw_only=True)
class Reading:
    """Measurements of one tick of the loop."""

    t: float
    """Time of the tick."""
    angles: FloatArray
    """Shape (2,). Pan and tilt of the line of sight as the joints measure them, 0 along the
    pipe."""
    place: FloatArray = field(default_factory=_zeros)
    """Shape (2,). Measured advance and roll of the catheter."""
    base: FloatArray = field(default_factory=_zeros)
    """Shape (2,). Pan and tilt by which the flow of the water has turned the base of the head,
    measured in pictures; joints do not measure them. Zero without a picture, NaN if the picture
    does not show them."""
    image: Image | None = None
    """A frame that was taken at these angles; None if it was not requested."""
    shots: tuple[Shot, ...] = ()
    """The burst that was requested."""
    fired: bool = False
    """Whether the burst that was requested has been fired."""
    extension: float = 0.0
    """Extension of the micro-tool, in metres."""
    touching: bool = False
    """Whether its point touches the wall."""

    @property
    def line_of_sight(self) -> FloatArray:
        """(2,) pan and tilt in the pipe: those of the joints plus those of the base."""
        return self.angles + self.base


@dataclass(frozen=True)
class LogEntry:
    """Entry of a log: the time in seconds, the action, its result, and whether it succeeded."""

    t: float
    what: str
    outcome: str
    succeeded: bool = True


@dataclass(frozen=True, eq=False, kw_only=True)
class Request:
    """Request of a procedure; settings that are None do not change."""

    angles: FloatArray | None = None
    """Shape (2,). Pan and tilt to which the head goes."""
    rates: FloatArray = field(default_factory=_zeros)
    """Shape (2,). Rates of advance and roll, for one tick."""
    sighted: FloatArray | None = None
    """Shape (2,). Pan and tilt of the head estimated from the image. They replace the readings of
    joints that have no sensors."""
    lights: tuple[bool, ...] | None = None
    """Whether each light is on from the next frame."""
    exposure: tuple[float, float] | None = None
    """Exposure time and gain from the next frame."""
    focus: float | None = None
    """Distance of the focus."""
    water: bool | None = None
    """Whether the pipe is flooded."""
    frame: bool = False
    """Whether the next reading contains a frame."""
    shots: int = 0
    """Number of shots in the burst of the next reading."""
    extension: float | None = None
    """Wanted extension of the micro-tool, in metres; it stops where it touches the wall."""
    now: bool = False
    """Whether the next reading is of the same tick: nothing moves before it."""


NOTHING, NOW = Request(), Request(now=True)


Result = TypeVar("Result")
Procedure: TypeAlias = Generator[Request, Reading, Result]
"""Yields a request, is sent the reading of the tick after it, and returns its result."""


class Running(Generic[Result]):
    """A procedure that a loop advances by one tick at a time.

    ``carry_out``: carries out a request, except its motion, which the loop does; ``safe``: request
    that is carried out if the procedure is closed before its end, and leaves all safe.

    Its ``done``: whether it has ended, or was closed.
    Its ``result``: of a procedure that has ended.
    """

    result: Result

    def __init__(
        self,
        procedure: Procedure[Result],
        carry_out: Callable[[Request], None],
        safe: Request = NOTHING,
    ) -> None:
        self._procedure, self._carry_out, self._safe = procedure, carry_out, safe
        self._begun = self.done = False

    def advance(self, reading: Reading) -> Request:
        """Continue with the reading of a tick; return the request until the next one."""
        try:
            request = self._procedure.send(reading) if self._begun else next(self._procedure)
            self._begun = True
            self._carry_out(request)
            while request.now:
                request = self._procedure.send(reading)
                self._carry_out(request)
        except StopIteration as end:
            self.done, self.result = True, end.value
            return NOTHING
        return request

    def close(self) -> None:
        """End the procedure now and leave all safe; do nothing if it has ended."""
        self._procedure.close()
        if not self.done:
            self.done = True
            self._carry_out(self._safe)


@runtime_checkable
class Plant(Protocol):
    """A catheter with its head."""

    @property
    def tick(self) -> float:
        """Duration of one ``exchange``, in seconds."""

    @property
    def time(self) -> float | None:
        """Seconds from the first ``exchange`` to the last one; None where each takes one tick."""

    def exchange(self, u: FloatArray) -> FloatArray:
        """Hold pan and tilt currents in A, advance in m/s and roll in rad/s for a tick.

        Returns pan and tilt of the joints, advance and roll (4,) at its end, in rad and m; NaN
        where a sensor is lost.
        """

    def stance(self) -> tuple[float, ...]:
        """Return the pose that a simulated tip needs; a real tip needs none."""

    def safe(self) -> None:
        """Switch off the currents of the wires and stop the catheter."""


class LitCamera(FrameSource, Protocol):
    """A camera with lights that are switched one by one."""

    def switch(self, lights: Sequence[bool]) -> None:
        """Set which lights are on from the next frame."""

    def expose(self, exposure: float, gain: float = 1.0) -> None:
        """Set the exposure time in seconds, and the gain."""


@runtime_checkable
class Tip(LitCamera, Protocol):
    """A camera with lights, and a probe."""

    def move_to(self, stance: tuple[float, ...]) -> None:
        """Take over the pose of the plant."""

    def focus_at(self, distance: float) -> None:
        """Set the focus of the camera to a distance in metres."""

    def flood(self, on: bool) -> None:
        """Fill the pipe with water for the probe, or drain it."""

    def shots(self, count: int) -> list[Shot]:
        """Fire pulses, one after the other."""


@runtime_checkable
class ToolTip(Protocol):
    """A tip with a micro-tool."""

    def extend(self, length: float) -> None:
        """Extend the tool to a length in metres, or until it touches the wall."""

    def tool_state(self) -> tuple[float, bool]:
        """Return the extension in metres, and whether the tool touches the wall."""


def apply_to_tip(tip: Tip, request: Request) -> None:
    """Set lights, exposure, focus, water and tool as requested.

    Raises an `InstrumentError` if the tool is to be extended and the tip has none.
    """
    if request.extension is not None:
        if not isinstance(tip, ToolTip):
            raise InstrumentError("this head has no micro-tool; nothing can be marked with it")
        tip.extend(request.extension)
    if request.lights is not None:
        tip.switch(request.lights)
    if request.exposure is not None:
        tip.expose(*request.exposure)
    if request.focus is not None:
        tip.focus_at(request.focus)
    if request.water is not None:
        tip.flood(request.water)


def passed(since: float | None, now: float, seconds: float) -> bool:
    """Whether some seconds have passed, up to rounding of the clock; False if since is None."""
    return since is not None and now - since >= seconds - 1e-6


def held_since(before: float | None, now: float, holds: bool = True) -> float | None:
    """Return the time from which a condition has held without a break, None if it does not."""
    if not holds:
        return None
    return now if before is None else before
