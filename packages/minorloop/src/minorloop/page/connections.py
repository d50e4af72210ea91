"""Limits of connections that have not sent the key.

A connection is a stranger until it has sent a request with the key or the cookie. Strangers are
limited in number, in time, and in their share of each turn of the event loop. When one too many
connects, the oldest is closed, so that a user who sends the key at once is always served.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import selectors
import socket
import time
from collections import Counter
from collections.abc import Iterator, MutableMapping
from dataclasses import dataclass
from typing import Any

from minorloop.page.auth import is_loopback

_EXHAUSTED = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
_ENTRY = "minorloop.connection"
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
    idle: float = 10.0
    """Seconds from an answer to the end of the next request."""
    accepted: int = 4
    served: int = 8
    """Connections that are accepted, and strangers that are read from, in a turn of the event loop.
    If fewer are accepted than read, each is read before it is one too many."""
    spare: int = 256
    """Open files of the process that connections leave to everything else."""


class Connection(socket.socket):
    """An accepted connection."""

    listener: Listener
    peer: tuple[Any, ...]
    deadline: float | None
    order: tuple[int, int]
    dropped: bool = False

    @property
    def address(self) -> str:
        """Address of the client."""
        return str(self.peer[0])

    def admit(self) -> None:
        """Count it as known: it has sent a request with the key."""
        self.listener.strangers.pop(self.fileno(), None)
        self.deadline = None

    def rest(self) -> None:
        """Limit the time to the next request, after one was answered."""
        if self.deadline is None:
            self.deadline = time.monotonic() + self.listener.limits.idle

    def drop(self) -> None:
        """Shut it down; its transport then reads an end and closes it."""
        self.dropped = True
        self.listener.strangers.pop(self.fileno(), None)
        with contextlib.suppress(OSError):
            self.shutdown(socket.SHUT_RDWR)

    def recv(self, *options: Any) -> bytes:
        """Return received bytes; none once it was dropped."""
        return b"" if self.dropped else super().recv(*options)

    def recv_into(self, *options: Any) -> int:
        """Return the number of received bytes; 0 once it was dropped."""
        return 0 if self.dropped else super().recv_into(*options)

    def close(self) -> None:
        """Close it, and remove it from the listener."""
        self.listener.forget(self)
        super().close()


class Listener(socket.socket):
    """A listening socket that keeps a list of its open connections, and takes a bound one over."""

    def __init__(self, listening: socket.socket, limits: Limits | None = None) -> None:
        super().__init__(fileno=listening.detach())
        self.limits = limits or Limits()
        self.strangers: dict[int, Connection] = {}
        self._all: dict[tuple[Any, ...], Connection] = {}
        self._most = _most_files(self.limits.spare)
        self._turn, self._count = 0, 0
        self._reserve = os.open(os.devnull, os.O_RDONLY)

    def accept(self) -> tuple[socket.socket, Any]:
        """Accept the next connection.

        Raises a BlockingIOError if there is none, or enough were accepted in this turn.
        """
        while self._turn < self.limits.accepted:
            self._turn += 1
            try:
                accepted, peer = super().accept()
            except BlockingIOError:
                break
            except OSError as error:
                if error.errno not in _EXHAUSTED:
                    raise
                self._refuse()
                continue
            return self._taken(accepted.detach(), peer), peer
        self._turn = 0
        raise BlockingIOError(errno.EAGAIN, "enough connections were accepted in this turn")

    def close(self) -> None:
        """Close it, and its reserved file."""
        if self.fileno() >= 0:
            os.close(self._reserve)
        super().close()

    def forget(self, connection: Connection) -> None:
        """Remove a connection from the list."""
        self.strangers.pop(connection.fileno(), None)
        if self._all.get(connection.peer[:2]) is connection:
            del self._all[connection.peer[:2]]

    def of(self, peer: Any) -> Connection | None:
        """Return the connection from an address and a port."""
        return self._all.get(tuple(peer or ()))

    def sweep(self, now: float) -> None:
        """Drop the connections past their deadline."""
        for connection in list(self._all.values()):
            if connection.deadline is not None and connection.deadline < now:
                connection.drop()

    async def sweeping(self) -> None:
        """Drop such connections, forever."""
        while True:
            await asyncio.sleep(_SWEEP)
            self.sweep(time.monotonic())

    def _taken(self, number: int, peer: Any) -> Connection:
        connection = Connection(self.family, self.type, self.proto, fileno=number)
        connection.listener, connection.peer = self, peer
        connection.deadline = time.monotonic() + self.limits.header
        self._count += 1
        connection.order = (0, self._count)
        self._all[peer[:2]] = connection
        self.strangers[number] = connection
        self._make_room(connection)
        return connection

    def _make_room(self, newest: Connection) -> None:
        """Drop the oldest stranger of an address with too many, or of the address with most."""
        of_each = Counter(connection.address for connection in self.strangers.values())
        address = newest.address
        if is_loopback(address) or of_each[address] <= self.limits.each:
            if len(self.strangers) <= self.limits.strangers and len(self._all) <= self._most:
                return
            address = max(of_each, key=lambda each: of_each[each])  # the oldest among equals
        oldest = next(each for each in self.strangers.values() if each.address == address)
        oldest.drop()

    def _refuse(self) -> None:
        """Accept and close a connection for which the process has no file left."""
        os.close(self._reserve)
        try:
            with contextlib.suppress(OSError):
                super().accept()[0].close()
        finally:
            self._reserve = os.open(os.devnull, os.O_RDONLY)


class Selector(selectors.DefaultSelector):
    """Selector that returns few strangers in a turn, after all other sockets, and all in time."""

    def __init__(self, listener: Listener) -> None:
        super().__init__()
        self._listener = listener
        self._turn = 0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Return the sockets that are ready, without strangers that have to wait."""
        ready, strangers = super().select(timeout), self._listener.strangers
        known = [each for each in ready if each[0].fd not in strangers]
        unknown = [each for each in ready if each[0].fd in strangers]
        unknown.sort(key=lambda each: strangers[each[0].fd].order)
        self._turn += 1
        for key, _ in unknown[: self._listener.limits.served]:
            stranger = strangers[key.fd]
            stranger.order = (self._turn, stranger.order[1])
        return known + unknown[: self._listener.limits.served]


def mark(scope: MutableMapping[str, Any], listener: Listener) -> None:
    """Write the connection of a request into its scope."""
    scope[_ENTRY] = listener.of(scope.get("client"))


@contextlib.contextmanager
def admitted(scope: MutableMapping[str, Any]) -> Iterator[None]:
    """Lift the limits of a connection while its request with the key is answered."""
    connection: Connection | None = scope.get(_ENTRY)
    if connection is None:  # another server runs the application
        yield
        return
    connection.admit()
    try:
        yield
    finally:
        connection.rest()


def _most_files(spare: int) -> int:
    """Return how many connections the process has files for."""
    try:
        import resource
    except ImportError:  # no such limit on this system
        return 1 << 16
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY:
        return 1 << 16
    return max(soft - spare, soft // 2)
