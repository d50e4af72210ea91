"""The control loop: a process of its own, 25 ticks a second, that never waits for anybody.

It does the tick and nothing else: pictures are made, looked at and packed by the eyes, which are
another process. What the loop hears comes in by threads, what it tells goes out by others; between
them and the tick there are places for the newest only, so that a page, a server, a camera or a
disk that stands still costs it nothing. When the server goes away, the loop holds, makes the plant
safe and ends.
"""

from __future__ import annotations

import contextlib
import gc
import os
import queue
import sys
import threading
import time
from collections import deque
from dataclasses import dataclass
from datetime import datetime
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import msgspec

from minorloop.errors import MinorloopError
from minorloop.teleop import messages
from minorloop.teleop.gaze import GazeMap
from minorloop.teleop.joystick import StickMap
from minorloop.teleop.modes import Seat
from minorloop.teleop.plant import View, head_of, open_plant
from minorloop.teleop.recording import PICTURE, TEXT, Recorder
from minorloop.teleop.session import Session
from minorloop.teleop.sight import Look, Seen, Wish

END = b"."
"""What is sent instead of an order to end the loop."""
PICTURED = b"p"
"""What stands before a picture that the eyes send to be recorded."""
_SLEEPS_LATE = 0.2
_COLLECT_EVERY = _TOLD_EVERY = 25
_MOST_UNWRITTEN = 20_000


@dataclass(frozen=True, kw_only=True)
class LoopSettings:
    """What the loop steers, and where it records.

    Parameters
    ----------
    address : str
    specimen : int, optional
    seed : int
    folder : str
        Of recordings.
    timeout : float
        Age in seconds of the operator's pose and page beyond which the head holds.
    """

    address: str = "twin:pipe"
    specimen: int | None = None
    seed: int = 0
    folder: str = "console"
    timeout: float = 0.1

    def seat(self) -> Seat:
        """The seat with that patience."""
        return Seat(gaze=GazeMap(timeout=self.timeout), stick=StickMap(timeout=self.timeout))


def run(pipe: Connection, eyes: Connection, settings: LoopSettings) -> None:
    """Run the loop until the server's end of its pipe goes away; for a process of its own.

    Parameters
    ----------
    pipe : Connection
        To the server.
    eyes : Connection
        To the eyes, whose first word is what they know of camera and probe.
    settings : LoopSettings
    """
    sys.setswitchinterval(1e-3)
    with contextlib.suppress(OSError, AttributeError):
        os.nice(-10)  # allowed to few; it helps where others use the same cores
    sight = _Apart(eyes)
    try:
        plant = open_plant(settings.address, specimen=settings.specimen, seed=settings.seed)
        control = head_of(settings.address, settings.specimen)
        view = sight.introduced()
        session = Session(plant, view, control, sight, settings.seat())
        for _ in range(25):  # compile what the first ticks would wait for
            session.tick(0.0)
    except (MinorloopError, ImportError, EOFError) as error:
        pipe.send_bytes(messages.encode("failed", text=str(error) or "the eyes did not start"))
        return
    sight.start()
    loop = _Loop(session, pipe, Path(settings.folder), settings.timeout)
    gc.collect()
    gc.freeze()
    gc.disable()  # what is left in circles is collected between two ticks
    try:
        loop.run()
    finally:
        plant.safe()
        loop.close()


def hurry() -> None:
    """Let this thread go before what else wants the cores, where the system allows it.

    The tick asks for some milliseconds of forty, so that nobody else starves.
    """
    with contextlib.suppress(OSError, AttributeError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))


