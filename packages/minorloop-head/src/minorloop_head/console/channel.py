"""Pipes between processes that are restarted when they end."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterator
from multiprocessing.connection import Connection


class NewestPipe:
    """The newest pipe to another process; a thread replaces it when that process restarts.

    ``pipe``: the first one.
    """

    def __init__(self, pipe: Connection | None = None) -> None:
        self._changed = threading.Condition()
        self._pipe = pipe

    def renew(self, pipe: Connection) -> None:
        """Use another pipe from now on."""
        with self._changed:
            self._pipe = pipe
            self._changed.notify_all()

    def next(
        self, last: Connection | None = None, timeout: float | None = None
    ) -> Connection | None:
        """Wait for a pipe newer than the last one, and return it; None if that takes too long."""
        with self._changed:
            if self._changed.wait_for(lambda: self._pipe is not last, timeout):
                return self._pipe
            return None

    def pipes(self) -> Iterator[Connection]:
        """Yield each new pipe, for a thread that reads each until it ends."""
        last = None
        while True:
            last = self.next(last)
            if last is not None:
                yield last

    def send(self, content: bytes) -> bool:
        """Send bytes; return False if there is no process to receive them."""
        pipe = self._pipe
        if pipe is None:
            return False
        try:
            pipe.send_bytes(content)
        except OSError:
            return False
        return True


class Outbox:
    """Messages that a thread sends: all events, and the newest state."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._events: deque[bytes] = deque(maxlen=1000)
        self._state: bytes | None = None

    def event(self, text: bytes) -> None:
        """Add a message that must not be lost."""
        with self._changed:
            self._events.append(text)
            self._changed.notify()

    def newest(self, state: bytes) -> None:
        """Replace the state; only the newest is sent."""
        with self._changed:
            self._state = state
            self._changed.notify()

    def wait(self) -> tuple[list[bytes], bytes | None]:
        """Wait up to half a second for messages; return events and state."""
        with self._changed:
            self._changed.wait_for(lambda: self._events or self._state, timeout=0.5)
            taken = list(self._events), self._state
            self._events.clear()
            self._state = None
            return taken

    def forward(self, channel: NewestPipe) -> None:
        """Send messages forever, in a separate thread."""
        while True:
            events, state = self.wait()
            for content in events:
                channel.send(content)
            if state is not None:
                channel.send(state)
