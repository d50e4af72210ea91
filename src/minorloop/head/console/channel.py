"""Pipes between processes that are started anew when they end."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterator
from multiprocessing.connection import Connection


class NewestPipe:
    """The newest pipe to another process; a thread puts another in its place.

    Parameters
    ----------
    pipe : Connection, optional
        The first one.
    """

    def __init__(self, pipe: Connection | None = None) -> None:
        self._there = threading.Condition()
        self._pipe = pipe

    def renew(self, pipe: Connection) -> None:
        """Use another pipe from now on."""
        with self._there:
            self._pipe = pipe
            self._there.notify_all()

    def next(
        self, last: Connection | None = None, timeout: float | None = None
    ) -> Connection | None:
        """The newest pipe if it is not the last one; None where there is none in time."""
        with self._there:
            if self._there.wait_for(lambda: self._pipe is not last, timeout):
                return self._pipe
            return None

    def pipes(self) -> Iterator[Connection]:
        """Each pipe as it comes, for a thread that reads one until it ends."""
        last = None
        while True:
            last = self.next(last)
            if last is not None:
                yield last

    def send(self, content: bytes) -> bool:
        """Send bytes; False where nobody is there to get them."""
        pipe = self._pipe
        if pipe is None:
            return False
        try:
            pipe.send_bytes(content)
        except OSError:
            return False
        return True


class Outbox:
    """What a thread is to send: every event, and of states the newest."""

    def __init__(self) -> None:
        self._there = threading.Condition()
        self._events: deque[bytes] = deque(maxlen=1000)
        self._state: bytes | None = None

    def event(self, text: bytes) -> None:
        """Something that must not be lost."""
        with self._there:
            self._events.append(text)
            self._there.notify()

    def newest(self, state: bytes) -> None:
        """Something of which only the newest counts."""
        with self._there:
            self._state = state
            self._there.notify()

    def wait(self) -> tuple[list[bytes], bytes | None]:
        """What is to be sent; waits up to half a second for it."""
        with self._there:
            self._there.wait_for(lambda: self._events or self._state, timeout=0.5)
            taken = list(self._events), self._state
            self._events.clear()
            self._state = None
            return taken

    def forward(self, channel: NewestPipe) -> None:
        """Send for ever; for a thread of its own."""
        while True:
            events, state = self.wait()
            for content in events:
                channel.send(content)
            if state is not None:
                channel.send(state)
