"""Connections to the server: how many there may be before the key, and for how long.

A connection is a stranger's until a request with the key or the cookie has come over it. Strangers
are limited in number, in time, and in the share of a turn of the event loop that they get. When
one too many comes, the oldest is closed: who sends a request with the key at once gets in.
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

from minorloop.head.console.auth import is_loopback

_EXHAUSTED = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
_ENTRY = "minorloop.connection"
_SWEEP = 0.5


@dataclass(frozen=True, kw_only=True)
class Limits:
    """How much strangers may take.

    Parameters
    ----------
    strangers : int
        Connections before the key, of everybody together.
    each : int
        Of these, from one address; this machine's own addresses may be those of a proxy, and
        are limited together with all others only.
    header : float
        Seconds from a connection to the end of a request with the key.
    idle : float
        Seconds from an answer to the end of the next request.
    accepted, heard : int
        Connections that are accepted, and strangers that are heard, in a turn of the event loop.
        While fewer are accepted than heard, each is heard before it is one too many.
    spare : int
        Files of the process that connections leave to everything else.
    """

    strangers: int = 128
    each: int = 32
    header: float = 5.0
    idle: float = 10.0
    accepted: int = 4
    heard: int = 8
    spare: int = 256


class Connection(socket.socket):
    """A connection that was accepted."""

    listener: Listener
    peer: tuple[Any, ...]
    deadline: float | None
    order: tuple[int, int]
    dropped: bool = False

    @property
    def address(self) -> str:
        """Address of the other end."""
        return str(self.peer[0])

    def admit(self) -> None:
        """It is no stranger's: a request with the key has come."""
        self.listener.strangers.pop(self.fileno(), None)
        self.deadline = None

    def rest(self) -> None:
        """A request was answered; the next has to come soon."""
        if self.deadline is None:
            self.deadline = time.monotonic() + self.listener.limits.idle

    def drop(self) -> None:
        """End it: its transport reads an end, closes it, and sends what it still can."""
        self.dropped = True
        self.listener.strangers.pop(self.fileno(), None)
        with contextlib.suppress(OSError):
            self.shutdown(socket.SHUT_RDWR)

    def recv(self, *options: Any) -> bytes:
        """What came; nothing once it was dropped."""
        return b"" if self.dropped else super().recv(*options)

    def recv_into(self, *options: Any) -> int:
        """Number of bytes that came; none once it was dropped."""
        return 0 if self.dropped else super().recv_into(*options)

    def close(self) -> None:
        """Close it, and tell the listener."""
        self.listener.forget(self)
        super().close()


class Listener(socket.socket):
    """A socket that listens, and knows what was accepted and not yet closed.

    Parameters
    ----------
    listening : socket.socket
        A bound socket, which this one replaces.
    limits : Limits
    """

    def __init__(self, listening: socket.socket, limits: Limits | None = None) -> None:
        super().__init__(fileno=listening.detach())
        self.limits = limits or Limits()
        self.strangers: dict[int, Connection] = {}
        self._all: dict[tuple[Any, ...], Connection] = {}
        self._most = _most_files(self.limits.spare)
        self._turn, self._count = 0, 0
        self._reserve = os.open(os.devnull, os.O_RDONLY)

    def accept(self) -> tuple[socket.socket, Any]:
        """The next connection.

        Raises
        ------
        BlockingIOError
            If there is none, or others have to have their turn.
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
        raise BlockingIOError(errno.EAGAIN, "nobody else may come in this turn")

    def close(self) -> None:
        """Close it, and the file that it kept."""
        if self.fileno() >= 0:
            os.close(self._reserve)
        super().close()

    def forget(self, connection: Connection) -> None:
        """A connection is being closed."""
        self.strangers.pop(connection.fileno(), None)
        if self._all.get(connection.peer[:2]) is connection:
            del self._all[connection.peer[:2]]

    def of(self, peer: Any) -> Connection | None:
        """The connection from an address and a port."""
        return self._all.get(tuple(peer or ()))

    def sweep(self, now: float) -> None:
        """Drop the connections whose time is over."""
        for connection in list(self._all.values()):
            if connection.deadline is not None and connection.deadline < now:
                connection.drop()

    async def sweeping(self) -> None:
        """Sweep for ever."""
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
        """Drop the oldest stranger of an address that has too many, or of the one with most."""
        of_each = Counter(connection.address for connection in self.strangers.values())
        address = newest.address
        if is_loopback(address) or of_each[address] <= self.limits.each:
            if len(self.strangers) <= self.limits.strangers and len(self._all) <= self._most:
                return
            address = max(of_each, key=lambda each: of_each[each])  # the oldest among equals
        oldest = next(each for each in self.strangers.values() if each.address == address)
        oldest.drop()

    def _refuse(self) -> None:
        """Accept and close a connection at once, where no file is left for it."""
        os.close(self._reserve)
        try:
            with contextlib.suppress(OSError):
                super().accept()[0].close()
        finally:
            self._reserve = os.open(os.devnull, os.O_RDONLY)


class Selector(selectors.DefaultSelector):
    """Lets an event loop hear few strangers in a turn, after everybody else, and all in turn."""

    def __init__(self, listener: Listener) -> None:
        super().__init__()
        self._listener = listener
        self._turn = 0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """What is ready, without the strangers that have to wait."""
        ready, strangers = super().select(timeout), self._listener.strangers
        known = [each for each in ready if each[0].fd not in strangers]
        unknown = [each for each in ready if each[0].fd in strangers]
        unknown.sort(key=lambda each: strangers[each[0].fd].order)
        self._turn += 1
        for key, _ in unknown[: self._listener.limits.heard]:
            stranger = strangers[key.fd]
            stranger.order = (self._turn, stranger.order[1])
        return known + unknown[: self._listener.limits.heard]


def mark(scope: MutableMapping[str, Any], listener: Listener) -> None:
    """Write into the scope of a request which connection it came over."""
    scope[_ENTRY] = listener.of(scope.get("client"))


@contextlib.contextmanager
def admitted(scope: MutableMapping[str, Any]) -> Iterator[None]:
    """While a request with the key is answered, its connection has all the time it wants."""
    connection: Connection | None = scope.get(_ENTRY)
    if connection is None:  # the server is run by somebody else
        yield
        return
    connection.admit()
    try:
        yield
    finally:
        connection.rest()


def _most_files(spare: int) -> int:
    """Connections for which the process has files."""
    try:
        import resource
    except ImportError:  # there is no such limit
        return 1 << 16
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY:
        return 1 << 16
    return max(soft - spare, soft // 2)
