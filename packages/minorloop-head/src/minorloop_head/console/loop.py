"""The control loop: a separate process with 25 ticks per second, which never waits for others.

It only does the tick. The camera process takes, searches and encodes pictures; the process of the
plant applies inputs. Threads receive and send messages, and pass only the newest one to the tick: a
page, a server, a camera or a disk that hangs does not delay it. When the server ends, the loop
holds and waits for another; when the supervisor ends, the loop ends.
"""

from __future__ import annotations

import contextlib
import gc
import socket
import sys
import threading
import time
from collections import deque
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import MinorloopError, ParameterError
from minorloop.page.process import be_nice
from minorloop_head.console import messages
from minorloop_head.console.camera_protocol import CameraReport, CameraRequest, RemoteCamera
from minorloop_head.console.channel import NewestPipe, Outbox
from minorloop_head.console.recording import PICTURE, TEXT, SessionRecording
from minorloop_head.console.session import Session
from minorloop_head.console.settings import LoopSettings
from minorloop_head.console.supervisor import ProcessHandle, raise_priority
from minorloop_head.console.tracker import UdpTracker
from minorloop_head.console.watchdog import RemotePlant
from minorloop_head.control.head import HeadControl
from minorloop_head.procedures.calibration import HeadCalibration

_STOOD_STILL = 0.2
"""Longest delay of a tick in seconds; a longer one means that the process was stopped."""
_WAIT = 0.025
"""Longest wait for an answer of the plant, in s; the loop needs the rest of a tick of 40 ms."""
_MOST_LATE = 0.1
"""Longest silence in seconds that misses fewer readings than those of a lost sensor."""
_POLL = 0.1
_NEW_SERVER = object()
_COLLECT_EVERY = _STATUS_EVERY = 25
_WRITTEN_WITHIN = 2.0
"""Seconds for which the end of the loop waits for the disk."""
_STOPPED = (
    "the control loop stood still for a while: the computer was asleep or too busy; keep it awake, "
    "end other programs, and press a mode to continue"
)


def run(
    handle: ProcessHandle,
    settings: LoopSettings,
    tracking: socket.socket | None = None,
    control: HeadControl | None = None,
) -> None:
    """Run the loop until the supervisor ends, in a separate process.

    ``handle``: gives pipes to the server, to the plant, and to the camera, whose first message is
    its calibration; ``tracking``: receives the packets of a tracker of the operator's head;
    ``control``: of the head, which is identified without it.
    """
    server, pictures, wires = NewestPipe(), NewestPipe(), NewestPipe()
    stop = handle.begin(server=server, camera=pictures, plant=wires)
    sys.setswitchinterval(1e-3)
    be_nice(-10)  # it helps where other programs use the same cores
    silence = settings.patience / 2
    # A longer silence would first count as a lost sensor.
    wait = _WAIT if silence < _MOST_LATE else None
    camera, plant = RemoteCamera(pictures), RemotePlant(wires, silence, wait)
    try:
        control = control or _identified(settings)
        view = _introduced(camera, stop)
        _warm_up(view, control, settings)
    except (MinorloopError, ImportError) as error:
        _fail(str(error), server, handle, stop)
        return
    while not plant.meet(_POLL):
        if stop.is_set():
            return
    tracker = None if tracking is None else UdpTracker(tracking)
    config = settings.teleop_config()
    session = Session(
        plant, view, control, camera, config, tracker, settings.no_probe, settings.sensors
    )
    loop = _Loop(session, plant, camera, server, settings)
    gc.collect()
    gc.freeze()
    gc.disable()  # garbage is collected between two ticks
    try:
        loop.run(handle, stop)
    finally:
        plant.safe()
        loop.close()


def _identified(settings: LoopSettings) -> HeadControl:
    """Identify the head; the modules for this are not imported for a known head."""
    from minorloop_head.console.identified_head import head_of

    return head_of(settings.address, settings.specimen)


def _introduced(camera: RemoteCamera, stop: threading.Event) -> HeadCalibration:
    """Wait for the calibration of camera and probe, and return it."""
    while not stop.is_set():
        values = camera.introduction(_POLL)
        if values is not None and "failed" in values:
            raise ParameterError(values["failed"])
        if values is not None:
            return HeadCalibration.from_dict(values)
    raise ParameterError("the camera did not start")


def _fail(sentence: str, server: NewestPipe, handle: ProcessHandle, stop: threading.Event) -> None:
    """Send every server the reason of a failure, until the supervisor ends."""
    last = None
    while not stop.is_set():
        handle.beat()
        pipe = server.next(last, _POLL)
        if pipe is not None:
            last = pipe
            server.send(messages.encode(messages.Failed(text=sentence)))


class _Stub:
    """A plant and a camera that do nothing, to compile functions before the first ticks."""

    tick, time, problem = 0.04, None, ""

    def exchange(self, u: FloatArray) -> FloatArray:
        return np.zeros(4)

    def stance(self) -> tuple[float, ...]:
        return ()

    def safe(self) -> None:
        return

    def send(self, request: CameraRequest) -> None:
        return

    def reports(self) -> list[CameraReport]:
        return [CameraReport(number=0)]


def _warm_up(view: HeadCalibration, control: HeadControl, settings: LoopSettings) -> None:
    stub = _Stub()
    session = Session(stub, view, control, stub, settings.teleop_config())
    state, wanted = control.begin(), view.joints((0.0, 0.0))
    for _ in range(25):
        session.tick(0.0)
        session.report(0.0)
        _, state = control.step(state, wanted, np.zeros(2), t=session.ticks * session.interval)