class _Apart:
    """Eyes in another process, at the end of a pipe."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe
        self._there = threading.Condition()
        self._next: Look | None = None
        self._came: deque[Seen] = deque(maxlen=64)
        self.on_picture: Any = None
        self.keep = False

    def introduced(self) -> View:
        """What they know of camera and probe; waits until they say it."""
        return View.heard(msgspec.json.decode(self._pipe.recv_bytes()))

    def start(self) -> None:
        """Begin to talk."""
        for work in (self._speak, self._listen):
            threading.Thread(target=work, daemon=True).start()

    def look(self, look: Look) -> None:
        """Say where the head is; what was not sent yet is replaced, but for its wishes."""
        with self._there:
            if self._next is not None and self._next.wishes:
                wishes: list[Wish] = [*self._next.wishes, *look.wishes]
                look = msgspec.structs.replace(look, wishes=wishes)
            self._next = msgspec.structs.replace(look, keep=True) if self.keep else look
            self._there.notify()

    def seen(self) -> list[Seen]:
        """What came since the last call."""
        came = []
        while self._came:
            came.append(self._came.popleft())
        return came

    def _speak(self) -> None:
        encoder = msgspec.msgpack.Encoder()
        with contextlib.suppress(OSError):
            while True:
                with self._there:
                    self._there.wait_for(lambda: self._next is not None)
                    look, self._next = self._next, None
                self._pipe.send_bytes(encoder.encode(look))

    def _listen(self) -> None:
        decoder = msgspec.msgpack.Decoder(Seen)
        with contextlib.suppress(EOFError, OSError):
            while True:
                content = self._pipe.recv_bytes()
                if content[:1] == PICTURED:
                    if self.on_picture is not None:
                        self.on_picture(content[1:])
                else:
                    self._came.append(decoder.decode(content))


class _Loop:
    """The tick and the threads around it."""

    def __init__(
        self, session: Session, pipe: Connection, folder: Path, patience: float = 0.0
    ) -> None:
        self._session, self._pipe, self._folder = session, pipe, folder
        self._patience = max(_SLEEPS_LATE, patience)
        self._inbox: deque[tuple[float, Any]] = deque(maxlen=256)
        self._outbox = _Outbox()
        self._gone = threading.Event()
        self._recorder: Recorder | None = None
        session.sight.on_picture = self._keep_picture  # type: ignore[attr-defined]
        self._unwritten: queue.Queue[tuple[int, float, bytes] | None] = queue.Queue()
        self._threads = [
            threading.Thread(target=work, daemon=True)
            for work in (self._listen, self._send, self._write)
        ]

    def run(self) -> None:
        """Tick until the server is gone."""
        session, interval = self._session, self._session.interval
        self._outbox.event(session.introduction())
        for thread in self._threads:
            thread.start()
        hurry()
        due = time.monotonic()
        while not self._gone.is_set():
            late = time.monotonic() - due
            if late > self._patience:  # the process or the machine stood still
                session.hold("the control loop stood still for a while; press a mode to go on")
            if late > interval:  # ticks that were missed are not made up for
                due += late
            self._tick(due, late)
            due += interval
            if session.ticks % _COLLECT_EVERY == 0:
                gc.collect(0)
            time.sleep(max(due - time.monotonic(), 0.0))

    def _tick(self, due: float, late: float) -> None:
        session = self._session
        while self._inbox:
            at, message = self._inbox.popleft()
            if isinstance(message, messages.Record):
                self._record(message.on)
            else:
                session.hear(message, at)
                if isinstance(message, messages.Release):
                    self._record(False)  # nobody is there to end it
        now = time.monotonic()
        session.tick(now)
        state = session.report(now, late=late)
        for event in session.events:
            self._outbox.event(event)
            self._keep(TEXT, now, event)
        session.events.clear()
        self._keep(TEXT, now, state)
        self._outbox.newest(state)
        if session.ticks % _TOLD_EVERY == 0:
            self._tell_recording()

    def _record(self, on: bool) -> None:
        """Begin or end a recording."""
        if on == (self._recorder is not None):
            return
        if on:
            name = datetime.now().strftime("%Y-%m-%d-%H%M%S")
            try:
                self._recorder = Recorder(self._folder, name)
            except OSError as error:
                self._session.notice(f"nothing is recorded: {error}")
                return
            self._session.sight.keep = True  # type: ignore[attr-defined]
            now = time.monotonic()
            self._keep(TEXT, now, self._session.introduction())
            self._session.tell_findings()
            self._tell_recording()
        else:
            self._end_recording()
            self._outbox.event(messages.encode("recording", name=None))

    def _tell_recording(self) -> None:
        recorder = self._recorder
        if recorder is None:
            return
        told = {"name": recorder.path.stem, "size": recorder.size}
        seconds = round(time.monotonic() - recorder.began, 1)
        self._outbox.event(messages.encode("recording", **told, seconds=seconds))

    def _end_recording(self) -> None:
        self._session.sight.keep = False  # type: ignore[attr-defined]
        self._unwritten.put(None)
        self._unwritten.join()
        self._recorder = None

    def _keep_picture(self, content: bytes) -> None:
        """Record a picture; called by the thread that hears the eyes."""
        self._keep(PICTURE, messages.HEADER.unpack_from(content)[2], content)

    def _keep(self, kind: int, t: float, content: bytes) -> None:
        if self._recorder is not None:
            if self._unwritten.qsize() > _MOST_UNWRITTEN:
                self._session.notice("the disk is too slow; recording ended")
                self._recorder = None
                return
            self._unwritten.put((kind, t, content))

    def _listen(self) -> None:
        """Take in what the server says; for a thread of its own."""
        decoder = msgspec.msgpack.Decoder(messages.Inner)
        with contextlib.suppress(EOFError, OSError):
            while (content := self._pipe.recv_bytes()) != END:
                message = decoder.decode(content)
                self._inbox.append((time.monotonic(), message))
        self._gone.set()

    def _send(self) -> None:
        """Tell the server the newest; for a thread of its own."""
        with contextlib.suppress(OSError):
            while not self._gone.is_set():
                events, state = self._outbox.wait()
                for event in events:
                    self._pipe.send_bytes(event)
                if state is not None:
                    self._pipe.send_bytes(state)
        self._gone.set()

    def _write(self) -> None:
        """Write the recording; for a thread of its own."""
        while True:
            entry = self._unwritten.get()
            recorder = self._recorder
            try:
                if recorder is not None:
                    recorder.close() if entry is None else recorder.write(*entry)
            except OSError as error:
                self._session.notice(f"recording ended: {error}")
                self._recorder = None
            finally:
                self._unwritten.task_done()

    def close(self) -> None:
        """Write what is left to write."""
        if self._recorder is not None:
            self._end_recording()


class _Outbox:
    """What goes to the server: every event, and of states the newest."""

    def __init__(self) -> None:
        self._there = threading.Condition()
        self._events: deque[bytes] = deque(maxlen=1000)
        self._state: bytes | None = None

    def event(self, text: bytes) -> None:
        with self._there:
            self._events.append(text)
            self._there.notify()

    def newest(self, state: bytes) -> None:
        with self._there:
            self._state = state
            self._there.notify()

    def wait(self) -> tuple[list[bytes], bytes | None]:
        with self._there:
            self._there.wait_for(lambda: self._events or self._state, timeout=0.5)
            taken = list(self._events), self._state
            self._events.clear()
            self._state = None
            return taken
