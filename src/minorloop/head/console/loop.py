"""The control loop: a process of its own, 25 ticks a second, that never waits for anybody.

It does the tick and nothing else: pictures are made, looked at and packed by the eyes, and inputs
are applied by the process of the plant. What the loop hears comes in by threads, what it tells goes
out by others; between them and the tick there are places for the newest only, so that a page, a
server, a camera or a disk that stands still costs it nothing. When the server goes away, the loop
holds and waits for another; when the supervisor does, it ends.
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
from datetime import datetime
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import MinorloopError, ParameterError
from minorloop.head.console import messages
from minorloop.head.console.camera_protocol import CameraReport, CameraRequest, RemoteCamera
from minorloop.head.console.channel import NewestPipe, Outbox
from minorloop.head.console.plant import PlantView, head_of
from minorloop.head.console.recording import PICTURE, TEXT, Recorder
from minorloop.head.console.session import Session
from minorloop.head.console.settings import LoopSettings
from minorloop.head.console.supervisor import ProcessHandle, hurry
from minorloop.head.console.watchdog import RemotePlant
from minorloop.head.control.head import HeadControl

_SLEEPS_LATE = 0.2
_LOOK_EVERY = 0.1
_NEW_SERVER = object()
_COLLECT_EVERY = _TOLD_EVERY = 25
_MOST_UNWRITTEN = 20_000


def run(post: ProcessHandle, settings: LoopSettings) -> None:
    """Run the loop until the supervisor ends; for a process of its own.

    Parameters
    ----------
    post : ProcessHandle
        Brings pipes to the server, to the plant, and to the camera, whose first word is what it
        knows of itself.
    settings : LoopSettings
    """
    server, camera, wires = NewestPipe(), NewestPipe(), NewestPipe()
    over = post.begin(server=server, camera=camera, plant=wires)
    sys.setswitchinterval(1e-3)
    with contextlib.suppress(OSError, AttributeError):
        os.nice(-10)  # allowed to few; it helps where others use the same cores
    sight, plant = RemoteCamera(camera), RemotePlant(wires, settings.patience / 2)
    try:
        control = head_of(settings.address, settings.specimen)
        view = _introduced(sight, over)
        _rehearse(view, control, settings)
    except (MinorloopError, ImportError) as error:
        _fail(str(error), server, post, over)
        return
    while not plant.meet(_LOOK_EVERY):
        if over.is_set():
            return
    session = Session(plant, view, control, sight, settings.seat())
    loop = _Loop(session, plant, sight, server, settings)
    gc.collect()
    gc.freeze()
    gc.disable()  # what is left in circles is collected between two ticks
    try:
        loop.run(post, over)
    finally:
        plant.safe()
        loop.close()


def _introduced(sight: RemoteCamera, over: threading.Event) -> PlantView:
    """Camera and probe as they are known."""
    while not over.is_set():
        told = sight.introduced(_LOOK_EVERY)
        if told is not None and "failed" in told:
            raise ParameterError(told["failed"])
        if told is not None:
            return PlantView.heard(told)
    raise ParameterError("the camera did not start")


def _fail(sentence: str, server: NewestPipe, post: ProcessHandle, over: threading.Event) -> None:
    """Tell every server what is wrong, until the supervisor ends."""
    last = None
    while not over.is_set():
        post.beat()
        pipe = server.next(last, _LOOK_EVERY)
        if pipe is not None:
            last = pipe
            server.send(messages.encode("failed", text=sentence))


class _Rehearsed:
    """A plant and eyes where nothing happens, to compile what the first ticks would wait for."""

    tick = 0.04

    def exchange(self, u: FloatArray) -> FloatArray:
        return np.zeros(4)

    def stance(self) -> tuple[float, ...]:
        return ()

    def safe(self) -> None:
        return

    def look(self, look: CameraRequest) -> None:
        return

    def seen(self) -> list[CameraReport]:
        return [CameraReport(number=0)]


def _rehearse(view: PlantView, control: HeadControl, settings: LoopSettings) -> None:
    nothing = _Rehearsed()
    session = Session(nothing, view, control, nothing, settings.seat())
    for _ in range(25):
        session.tick(0.0)
        session.report(0.0)


class _Loop:
    """The tick and the threads around it."""

    def __init__(
        self,
        session: Session,
        plant: RemotePlant,
        sight: RemoteCamera,
        server: NewestPipe,
        settings: LoopSettings,
    ) -> None:
        self._session, self._plant, self._sight = session, plant, sight
        self._server, self._folder = server, Path(settings.folder)
        self._patience = max(_SLEEPS_LATE, settings.timeout)
        self._inbox: deque[tuple[float, Any]] = deque(maxlen=256)
        self._outbox = Outbox()
        self._recorder: Recorder | None = None
        self._lost = False
        self._recordings: list[bool] = []  # to begin and to end, in this order, after a tick
        sight.on_picture = self._keep_picture
        self._unwritten: queue.Queue[tuple[int, float, bytes] | None] = queue.Queue()

    def run(self, post: ProcessHandle, over: threading.Event) -> None:
        """Tick until it is over."""
        session, interval = self._session, self._session.interval
        for work in (self._listen, lambda: self._outbox.forward(self._server), self._write):
            threading.Thread(target=work, daemon=True).start()
        hurry()
        due = time.monotonic()
        while not over.is_set():
            late = time.monotonic() - due
            if late > self._patience:  # the process or the machine stood still
                self._inbox.clear()
                session.hold("the control loop stood still for a while; press a mode to go on")
            if late > interval:  # ticks that were missed are not made up for
                due += late
            self._tick(due, late)
            post.beat()
            due += interval
            if session.ticks % _COLLECT_EVERY == 0:
                gc.collect(0)
            time.sleep(max(due - time.monotonic(), 0.0))

    def _tick(self, due: float, late: float) -> None:
        session = self._session
        while self._inbox:
            at, message = self._inbox.popleft()
            self._hear(message, at)
        now = time.monotonic()
        session.tick(now)
        self._watch_plant()
        state = session.report(now, late=late, safe_at=self._plant.answer.safe_at)
        for event in session.events:
            self._outbox.event(event)
            self._keep(TEXT, now, event)
        session.events.clear()
        self._keep(TEXT, now, state)
        self._outbox.newest(state)
        for on in self._recordings:
            self._record(on)
        self._recordings.clear()
        if session.ticks % _TOLD_EVERY == 0:
            self._tell_recording()

    def _hear(self, message: Any, at: float) -> None:
        if message is _NEW_SERVER:
            self._outbox.event(self._session.introduction())
            self._outbox.event(messages.encode("recording", name=None))
            if self._session.findings:
                self._session.tell_findings()
        elif isinstance(message, messages.RecordSession):
            self._recordings.append(message.on)
        else:
            self._session.hear(message, at)
            if isinstance(message, messages.Release):  # nobody is there to end it
                self._recordings.append(False)

    def _watch_plant(self) -> None:
        """Hold where the plant does not answer, and rest where it was made safe."""
        lost = not self._plant.there
        if lost and (not self._lost or self._session.state.mode != "HOLD"):
            self._session.hold("the plant does not answer; press a mode when it is back")
        self._lost = lost
        if self._plant.made_safe:
            self._plant.accept()
            self._session.rest(
                f"{self._plant.answer.why}, and the head was made safe: its wires cool; press "
                "Head (1) to bring it back to the middle"
            )

    def _record(self, on: bool) -> None:
        """Begin or end a recording."""
        if on == (self._recorder is not None):
            return
        if on:
            name = datetime.now().strftime("%Y-%m-%d-%H%M%S-%f")[:-3]
            try:
                self._recorder = Recorder(self._folder, name)
            except OSError as error:
                self._session.notice(f"nothing is recorded: {error}")
                return
            self._sight.keep = True
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
        self._sight.keep = False
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
        """Take in what servers say; for a thread of its own."""
        decoder = msgspec.msgpack.Decoder(messages.Inner)
        for pipe in self._server.pipes():
            self._inbox.append((time.monotonic(), _NEW_SERVER))
            with contextlib.suppress(EOFError, OSError):
                while True:
                    message = decoder.decode(pipe.recv_bytes())
                    self._inbox.append((time.monotonic(), message))
            self._inbox.append((time.monotonic(), messages.Release(seq=0, t=0.0, grant=0)))

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