class _Loop:
    """The tick and the threads around it."""

    def __init__(
        self,
        session: Session,
        plant: RemotePlant,
        camera: RemoteCamera,
        server: NewestPipe,
        settings: LoopSettings,
    ) -> None:
        self._session, self._plant, self._camera = session, plant, camera
        self._server = server
        self._patience = max(_STOOD_STILL, settings.timeout)
        self._inbox: deque[tuple[float, Any]] = deque(maxlen=256)
        self._outbox = Outbox()
        self._recording = SessionRecording(Path(settings.folder), session.notice)
        self._recorded = False  # whether the pages know of a recording
        self._plant_lost = False
        self._recordings: list[bool] = []  # starts and ends, in their order, to do after the tick
        camera.on_picture = self._keep_picture

    def run(self, handle: ProcessHandle, stop: threading.Event) -> None:
        """Tick until the event is set."""
        session, interval = self._session, self._session.interval
        forward = lambda: self._outbox.forward(self._server)  # noqa: E731
        for work in (self._receive_all, forward, self._recording.write):
            threading.Thread(target=work, daemon=True).start()
        raise_priority()
        due = time.monotonic()
        while not stop.is_set():
            late = time.monotonic() - due
            if late > self._patience:  # the process or the machine was stopped
                self._inbox.clear()
                session.hold(_STOPPED)
            if late > interval:  # missed ticks are skipped
                due += late
            self._tick(late)
            handle.beat()
            due += interval
            if session.ticks % _COLLECT_EVERY == 0:
                gc.collect()  # takes 0.1 ms: older objects are frozen
            time.sleep(max(due - time.monotonic(), 0.0))

    def _tick(self, late: float) -> None:
        session = self._session
        while self._inbox:
            at, message = self._inbox.popleft()
            self._receive(message, at)
        now = time.monotonic()
        session.tick(now)
        self._watch_plant()
        state = session.report(now, late=late, safe_at=self._plant.answer.safe_at)
        while session.events:  # other threads add to them
            event = session.events.popleft()
            self._outbox.event(event)
            self._recording.keep(TEXT, now, event)
        self._recording.keep(TEXT, now, state)
        self._outbox.newest(state)
        for on in self._recordings:
            self._record(on)
        self._recordings.clear()
        on = self._recording.recorder is not None
        if on != self._recorded or (on and session.ticks % _STATUS_EVERY == 0):
            self._recorded = self._camera.keep = on
            self._send_recording_status()

    def _receive(self, message: Any, at: float) -> None:
        if message is _NEW_SERVER:
            self._outbox.event(self._session.introduction())
            self._outbox.event(messages.encode(messages.RecordingStatus(name=None)))
            if self._session.findings:
                self._session.send_findings()
        elif isinstance(message, messages.RecordSession):
            self._recordings.append(message.on)
        else:
            self._session.receive(message, at)
            if isinstance(message, messages.Release):  # nobody is left to end it
                self._recordings.append(False)

    def _watch_plant(self) -> None:
        """Hold if the plant does not answer, and rest if it was made safe.

        A warning stays until the plant is safe.
        """
        self._session.danger = "" if self._plant.answer.safe else self._plant.answer.why
        lost = not self._plant.responds
        if lost and (not self._plant_lost or self._session.state.mode != "HOLD"):
            answer = self._plant.answer
            why = "the plant does not answer" if answer.safe else answer.why
            self._session.hold(f"{why}; press a mode when it is back")
        self._plant_lost = lost
        if self._plant.made_safe:
            self._plant.accept()
            why = self._plant.answer.why or "the plant answers now"
            done = "and the head was made safe: its wires cool; press Head (1) to bring it back to"
            if self._plant.answer.safe:
                self._session.rest(f"{why}, {done} the middle")
            else:
                self._session.rest(f"{why}; press Head (1) when it is back")

    def _record(self, on: bool) -> None:
        """Start or end a recording."""
        if not on:
            self._recording.end()
        elif self._recording.recorder is None:
            name = datetime.now().strftime("%Y-%m-%d-%H%M%S-%f")[:-3]
            try:
                self._recording.begin(name)
            except OSError as error:
                self._session.notice(f"nothing is recorded: {error}")
                return
            self._recording.keep(TEXT, time.monotonic(), self._session.introduction())
            self._session.send_findings()

    def _send_recording_status(self) -> None:
        recorder = self._recording.recorder
        status = messages.RecordingStatus(name=None)
        if recorder is not None:
            seconds = round(time.monotonic() - recorder.began, 1)
            status = messages.RecordingStatus(
                name=recorder.path.stem, seconds=seconds, size=recorder.size
            )
        self._outbox.event(messages.encode(status))

    def _keep_picture(self, content: bytes) -> None:
        """Record a picture; called by the thread that receives from the camera."""
        self._recording.keep(PICTURE, messages.HEADER.unpack_from(content)[2], content)

    def _receive_all(self) -> None:
        """Receive the messages of servers, in a separate thread."""
        for pipe in self._server.pipes():
            self._inbox.append((time.monotonic(), _NEW_SERVER))
            with contextlib.suppress(EOFError, OSError):
                while True:
                    message = messages.loop_decoder.decode(pipe.recv_bytes())
                    self._inbox.append((time.monotonic(), message))
            self._inbox.append((time.monotonic(), messages.Release(seq=0, t=0.0, grant=0)))

    def close(self) -> None:
        """End a recording."""
        self._recording.close(_WRITTEN_WITHIN)
