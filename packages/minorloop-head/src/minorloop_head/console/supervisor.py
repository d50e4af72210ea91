"""The supervisor: it starts the processes of the console, and restarts those that end or hang.

The processes have pipes to one another (`NewestPipe`); when one is restarted, the others get new
pipes to it. When the supervisor ends for any reason, each process ends by itself.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from multiprocessing import connection, resource_tracker
from multiprocessing.connection import Connection
from typing import Any, cast

from minorloop.page.process import BEGINNING, bind_to_parent, is_stopped
from minorloop_head.console.channel import NewestPipe

_CONTEXT = multiprocessing.get_context("spawn")
_POLL = 0.05
_SUSPENDED = 0.5
"""Least seconds between two checks that show a suspended machine instead of a hanging process."""
_LEAST_INTERVAL = 1.0
"""Seconds between two starts of the same process."""
_ENDING = 8.0
"""Seconds in which a process must end before it is killed."""
_TERMINAL = [
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGTSTP")
    if hasattr(signal, name)
]


@dataclass(frozen=True, kw_only=True)
class Part:
    """A process of the console."""

    name: str
    target: Callable[..., None]
    """Function that it runs, with a `ProcessHandle` and the arguments."""
    args: tuple[Any, ...] = ()
    patience: float = 1.0
    """Seconds without a heartbeat after which it counts as hanging."""


@dataclass(frozen=True, eq=False)
class ProcessHandle:
    """Connection of a process to its supervisor."""

    name: str
    """Name of the process."""
    names: tuple[str, ...]
    """Names of all processes."""
    control: socket.socket
    """Delivers new pipes, and ends with the supervisor."""
    beats: Any
    """Time of the last heartbeat of each process, on the monotonic clock; 0 before the first."""
    again: bool = False
    """Whether the process was restarted."""

    def begin(self, **channels: NewestPipe) -> threading.Event:
        """Start receiving pipes; return an event that is set when this process has to end."""
        for number in _TERMINAL:  # signals of the terminal are for the supervisor
            signal.signal(number, _nothing)
        if hasattr(signal, "pthread_sigmask"):
            signal.pthread_sigmask(signal.SIG_UNBLOCK, _TERMINAL)
        bind_to_parent(f"console-{self.name}", signal.SIGCONT)  # a stopped one continues, and ends
        stop = threading.Event()
        threading.Thread(target=self._receive_pipes, args=(channels, stop), daemon=True).start()
        return stop

    def beat(self) -> None:
        """Give a heartbeat."""
        self.beats[self.names.index(self.name)] = time.monotonic()

    def _receive_pipes(self, channels: Mapping[str, NewestPipe], stop: threading.Event) -> None:
        with contextlib.suppress(OSError):
            while True:
                number, handles, *_ = socket.recv_fds(self.control, 1, 1)
                if not number:
                    break
                channels[self.names[number[0]]].renew(Connection(handles[0]))
        stop.set()
        time.sleep(_ENDING)
        os._exit(1)


class _Running:
    """A started process."""

    def __init__(self, part: Part, names: tuple[str, ...], beats: Any, again: bool) -> None:
        self.part, self._beats, self._place = part, beats, names.index(part.name)
        beats[self._place] = 0.0
        self.control, theirs = socket.socketpair()
        handle = ProcessHandle(part.name, names, theirs, beats, again)
        self.process = _CONTEXT.Process(
            target=part.target, args=(handle, *part.args), name=part.name
        )
        self.began, self.killed = time.monotonic(), False
        self._not_stopped = self.began
        with theirs, _signals_blocked():
            self.process.start()

    def hangs(self, now: float) -> bool:
        """Return whether heartbeats are missing, or the process was stopped before the first."""
        beat = self._beats[self._place]
        if beat != 0.0:
            return bool(now - beat > self.part.patience)
        if not is_stopped(self.process.pid or 0):
            self._not_stopped = now
        return now - self._not_stopped > self.part.patience or now - self.began > BEGINNING

    def give(self, number: int, pipe: Connection) -> None:
        """Send a pipe to the process, and close it here."""
        with pipe, contextlib.suppress(OSError):  # a process that has just ended is restarted
            socket.send_fds(self.control, [bytes([number])], [pipe.fileno()])


class Supervisor:
    """Processes and the pipes between them.

    ``parts``: in the order of their start; ``pipes``: names of processes that have a pipe to each
    other; ``notify``: shows a sentence to the user.
    """

    def __init__(
        self,
        parts: Sequence[Part],
        pipes: Sequence[tuple[str, str]],
        *,
        notify: Callable[[str], None] = lambda sentence: None,
    ) -> None:
        self._parts, self._pipes, self._notify = parts, pipes, notify
        self._names = tuple(part.name for part in parts)
        self._beats = _CONTEXT.RawArray("d", len(parts))
        self._running: dict[str, _Running] = {}

    def start(self) -> None:
        """Start all processes."""
        resource_tracker.ensure_running()  # later, it would let signals through to a new process
        for part in self._parts:
            self._start(part)

    def run(self) -> None:
        """Supervise forever; an exception, such as Ctrl-C, ends it."""
        while True:
            self.check()

    def check(self) -> None:
        """Wait a moment, then restart processes that have ended, and kill those that hang.

        A process ends with status 0 because another one ended: the user is told only of the other.
        """
        before = time.monotonic()
        alive = {p.sentinel: p for p in (r.process for r in self._running.values()) if p.is_alive()}
        for ended in connection.wait(list(alive), timeout=_POLL):
            alive[cast(int, ended)].join(_POLL)  # its pipes are closed before it has ended
        now = time.monotonic()
        suspended = now - before > _SUSPENDED
        for name, running in list(self._running.items()):
            if running.process.is_alive():
                if not suspended and not running.killed and running.hangs(now):
                    self._notify(f"the {name} process hangs; it is killed and restarted")
                    running.killed = True
                    running.process.kill()
            elif now - running.began > _LEAST_INTERVAL:
                if not running.killed and running.process.exitcode != 0:
                    self._notify(f"the {name} process has ended; it is restarted")
                running.control.close()
                running.process.close()
                self._start(running.part)

    def pid(self, name: str) -> int:
        """Return the process id of a process by its name."""
        return self._running[name].process.pid or 0

    def end(self) -> None:
        """Request all processes to end, and kill those that do not."""
        for running in self._running.values():
            running.control.close()
        deadline = time.monotonic() + _ENDING
        for running in self._running.values():
            running.process.join(max(deadline - time.monotonic(), 0.0))
            if running.process.is_alive():
                running.process.kill()
                running.process.join()

    def _start(self, part: Part) -> None:
        again = part.name in self._running
        self._running[part.name] = _Running(part, self._names, self._beats, again)
        for pair in self._pipes:
            if part.name in pair and all(name in self._running for name in pair):
                ends = _CONTEXT.Pipe()
                for name, other, end in zip(pair, reversed(pair), ends, strict=True):
                    self._running[name].give(self._names.index(other), end)


def raise_priority() -> None:
    """Give this thread real-time priority, where the system allows it.

    A tick takes some milliseconds of forty, so that other programs still run.
    """
    with contextlib.suppress(OSError, AttributeError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))


@contextlib.contextmanager
def _signals_blocked() -> Iterator[None]:
    """Block signals of the terminal; a process started meanwhile unblocks them itself."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _TERMINAL)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _nothing(*_: object) -> None:
    """Do nothing with a signal; child processes inherit ignored signals, but not this handler."""
