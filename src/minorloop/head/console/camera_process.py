"""The camera process: answers the newest request of the loop, sends pictures to the server."""

from __future__ import annotations

import contextlib
import gc
import os
import pickle
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection
from threading import Event, Thread
from typing import Any

import msgspec

from minorloop.errors import InstrumentError, MinorloopError
from minorloop.head.console import messages
from minorloop.head.console.bench_lines import RemoteWires
from minorloop.head.console.camera_protocol import (
    PICTURED,
    CameraCommand,
    CameraRequest,
    request_decoder,
)
from minorloop.head.console.camera_tip import CameraTip
from minorloop.head.console.channel import NewestPipe, Outbox
from minorloop.head.console.perception import Later, Perception
from minorloop.head.console.plant import open_tip
from minorloop.head.console.settings import PIPE, LoopSettings, is_pipe
from minorloop.head.console.supervisor import ProcessHandle
from minorloop.head.console.units import to_shown
from minorloop.head.procedures.actuator_plant import BenchTip
from minorloop.head.procedures.calibration import HeadCalibration
from minorloop.head.procedures.values import Tip
from minorloop.head.vision.calibrated_camera import Image
from minorloop.head.vision.candidates import compile_outlines
from minorloop.head.vision.imaging import opencv
from minorloop.head.vision.video import LiveCamera

_QUALITY = 78
"""Of a JPEG, 1 to 100."""
_RECORD_EVERY = 5
"""Pictures of which one is recorded: five a second."""
_POLL = 0.1


def run(
    handle: ProcessHandle, settings: LoopSettings, calibration: HeadCalibration | None = None
) -> None:
    """Run the camera until the control loop or the supervisor ends; for a process of its own.

    Parameters
    ----------
    handle : ProcessHandle
        Gives pipes to the control loop, to the server for pictures and jobs, and to the plant for
        the lights of a bench.
    settings : LoopSettings
    calibration : HeadCalibration, optional
        Of camera and probe; that of the tip without it.
    """
    server, loop, plant = NewestPipe(), NewestPipe(), NewestPipe()
    stop = handle.begin(server=server, loop=loop, plant=plant)
    with contextlib.suppress(OSError, AttributeError):
        os.nice(-5)  # few systems allow it; it helps where other programs use the same cores
    try:
        # That of the pipe is simulated, and compiles what the first pictures would wait for.
        tip, own = open_tip(PIPE, specimen=settings.specimen, seed=settings.seed)
        view = calibration or own
        camera = None if settings.camera is None else LiveCamera(settings.camera)
        opencv()
    except (MinorloopError, ImportError) as error:
        _serve(None, {"failed": str(error)}, loop, server, handle, stop)
        return
    pool = ThreadPoolExecutor(1)
    pool.submit(getattr(tip, "prepare", lambda: None))
    real = not is_pipe(settings.address)
    perception = Perception(tip, own if real else view, _in(pool))
    _warm_up(perception)
    if camera is not None:
        carrying: Tip = BenchTip(RemoteWires(plant)) if real else tip
        perception = Perception(CameraTip(carrying, camera, view.lens), view, _in(pool))
    gc.collect()
    gc.freeze()
    _serve(perception, view.to_dict(), loop, server, handle, stop)
    pool.shutdown(wait=False, cancel_futures=True)


def _serve(
    perception: Perception | None,
    introduction: dict[str, Any],
    loop: NewestPipe,
    server: NewestPipe,
    handle: ProcessHandle,
    stop: Event,
) -> None:
    """Send the introduction to a control loop, and answer it until it ends."""
    outbox = Outbox()
    Thread(target=outbox.forward, args=(server,), daemon=True).start()
    pipe = None
    while pipe is None and not stop.is_set():
        pipe = loop.next(None, _POLL)
    if pipe is None:
        return
    with contextlib.suppress(EOFError, OSError):
        pipe.send_bytes(msgspec.json.encode(introduction))
        problem = ""
        while not stop.is_set():
            handle.beat()
            if pipe.poll(_POLL):
                before, problem = problem, answer(perception, pipe, outbox)
                if problem and problem != before:
                    outbox.event(messages.encode(messages.Notice(text=problem)))


def answer(perception: Perception | None, loop: Connection, outbox: Outbox) -> str:
    """Answer the newest request of the loop; return why there is no answer, empty if there is one.

    Without a picture there is none, and the loop holds.
    """
    request = newest(loop)
    if perception is None:
        return ""
    try:
        report = perception.tick(request)
    except InstrumentError as error:
        return str(error)
    loop.send_bytes(msgspec.msgpack.encode(report))
    if perception.image is not None:
        where, coded = to_shown(request.position), jpeg(perception.image)
        picture = messages.picture(messages.IMAGE, request.number, request.t, where, coded)
        outbox.newest(picture)
        if request.keep and request.number % _RECORD_EVERY == 0:
            loop.send_bytes(PICTURED + picture)
    while perception.jobs:
        outbox.event(bytes([messages.JOB]) + pickle.dumps(perception.jobs.pop(0)))
    return ""


def newest(pipe: Connection) -> CameraRequest:
    """Return the newest request in a pipe, with the commands of those before it."""
    request = request_decoder.decode(pipe.recv_bytes())
    while pipe.poll():
        later = request_decoder.decode(pipe.recv_bytes())
        request = msgspec.structs.replace(later, commands=[*request.commands, *later.commands])
    return request


def jpeg(grey: Image) -> bytes:
    """Return a picture as JPEG."""
    cv2 = opencv()
    _, encoded = cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return bytes(encoded)


def _in(pool: ThreadPoolExecutor) -> Later:
    """Return what runs computations of `Perception` in a pool."""

    def later(work: Any) -> Any:
        future = pool.submit(work)
        return lambda: future.result() if future.done() else None

    return later


def _warm_up(perception: Perception) -> None:
    """Compile what the first pictures would wait for."""
    compile_outlines()
    request = CameraRequest(number=0, t=0.0, position=(0.0, 0.0, 0.0, 0.0), stance=(0.0,) * 6)
    for _ in range(8):
        perception.tick(request)
    first: list[CameraCommand] = [("pick", [320.0, 400.0]), ("find", [])]
    for commands in (first, *([],) * 8):
        perception.tick(msgspec.structs.replace(request, commands=commands))
    perception.reset()
