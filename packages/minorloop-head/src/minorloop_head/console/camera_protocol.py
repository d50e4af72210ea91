"""Messages between the control loop and the camera process.

The loop sends the position of the head and commands for the camera; a tick later the camera process
reports its results. They are separate processes, so that no picture ever delays the loop.
"""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from collections.abc import Callable
from typing import Any, Protocol, TypeAlias

import msgspec

from minorloop_head.console.channel import NewestPipe
from minorloop_head.console.messages import Pair, Spot
from minorloop_head.console.units import Position

PICTURED = b"p"
"""First byte of a picture that the camera process sends to the loop for a recording."""
PROBLEM = b"!"
"""First byte of a sentence on a missing picture."""
FEW_PICTURES = 5
"""Ticks per picture if an operator only looks on, in a recording, and while the head in a simulated
pipe scans, or holds or rests before a searched view: five pictures per second."""
CameraCommand: TypeAlias = tuple[str, list[float]]
"""A name of `Perception.commands` and its arguments."""


class CameraRequest(msgspec.Struct, frozen=True, kw_only=True):
    """A tick of the control loop, for the camera process."""

    number: int
    """Number of the tick."""
    t: float
    """Time in seconds, on the clock of the loop."""
    position: Position
    """Measured pan and tilt about the middle, advance and roll, in rad and m."""
    stance: tuple[float, ...] = ()
    """Pose for a simulated tip only, see `Plant.stance`."""
    commands: list[CameraCommand] = []
    keep: bool = False
    """Whether pictures are to be sent to the loop, for a recording."""
    cold: bool = False
    """Whether the head has no current, and had none since it was made safe."""
    holding: bool = False
    """Whether the head holds, so that the pictures steer nothing."""
    centring: bool = False
    """Whether the tracked point is centred, so that the camera is exposed for it."""


class CameraReport(msgspec.Struct, frozen=True, kw_only=True):
    """Results of the camera process in a tick."""

    number: int
    """Number of the tick."""
    target: tuple[float, float, float, bool] | None = None
    """Pixel of the tracked point, score of its recognition, and whether it is visible; None without
    a tracked point."""
    spots: list[Spot] = []
    """Pixel, diameter in pixels and evidence of candidates, the likeliest first."""
    events: list[dict[str, Any]] = []
    """Results, each with a ``what``."""
    joints: Pair | None = None
    """Pan and tilt of joints without sensors, measured in the picture, in degrees."""
    unseen: str = ""
    """Reason why angles are missing, although the pictures have to give them."""
    zero: bool = True
    """Whether the picture of the cold head, the zero of the angles, is known."""


# Made while the module is imported: see `minorloop_head.console.messages`.
request_decoder = msgspec.msgpack.Decoder(CameraRequest)
report_decoder = msgspec.msgpack.Decoder(CameraReport)


class CameraLink(Protocol):
    """Interface of the control loop to the camera; neither call waits."""

    @property
    def problem(self) -> str:
        """Reason why there is no picture; empty if it is unknown, or there is a picture."""

    def send(self, request: CameraRequest) -> None:
        """Send the position of the head, and commands."""

    def reports(self) -> list[CameraReport]:
        """Return the reports since the last call."""


class RemoteCamera:
    """A camera in another process.

    Its ``problem``: as of `CameraLink`.

    ``channel``: to that process. Its first message on each pipe is the calibration of camera and
    probe, or ``{"failed": sentence}``.
    """

    def __init__(self, channel: NewestPipe) -> None:
        self._channel = channel
        self._changed = threading.Condition()
        self._next: CameraRequest | None = None
        self._reports: deque[CameraReport] = deque(maxlen=64)
        self._introduction: dict[str, Any] | None = None
        self._introduced, self.problem = False, ""
        self.on_picture: Callable[[bytes], None] | None = None
        self.keep = False
        for work in (self._send, self._receive):
            threading.Thread(target=work, daemon=True).start()

    def introduction(self, timeout: float) -> dict[str, Any] | None:
        """Return the first message; None if it did not arrive in time."""
        with self._changed:
            self._changed.wait_for(lambda: self._introduction is not None, timeout)
            return self._introduction

    def send(self, request: CameraRequest) -> None:
        """Send a request; it replaces an unsent request, and takes over its commands."""
        with self._changed:
            if self._next is not None and self._next.commands:
                commands: list[CameraCommand] = [*self._next.commands, *request.commands]
                request = msgspec.structs.replace(request, commands=commands)
            self._next = msgspec.structs.replace(request, keep=True) if self.keep else request
            self._changed.notify_all()

    def reports(self) -> list[CameraReport]:
        """Return the reports since the last call."""
        found = []
        while self._reports:
            found.append(self._reports.popleft())
        return found

    def _send(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._next is not None and self._introduced)
                request, self._next = self._next, None
            self._channel.send(msgspec.msgpack.encode(request))

    def _receive(self) -> None:
        for pipe in self._channel.pipes():
            with contextlib.suppress(EOFError, OSError):
                self._introduce(pipe.recv_bytes())
                while True:
                    content = pipe.recv_bytes()
                    if content[:1] == PROBLEM:
                        self.problem = content[1:].decode()
                    elif content[:1] != PICTURED:
                        self._reports.append(report_decoder.decode(content))
                        self.problem = ""
                    elif self.on_picture is not None:
                        self.on_picture(content[1:])
            self._introduced = False

    def _introduce(self, content: bytes) -> None:
        with self._changed:
            self._introduction = msgspec.json.decode(content)
            # Drop commands for the former process.
            self._introduced, self._next = True, None
            self._changed.notify_all()
