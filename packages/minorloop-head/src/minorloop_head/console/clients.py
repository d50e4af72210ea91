"""Connected pages: one pilot and any number of viewers, and the messages to each of them.

Each viewer keeps the newest state, image and map, and a short queue of messages that must not be
lost. A slow page misses pictures; it delays no other page and uses no more memory.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from dataclasses import dataclass, field

from minorloop.errors import SignalError
from minorloop_head.console import messages

SILENCE = 3.0
"""Seconds without a message of the pilot after which the pilot loses the controls."""
_MOST_WAITING = 200
"""Largest number of messages in a queue; it drops the oldest ones."""
_MOST_A_SECOND, _BURST = 250, 500
"""Most messages of a page per second, and at once; the console's own page sends 50 per second."""


class HostileMessageError(SignalError):
    """A message that the console's own pages never send; its connection is closed with it."""


@dataclass(eq=False)
class Viewer:
    """A connected page."""

    number: int
    """Its name to the others."""
    seq: int = -1
    t: float = -1.0
    granted: int = 0
    last_message: float = 0.0
    allowance: float = float(_BURST)
    _texts: deque[bytes] = field(default_factory=lambda: deque(maxlen=_MOST_WAITING))
    _newest: dict[str, bytes] = field(default_factory=dict)
    _changed: asyncio.Event = field(default_factory=asyncio.Event)

    def send(self, text: bytes) -> None:
        """Queue a message that must not be lost."""
        self._texts.append(text)
        self._changed.set()

    def send_newest(self, what: str, content: bytes) -> None:
        """Queue a message of which only the newest counts."""
        self._newest[what] = content
        self._changed.set()

    async def outgoing(self) -> list[bytes]:
        """Wait for messages, and return them."""
        await self._changed.wait()
        self._changed.clear()
        out = [*self._texts, *self._newest.values()]
        self._texts.clear()
        self._newest.clear()
        return out

    def check(self, message: messages.Message, now: float) -> None:
        """Refuse a message that is out of order, or beyond the allowed rate.

        Raises a `HostileMessageError` with a sentence for the page.
        """
        since = now - self.last_message
        self.allowance = min(self.allowance + _MOST_A_SECOND * since, _BURST) - 1.0
        self.last_message = now
        if self.allowance < 0:
            raise HostileMessageError(f"more than {_MOST_A_SECOND} messages a second came")
        if message.seq <= self.seq or message.t < self.t:
            raise HostileMessageError(
                f"message {message.seq} at {message.t:g} s came after message {self.seq} at "
                f"{self.t:g} s; numbers must rise and time must not go back"
            )
        self.seq, self.t = message.seq, message.t


class Clients:
    """All viewers, one of whom may have the controls.

    ``silence``: seconds without a message of the pilot after which the pilot loses the controls.
    """

    def __init__(self, *, silence: float = SILENCE) -> None:
        self._silence = silence
        self.viewers: set[Viewer] = set()
        self.pilot: Viewer | None = None
        self.grant = 0
        self.hello: bytes | None = None
        self.findings = messages.encode(messages.FindingList(findings=[]))
        self.recording = messages.encode(messages.RecordingStatus(name=None))
        self.failed: bytes | None = None
        self.swept: bytes | None = None
        self._count = 0
        self._newest: dict[str, bytes] = {}

    def join(self) -> Viewer:
        """Return a new viewer, to whom the present state is sent."""
        self._count += 1
        viewer = Viewer(self._count)
        viewer.last_message = time.monotonic()
        self.viewers.add(viewer)
        known = (self.failed, self.hello, self.findings, self.recording, self.swept)
        for text in known:
            if text is not None:
                viewer.send(text)
        for what, content in self._newest.items():
            viewer.send_newest(what, content)
        self.send_controls()
        return viewer

    def leave(self, viewer: Viewer) -> bool:
        """Remove a viewer; return whether it was the pilot."""
        self.viewers.discard(viewer)
        was_pilot = viewer is self.pilot
        if was_pilot:
            self.pilot = None
        self.send_controls()
        return was_pilot

    def take(self, viewer: Viewer) -> bool:
        """Give free controls to a viewer; return whether the viewer did not have them before."""
        if self.pilot is not None and self.pilot is not viewer:
            sentence = f"viewer {self.pilot.number} has the controls; ask for their release"
            viewer.send(messages.encode(messages.Notice(text=sentence)))
            return False
        fresh = self.pilot is None
        if fresh:
            self.grant += 1
            self.pilot, viewer.granted = viewer, self.grant
        self.send_controls()
        return fresh

    def free(self) -> None:
        """Take the controls back."""
        self.pilot = None
        self.send_controls()

    def may(self, viewer: Viewer, order: messages.Order) -> bool:
        """Return whether an order is valid; an order with an earlier grant of the viewer is not.

        Raises a `HostileMessageError` if the viewer never had the controls with this grant.
        """
        if viewer is self.pilot and order.grant == viewer.granted:
            return True
        if 0 < order.grant <= viewer.granted:
            return False
        raise HostileMessageError("only the pilot steers; take the controls first")

    def is_pilot_silent(self, now: float) -> bool:
        """Return whether the pilot's page has sent nothing for too long."""
        return self.pilot is not None and now - self.pilot.last_message > self._silence

    def send(self, text: bytes) -> None:
        """Send everybody a message that must not be lost."""
        for viewer in self.viewers:
            viewer.send(text)

    def send_newest(self, what: str, content: bytes) -> None:
        """Send everybody a message of which only the newest counts."""
        self._newest[what] = content
        for viewer in self.viewers:
            viewer.send_newest(what, content)

    def send_controls(self) -> None:
        """Send every viewer who has the controls."""
        holder = None if self.pilot is None else self.pilot.number
        for viewer in self.viewers:
            controls = messages.Controls(
                you=viewer.number,
                pilot=holder,
                viewers=len(self.viewers),
                grant=viewer.granted if viewer is self.pilot else 0,
            )
            viewer.send_newest("controls", messages.encode(controls))
