"""Limits of connections that have not sent the key.

A connection is a stranger until it has sent a request with the key or the cookie. Strangers are
limited in number and in time. When one too many connects, the oldest is closed, so that a user who
sends the key at once is always served. A handshake of TLS counts as part of the connection.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
import time
from collections import Counter
from collections.abc import MutableMapping
from dataclasses import dataclass
from typing import Any

from minorloop.page.auth import is_loopback

_ENTRY = "minorloop.listener"
_SWEEP = 0.5
"""Seconds between two checks of deadlines."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits of strangers."""

    strangers: int = 128
    """Number of strangers in all."""
    each: int = 32
    """Number from one address; this machine's own addresses may be those of a proxy, and have the
    common limit only."""
    header: float = 5.0
    """Seconds from a connection to the end of a request with the key."""


class Connection(socket.socket):
    """An accepted connection."""

    listener: Listener
    peer: tuple[Any, ...]
    deadline: float

    def drop(self) -> None:
        """Shut it down; its transport then reads an end and closes it."""
        self.listener.forget(self)
        with contextlib.suppress(OSError):
            self.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Close it; it is no stranger any more."""
        self.listener.forget(self)
        super().close()


class Listener(socket.socket):
    """A listening socket that keeps a list of its strangers, and takes a bound one over."""

    def __init__(self, listening: socket.socket, limits: Limits | None = None) -> None:
        super().__init__(fileno=listening.detach())
        self._limits = limits or Limits()
        self._strangers: dict[tuple[Any, ...], Connection] = {}  # the oldest first

    def accept(self) -> tuple[socket.socket, Any]:
        """Accept the next connection; one that is one too many closes the oldest stranger."""
        accepted, peer = super().accept()
        found = Connection(self.family, self.type, self.proto, fileno=accepted.detach())
        found.listener, found.peer = self, peer[:2]
        found.deadline = time.monotonic() + self._limits.header
        self._strangers[found.peer] = found
        self._make_room(found.peer[0])
        return found, peer

    def admit(self, peer: Any) -> None:
        """Count the connection from an address and a port as known: it has sent the key."""
        self._strangers.pop(tuple(peer or ())[:2], None)

    def forget(self, connection: Connection) -> None:
        """Remove a connection from the list; another one may have its address and port."""
        if self._strangers.get(connection.peer) is connection:
            del self._strangers[connection.peer]

    def sweep(self, now: float) -> None:
        """Drop the strangers past their deadline."""
        for connection in list(self._strangers.values()):
            if connection.deadline < now:
                connection.drop()

    async def sweeping(self) -> None:
        """Drop such strangers, forever."""
        while True:
            await asyncio.sleep(_SWEEP)
            self.sweep(time.monotonic())

    def _make_room(self, address: str) -> None:
        """Drop the oldest stranger of an address with too many, or of the address with most."""
        of_each = Counter(host for host, _ in self._strangers)
        if is_loopback(address) or of_each[address] <= self._limits.each:
            if len(self._strangers) <= self._limits.strangers:
                return
            address = max(of_each, key=lambda each: of_each[each])  # the oldest among equals
        next(each for each in self._strangers.values() if each.peer[0] == address).drop()


def mark(scope: MutableMapping[str, Any], listener: Listener) -> None:
    """Write the listener of a request into its scope."""
    scope[_ENTRY] = listener


def admit(scope: MutableMapping[str, Any]) -> None:
    """Lift the limits of the connection of a request with the key."""
    if _ENTRY in scope:  # another server may run the application
        scope[_ENTRY].admit(scope.get("client"))
