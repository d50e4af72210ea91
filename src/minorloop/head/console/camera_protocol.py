"""What passes between the control loop and the eyes of the seat.

The loop says where the head is and what it wishes; the eyes say what they saw, a tick later. They
are in processes of their own, so that no picture ever holds up the loop.
"""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from collections.abc import Callable
from typing import Any, Protocol, TypeAlias

import msgspec

from minorloop.head.console.channel import NewestPipe

PICTURED = b"p"
"""What stands before a picture that the eyes send to be recorded."""
Wish: TypeAlias = tuple[str, list[float]]
"""What the eyes are to do: a name of `Eyes.wishes` and numbers."""


class CameraRequest(msgspec.Struct, frozen=True, kw_only=True):
    """A tick of the control loop, for the eyes.

    Parameters
    ----------
    number : int
        Of the tick.
    t : float
        In seconds, on the clock of the loop.
    where : (float, float, float, float)
        Pan and tilt about the middle, advance and roll as measured, in degrees and mm.
    stance : tuple of float
        For a simulated tip only, see `Plant.stance`.
    wishes : list of Wish
    keep : bool
        Whether pictures are to come back, for a recording.
    """

    number: int
    t: float
    where: tuple[float, float, float, float]
    stance: tuple[float, ...] = ()
    wishes: list[Wish] = []
    keep: bool = False


class CameraReport(msgspec.Struct, frozen=True, kw_only=True):
    """What the eyes made of a tick.

    Parameters
    ----------
    number : int
        Of the tick.
    target : (float, float, float, bool), optional
        Pixel of the point that is followed, how well it was recognised, and whether it is seen;
        None where none is followed.
    spots : list of (float, float, float, float)
        Pixel, diameter in pixels and evidence of what could be a defect, the likeliest first.
    events : list of dict
        What was found out, each with a ``what``.
    """

    number: int
    target: tuple[float, float, float, bool] | None = None
    spots: list[tuple[float, float, float, float]] = []
    events: list[dict[str, Any]] = []


class CameraLink(Protocol):
    """What the control loop needs of the eyes; neither call waits."""

    def look(self, look: CameraRequest) -> None:
        """Say where the head is and what is wished."""

    def seen(self) -> list[CameraReport]:
        """What came since the last call."""


class RemoteCamera:
    """Eyes in another process.

    Parameters
    ----------
    channel : NewestPipe
        To that process. Its first word on each pipe is what it knows of camera and probe, or
        ``{"failed": sentence}``.
    """

    def __init__(self, channel: NewestPipe) -> None:
        self._channel = channel
        self._there = threading.Condition()
        self._next: CameraRequest | None = None
        self._came: deque[CameraReport] = deque(maxlen=64)
        self._introduction: dict[str, Any] | None = None
        self._met = False
        self.on_picture: Callable[[bytes], None] | None = None
        self.keep = False
        for work in (self._speak, self._listen):
            threading.Thread(target=work, daemon=True).start()

    def introduced(self, timeout: float) -> dict[str, Any] | None:
        """The first word; None where it did not come in time."""
        with self._there:
            self._there.wait_for(lambda: self._introduction is not None, timeout)
            return self._introduction

    def look(self, look: CameraRequest) -> None:
        """Say where the head is; what was not sent yet is replaced, but for its wishes."""
        with self._there:
            if self._next is not None and self._next.wishes:
                wishes: list[Wish] = [*self._next.wishes, *look.wishes]
                look = msgspec.structs.replace(look, wishes=wishes)
            self._next = msgspec.structs.replace(look, keep=True) if self.keep else look
            self._there.notify_all()

    def seen(self) -> list[CameraReport]:
        """What came since the last call."""
        came = []
        while self._came:
            came.append(self._came.popleft())
        return came

    def _speak(self) -> None:
        encoder = msgspec.msgpack.Encoder()
        while True:
            with self._there:
                self._there.wait_for(lambda: self._next is not None and self._met)
                look, self._next = self._next, None
            self._channel.send(encoder.encode(look))

    def _listen(self) -> None:
        decoder = msgspec.msgpack.Decoder(CameraReport)
        for pipe in self._channel.pipes():
            with contextlib.suppress(EOFError, OSError):
                self._meet(pipe.recv_bytes())
                while True:
                    content = pipe.recv_bytes()
                    if content[:1] != PICTURED:
                        self._came.append(decoder.decode(content))
                    elif self.on_picture is not None:
                        self.on_picture(content[1:])
            self._met = False

    def _meet(self, content: bytes) -> None:
        with self._there:
            self._introduction = msgspec.json.decode(content)
            self._met, self._next = True, None  # what was wished was wished of another
            self._there.notify_all()
