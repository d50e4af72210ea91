"""Who is there: one pilot, many watchers, and what each of them is told.

Every viewer has places for the newest state, image and map, and a short list of what must not be
lost. A slow page misses pictures; it holds up nobody and costs no memory.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from dataclasses import dataclass, field
from typing import Any

from minorloop.errors import SignalError
from minorloop.head.console import messages

SILENCE = 3.0
"""Seconds of silence after which the controls are taken back."""
_MOST_WAITING = 200
_MOST_A_SECOND = 250
_BURST = 500


class HostileMessageError(SignalError):
    """What no page of ours would send; its connection is closed with the sentence."""


@dataclass(eq=False)
class Viewer:
    """A page that is connected.

    Parameters
    ----------
    number : int
        Its name to the others.
    """

    number: int
    seq: int = -1
    t: float = -1.0
    granted: int = 0
    heard: float = 0.0
    allowance: float = float(_BURST)
    _texts: deque[bytes] = field(default_factory=lambda: deque(maxlen=_MOST_WAITING))
    _newest: dict[str, bytes] = field(default_factory=dict)
    _there: asyncio.Event = field(default_factory=asyncio.Event)

    def tell(self, text: bytes) -> None:
        """Something that must not be lost."""
        self._texts.append(text)
        self._there.set()

    def show(self, what: str, content: bytes) -> None:
        """Something of which only the newest counts."""
        self._newest[what] = content
        self._there.set()

    async def waiting(self) -> list[bytes]:
        """What is to be sent, as soon as there is something."""
        await self._there.wait()
        self._there.clear()
        out = [*self._texts, *self._newest.values()]
        self._texts.clear()
        self._newest.clear()
        return out

    def check(self, message: messages.Message, now: float) -> None:
        """Refuse what comes out of order, or too fast.

        Raises
        ------
        HostileMessageError
            With a sentence for the page.
        """
        self.allowance = min(self.allowance + _MOST_A_SECOND * (now - self.heard), _BURST) - 1.0
        self.heard = now
        if self.allowance < 0:
            raise HostileMessageError(f"more than {_MOST_A_SECOND} messages a second came")
        if message.seq <= self.seq or message.t < self.t:
            raise HostileMessageError(
                f"message {message.seq} at {message.t:g} s came after message {self.seq} at "
                f"{self.t:g} s; numbers must rise and time must not go back"
            )
        self.seq, self.t = message.seq, message.t


class Clients:
    """All viewers, and the controls.

    Parameters
    ----------
    silence : float
        Seconds of silence of the pilot after which the controls are taken back.
    """

    def __init__(self, *, silence: float = SILENCE) -> None:
        self._silence = silence
        self.viewers: set[Viewer] = set()
        self.pilot: Viewer | None = None
        self.grant = 0
        self.hello: bytes | None = None
        self.findings = messages.encode("findings", findings=[])
        self.recording = messages.encode("recording", name=None)
        self.failed: bytes | None = None
        self._count = 0
        self._newest: dict[str, bytes] = {}

    def join(self) -> Viewer:
        """A new viewer, who is told what the others know."""
        self._count += 1
        viewer = Viewer(self._count)
        viewer.heard = time.monotonic()
        self.viewers.add(viewer)
        known = (self.failed, self.hello, self.findings, self.recording)
        for text in known:
            if text is not None:
                viewer.tell(text)
        for what, content in self._newest.items():
            viewer.show(what, content)
        self.tell_seats()
        return viewer

    def leave(self, viewer: Viewer) -> bool:
        """A viewer has gone; whether it was the pilot."""
        self.viewers.discard(viewer)
        was = viewer is self.pilot
        if was:
            self.pilot = None
        self.tell_seats()
        return was

    def take(self, viewer: Viewer) -> bool:
        """Give the controls to a viewer if nobody has them; whether they are newly theirs."""
        if self.pilot is not None and self.pilot is not viewer:
            viewer.tell(
                messages.encode(
                    "notice",
                    text=f"viewer {self.pilot.number} has the controls; ask for their release",
                )
            )
            return False
        fresh = self.pilot is None
        if fresh:
            self.grant += 1
            self.pilot, viewer.granted = viewer, self.grant
        self.tell_seats()
        return fresh

    def free(self) -> None:
        """Take the controls back."""
        self.pilot = None
        self.tell_seats()

    def may(self, viewer: Viewer, order: messages.Order) -> bool:
        """Whether an order counts; one that was on its way when the controls were taken does not.

        Raises
        ------
        HostileMessageError
            If the viewer never had the controls that the order speaks of.
        """
        if viewer is self.pilot and order.grant == viewer.granted:
            return True
        if 0 < order.grant <= viewer.granted:
            return False
        raise HostileMessageError("only the pilot steers; take the controls first")

    def silent(self, now: float) -> bool:
        """Whether the pilot has not been heard of for too long."""
        return self.pilot is not None and now - self.pilot.heard > self._silence

    def tell(self, text: bytes) -> None:
        """Tell everybody something that must not be lost."""
        for viewer in self.viewers:
            viewer.tell(text)

    def show(self, what: str, content: bytes) -> None:
        """Show everybody something of which only the newest counts."""
        self._newest[what] = content
        for viewer in self.viewers:
            viewer.show(what, content)

    def tell_seats(self) -> None:
        """Tell every viewer who has the controls."""
        holder = None if self.pilot is None else self.pilot.number
        for viewer in self.viewers:
            seat: dict[str, Any] = {
                "you": viewer.number,
                "pilot": holder,
                "viewers": len(self.viewers),
                "grant": viewer.granted if viewer is self.pilot else 0,
            }
            viewer.show("seats", messages.encode("seats", **seat))
