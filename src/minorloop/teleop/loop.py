"""The control loop: a process of its own, 25 ticks a second, that never waits for anybody.

What it hears comes in by one thread, what it tells goes out by others; between them and the tick
there are places for the newest only, so that a page, a server or a disk that stands still costs
it nothing. When the server goes away, the loop holds, makes the plant safe and ends.
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
from minorloop.teleop.imaging import opencv
from minorloop.teleop.joystick import StickMap
from minorloop.teleop.modes import Seat
from minorloop.teleop.plant import head_of, open_plant
from minorloop.teleop.recording import PICTURE, TEXT, Recorder
from minorloop.teleop.session import Session
from minorloop.teleop.sight import PlainSight

END = b"."
"""What is sent instead of an order to end the loop."""
_QUALITY = 78
_SLEEPS_LATE = 0.2
_RECORD_EVERY = 5
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

    address: str = "twin:rig"
    specimen: int | None = None
    seed: int = 0
    folder: str = "console"
    timeout: float = 0.1

    def seat(self) -> Seat:
        """The seat with that patience."""
        return Seat(gaze=GazeMap(timeout=self.timeout), stick=StickMap(timeout=self.timeout))


def run(pipe: Connection, settings: LoopSettings) -> None:
    """Run the loop until the other end of the pipe goes away; for a process of its own."""
    sys.setswitchinterval(1e-3)
    with contextlib.suppress(OSError, AttributeError):
        os.nice(-10)  # allowed to few; it helps where others use the same cores
    try:
        plant, view = open_plant(settings.address, specimen=settings.specimen, seed=settings.seed)
        control = head_of(settings.address, settings.specimen)
        session = Session(plant, view, control, PlainSight(view=view), settings.seat())
        _warm_up(session)
    except (MinorloopError, ImportError) as error:
        pipe.send_bytes(messages.encode("failed", text=str(error)))
        return
    loop = _Loop(session, pipe, Path(settings.folder), settings.timeout)
    try:
        loop.run()
    finally:
        plant.safe()
        loop.close()


def _warm_up(session: Session) -> None:
    """Compile what the first ticks would wait for, and let no collector go over it later."""
    for _ in range(25):
        session.tick(0.0)
    assert session.seen is not None
    session.hear(messages.Pick(seq=0, t=0.0, grant=0, u=50.0, v=50.0), 0.0)
    session.tick(0.0)
    session.target = None
    _jpeg(session.seen.image)
    gc.collect()
    gc.freeze()


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
        due = time.monotonic()
        while not self._gone.is_set():
            late = time.monotonic() - due
            if late > self._patience:  # the process or the machine stood still
                session.hold("the control loop stood still for a while; press a mode to go on")
            if late > interval:  # ticks that were missed are not made up for
                due += late
            self._tick(due, late)
            due += interval
            time.sleep(max(due - time.monotonic(), 0.0))

    def _tick(self, due: float, late: float) -> None:
        session = self._session
        while self._inbox:
            at, message = self._inbox.popleft()
            if isinstance(message, messages.Record):
                self._record(message.on)
            else:
                session.hear(message, at)
        now = time.monotonic()
        session.tick(now)
        state = session.report(now, late=late)
        assert session.seen is not None
        image = (session.ticks, now, session.where(), session.seen.image)
        for event in session.events:
            self._outbox.event(event)
            self._keep(TEXT, now, event)
        session.events.clear()
        self._keep(TEXT, now, state)
        self._outbox.newest(state, image)

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
            now = time.monotonic()
            self._keep(TEXT, now, self._session.introduction())
            self._session.tell_findings()
            self._outbox.event(messages.encode("recording", name=name))
        else:
            self._end_recording()
            self._outbox.event(messages.encode("recording", name=None))

    def _end_recording(self) -> None:
        self._unwritten.put(None)
        self._unwritten.join()
        self._recorder = None

    def _keep(self, kind: int, t: float, content: bytes) -> None:
        if self._recorder is not None:
            if self._unwritten.qsize() > _MOST_UNWRITTEN:
                self._session.notice("the disk is too slow; recording ended")
                self._recorder = None
                return
            self._unwritten.put((kind, t, content))

    def _listen(self) -> None:
        """Take in what the server says; for a thread of its own."""
        decoder = msgspec.msgpack.Decoder(messages.Order)
        with contextlib.suppress(EOFError, OSError):
            while (content := self._pipe.recv_bytes()) != END:
                message = decoder.decode(content)
                self._inbox.append((time.monotonic(), message))
        self._gone.set()

    def _send(self) -> None:
        """Tell the server the newest; for a thread of its own."""
        pictures = 0
        with contextlib.suppress(OSError):
            while not self._gone.is_set():
                events, state, image = self._outbox.wait()
                for event in events:
                    self._pipe.send_bytes(event)
                if state is not None:
                    self._pipe.send_bytes(state)
                if image is not None:
                    number, t, where, grey = image
                    jpeg = messages.picture(messages.IMAGE, number, t, where, _jpeg(grey))
                    pictures += 1
                    if pictures % _RECORD_EVERY == 0:
                        self._keep(PICTURE, t, jpeg)
                    self._pipe.send_bytes(jpeg)
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
    """What goes to the server: every event, and of states and images the newest."""

    def __init__(self) -> None:
        self._there = threading.Condition()
        self._events: deque[bytes] = deque(maxlen=1000)
        self._state: bytes | None = None
        self._image: Any = None

    def event(self, text: bytes) -> None:
        with self._there:
            self._events.append(text)
            self._there.notify()

    def newest(self, state: bytes, image: Any) -> None:
        with self._there:
            self._state, self._image = state, image
            self._there.notify()

    def wait(self) -> tuple[list[bytes], bytes | None, Any]:
        with self._there:
            self._there.wait_for(lambda: self._events or self._state, timeout=0.5)
            taken = list(self._events), self._state, self._image
            self._events.clear()
            self._state = self._image = None
            return taken


def _jpeg(grey: Any) -> bytes:
    cv2 = opencv()
    _, encoded = cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return bytes(encoded)
