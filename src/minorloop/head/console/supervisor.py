"""The command's own process: it starts the others, and starts anew what ended or stands still.

It does nothing else and waits for nobody. The processes have pipes to one another
(`NewestPipe`); when one is started anew, the others get new pipes to it. When the supervisor
ends, however it ends, each of them notices and ends by itself.
"""

from __future__ import annotations

import contextlib
import ctypes
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

from minorloop.head.console.channel import NewestPipe

_CONTEXT = multiprocessing.get_context("spawn")
_LOOK_EVERY = 0.05
_ASLEEP = 0.5
"""Seconds after which it was the machine that stood still, and not a process."""
_BEGINNING = 180.0
"""Seconds within which a process has to begin, on a machine that is busy with others."""
_LEAST_LIFE = 1.0
"""Seconds between two starts of the same process."""
_ENDING = 8.0
_TERMINAL = [
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGTSTP")
    if hasattr(signal, name)
]
_SET_DEATH_SIGNAL, _SET_NAME = 1, 15


@dataclass(frozen=True, kw_only=True)
class Part:
    """A process of the console.

    Parameters
    ----------
    name : str
    target : callable
        What it runs; gets a `ProcessHandle` and the arguments.
    args : tuple
    patience : float
        Seconds without a sign of life after which it counts as standing still.
    """

    name: str
    target: Callable[..., None]
    args: tuple[Any, ...] = ()
    patience: float = 1.0


@dataclass(frozen=True, eq=False)
class ProcessHandle:
    """What a process has of its supervisor.

    Parameters
    ----------
    name : str
        Of the process.
    names : tuple of str
        Of all of them.
    control : socket
        Brings new pipes, and ends with the supervisor.
    beats : array of float
        When each process gave its last sign of life, on the monotonic clock; 0 before the first.
    again : bool
        Whether another process of this name ended before.
    """

    name: str
    names: tuple[str, ...]
    control: socket.socket
    beats: Any
    again: bool = False

    def begin(self, **channels: NewestPipe) -> threading.Event:
        """Take in new pipes from now on; gives what is set when this process is to end."""
        for number in _TERMINAL:  # what a terminal sends to all is for the supervisor
            signal.signal(number, _nothing)
        if hasattr(signal, "pthread_sigmask"):
            signal.pthread_sigmask(signal.SIG_UNBLOCK, _TERMINAL)
        tie(f"console-{self.name}", signal.SIGCONT)  # one that is stopped goes on, and ends
        over = threading.Event()
        threading.Thread(target=self._listen, args=(channels, over), daemon=True).start()
        return over

    def beat(self) -> None:
        """Give a sign of life."""
        self.beats[self.names.index(self.name)] = time.monotonic()

    def _listen(self, channels: Mapping[str, NewestPipe], over: threading.Event) -> None:
        with contextlib.suppress(OSError):
            while True:
                number, handles, *_ = socket.recv_fds(self.control, 1, 1)
                if not number:
                    break
                channels[self.names[number[0]]].renew(Connection(handles[0]))
        over.set()
        time.sleep(_ENDING)
        os._exit(1)


class _Running:
    """A process that was started."""

    def __init__(self, part: Part, names: tuple[str, ...], beats: Any, again: bool) -> None:
        self.part, self._beats, self._place = part, beats, names.index(part.name)
        beats[self._place] = 0.0
        self.control, theirs = socket.socketpair()
        post = ProcessHandle(part.name, names, theirs, beats, again)
        self.process = _CONTEXT.Process(target=part.target, args=(post, *part.args), name=part.name)
        self.began, self.killed = time.monotonic(), False
        self._moved = self.began
        with theirs, _held_back():
            self.process.start()

    def stands_still(self, now: float) -> bool:
        """Whether it has given no sign of life for too long, or was stopped before the first."""
        beat = self._beats[self._place]
        if beat != 0.0:
            return bool(now - beat > self.part.patience)
        if not _is_stopped(self.process.pid or 0):
            self._moved = now
        return now - self._moved > self.part.patience or now - self.began > _BEGINNING

    def give(self, number: int, pipe: Connection) -> None:
        """Hand a pipe over; it is closed here."""
        with pipe, contextlib.suppress(OSError):  # one that has just ended is started anew
            socket.send_fds(self.control, [bytes([number])], [pipe.fileno()])


class Supervisor:
    """Some processes, and the pipes between them.

    Parameters
    ----------
    parts : sequence of Part
        In the order in which they are started.
    pipes : sequence of (str, str)
        Which of them talk to each other.
    said : callable, optional
        What to do with a sentence for who started the console.
    """

    def __init__(
        self,
        parts: Sequence[Part],
        pipes: Sequence[tuple[str, str]],
        *,
        said: Callable[[str], None] = lambda sentence: None,
    ) -> None:
        self._parts, self._pipes, self._said = parts, pipes, said
        self._names = tuple(part.name for part in parts)
        self._beats = _CONTEXT.RawArray("d", len(parts))
        self._running: dict[str, _Running] = {}

    def start(self) -> None:
        """Start all of them."""
        resource_tracker.ensure_running()  # later, it would let signals through to a new process
        for part in self._parts:
            self._start(part)

    def run(self) -> None:
        """Look after them for ever; an exception, such as Ctrl-C, ends it."""
        while True:
            self.look_after()

    def look_after(self) -> None:
        """Wait a moment, then start anew what has ended, and end what stands still."""
        before = time.monotonic()
        alive = {p.sentinel: p for p in (r.process for r in self._running.values()) if p.is_alive()}
        for ended in connection.wait(list(alive), timeout=_LOOK_EVERY):
            alive[cast(int, ended)].join(_LOOK_EVERY)  # its pipes are closed before it has ended
        now = time.monotonic()
        asleep = now - before > _ASLEEP
        for name, running in list(self._running.items()):
            if running.process.is_alive():
                if not asleep and not running.killed and running.stands_still(now):
                    self._said(f"the {name} process stands still; it is ended and started anew")
                    running.killed = True
                    running.process.kill()
            elif now - running.began > _LEAST_LIFE:
                if not running.killed:
                    self._said(f"the {name} process has ended; it is started anew")
                running.control.close()
                running.process.close()
                self._start(running.part)

    def pid(self, name: str) -> int:
        """Number of the process of that name."""
        return self._running[name].process.pid or 0

    def end(self) -> None:
        """Let all of them end, and end those that do not."""
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


def tie(name: str, death: int) -> None:
    """Name this process, and have it get a signal when its parent ends; where Linux allows it."""
    with contextlib.suppress(OSError, AttributeError):
        system = ctypes.CDLL(None)
        system.prctl(_SET_NAME, name.encode()[:15], 0, 0, 0)
        system.prctl(_SET_DEATH_SIGNAL, death, 0, 0, 0)


def hurry() -> None:
    """Let this thread go before what else wants the cores, where the system allows it.

    A tick asks for some milliseconds of forty, so that nobody else starves.
    """
    with contextlib.suppress(OSError, AttributeError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))


def _is_stopped(child: int) -> bool:
    """Whether a signal stopped a child; False where the system does not tell."""
    if not hasattr(os, "waitid"):
        return False
    with contextlib.suppress(ChildProcessError):
        return os.waitid(os.P_PID, child, os.WSTOPPED | os.WNOHANG | os.WNOWAIT) is not None
    return False


@contextlib.contextmanager
def _held_back() -> Iterator[None]:
    """Signals of a terminal wait, in a process that is started meanwhile until it is ready."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _TERMINAL)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _nothing(*_: object) -> None:
    """Stand in for what a signal does; unlike one that is ignored, it is not handed on."""
