"""Limits of unauthenticated connections.

A connection is unauthenticated until it has sent a request with the key or the cookie. The number
and the time of these connections are limited. If there is one too many, the oldest is closed. So a
user who sends the key immediately is always served. A handshake of TLS counts as part of the
connection.
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
    """Limits of unauthenticated connections."""

    unauthenticated: int = 128
    """Most unauthenticated connections."""
    each: int = 32
    """Most unauthenticated connections from one address. Addresses of this machine may be those of
    a proxy, so only the common limit applies to them."""
    header: float = 5.0
    """Seconds from a connection to the end of a request with the key."""


class Connection(socket.socket):
    """An accepted connection."""

    listener: Listener
    peer: tuple[Any, ...]
    deadline: float

    def drop(self) -> None:
        """Shut the connection down; its transport then reads an end and closes it."""
        self.listener.forget(self)
        with contextlib.suppress(OSError):
            self.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Close the connection, and remove it from the list."""
        self.listener.forget(self)
        super().close()


class Listener(socket.socket):
    """A listening socket, from a bound one, with a list of its unauthenticated connections."""

    def __init__(self, listening: socket.socket, limits: Limits | None = None) -> None:
        super().__init__(fileno=listening.detach())
        self._limits = limits or Limits()
        self._unauthenticated: dict[tuple[Any, ...], Connection] = {}  # the oldest first

    def accept(self) -> tuple[socket.socket, Any]:
        """Accept the next connection; with too many, close the oldest unauthenticated one."""
        accepted, peer = super().accept()
        found = Connection(self.family, self.type, self.proto, fileno=accepted.detach())
        found.listener, found.peer = self, peer[:2]
        found.deadline = time.monotonic() + self._limits.header
        self._unauthenticated[found.peer] = found
        self._make_room(found.peer[0])
        return found, peer

    def admit(self, peer: Any) -> None:
        """Mark the connection from an address and a port as authenticated."""
        self._unauthenticated.pop(tuple(peer or ())[:2], None)

    def forget(self, connection: Connection) -> None:
        """Remove a connection from the list; another connection may have its address and port."""
        if self._unauthenticated.get(connection.peer) is connection:
            del self._unauthenticated[connection.peer]

    def sweep(self, now: float) -> None:
        """Drop the unauthenticated connections past their deadline."""
        for connection in list(self._unauthenticated.values()):
            if connection.deadline < now:
                connection.drop()

    async def sweeping(self) -> None:
        """Drop such connections, without end."""
        while True:
            await asyncio.sleep(_SWEEP)
            self.sweep(time.monotonic())

    def _make_room(self, address: str) -> None:
        """Drop the oldest unauthenticated connection of an address with too many or with most."""
        of_each = Counter(host for host, _ in self._unauthenticated)
        if is_loopback(address) or of_each[address] <= self._limits.each:
            if len(self._unauthenticated) <= self._limits.unauthenticated:
                return
            address = max(of_each, key=lambda each: of_each[each])  # the oldest among equals
        next(each for each in self._unauthenticated.values() if each.peer[0] == address).drop()


def mark(scope: MutableMapping[str, Any], listener: Listener) -> None:
    """Write the listener of a request into its scope."""
    scope[_ENTRY] = listener


def admit(scope: MutableMapping[str, Any]) -> None:
    """Lift the limits of the connection of a request with the key."""
    if _ENTRY in scope:  # another server may run the application
        scope[_ENTRY].admit(scope.get("client"))
