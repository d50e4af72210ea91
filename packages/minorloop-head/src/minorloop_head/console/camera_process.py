"""The camera process: answers the newest request of the loop and sends pictures to the server."""

from __future__ import annotations

import contextlib
import gc
import pickle
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection
from threading import Event, Thread
from typing import Any

import msgspec
import numpy as np

from minorloop.errors import InstrumentError, MinorloopError, ParameterError
from minorloop.page.process import be_nice
from minorloop_head.console import messages
from minorloop_head.console.camera_protocol import (
    FEW_PICTURES,
    PICTURED,
    PROBLEM,
    CameraCommand,
    CameraRequest,
    request_decoder,
)
from minorloop_head.console.channel import NewestPipe, Outbox
from minorloop_head.console.perception import Later, Perception
from minorloop_head.console.plant import open_tip
from minorloop_head.console.settings import LoopSettings, is_pipe
from minorloop_head.console.supervisor import ProcessHandle
from minorloop_head.console.units import to_shown
from minorloop_head.console.watchdog import RemoteWires
from minorloop_head.geometry import Pinhole
from minorloop_head.procedures.actuator_plant import BenchTip, CameraTip
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.seen_angles import SeenAngles
from minorloop_head.procedures.values import Tip
from minorloop_head.sources import Frame
from minorloop_head.vision.calibrated_camera import Image
from minorloop_head.vision.candidates import compile_outlines
from minorloop_head.vision.imaging import opencv
from minorloop_head.vision.video import LiveCamera

_QUALITY = 78
"""Quality of a JPEG, 1 to 100."""
_POLL = 0.1
_WAVES = 50.0
"""Radians of the texture from one edge of the picture to the other: some eight waves."""


def run(
    handle: ProcessHandle,
    settings: LoopSettings,
    calibration: HeadCalibration | None = None,
    cold: tuple[float, float] = (0.0, 0.0),
) -> None:
    """Run the camera until the control loop or the supervisor ends, in a separate process.

    ``handle``: gives pipes to the control loop, to the server for pictures and jobs, and to the
    plant for the lights of a bench. ``calibration``: of camera and probe; that of the tip without
    it. ``cold``: pan and tilt of the cold head in degrees, as of `SeenAngles`.
    """
    server, loop, plant = NewestPipe(), NewestPipe(), NewestPipe()
    stop = handle.begin(server=server, loop=loop, plant=plant)
    be_nice(-5)  # it helps where other programs use the same cores
    pool = ThreadPoolExecutor(1)
    with contextlib.ExitStack() as ends:
        try:
            tip, view = _tip(settings, calibration, plant)
            perception = trial = Perception(tip, view, _in(pool))
            if settings.camera is not None:
                camera = LiveCamera(settings.camera)
                ends.callback(camera.close)
                seen = None if settings.sensors else SeenAngles(view, cold)
                perception = Perception(CameraTip(tip, camera, view), view, _in(pool), seen)
                trial = Perception(StillTip(view.lens), view, _in(pool))
            opencv()
        except (MinorloopError, ImportError) as error:
            pipe = _introduced({"failed": str(error)}, loop, stop)
            _serve(None, pipe, server, handle, stop)
            return
        pipe = _introduced(view.to_dict(), loop, stop)  # the loop compiles meanwhile
        pool.submit(getattr(tip, "prepare", lambda: None))
        _warm_up(trial)
        gc.collect()
        gc.freeze()
        _serve(perception, pipe, server, handle, stop)
        pool.shutdown(wait=False, cancel_futures=True)


def _tip(
    settings: LoopSettings, calibration: HeadCalibration | None, plant: NewestPipe
) -> tuple[Tip, HeadCalibration]:
    """Return the tip and the calibration of its camera, which only a simulated one has itself."""
    if not is_pipe(settings.address):
        if calibration is None:
            raise ParameterError("the camera is not calibrated; give the file of the head")
        return BenchTip(RemoteWires(plant)), calibration
    flow = RemoteWires(plant).flood
    tip, own = open_tip(settings.address, specimen=settings.specimen, seed=settings.seed, flow=flow)
    return tip, calibration or own


def _introduced(introduction: dict[str, Any], loop: NewestPipe, stop: Event) -> Connection | None:
    """Send the introduction to a control loop; return its pipe, None if there was no loop."""
    pipe = None
    while pipe is None and not stop.is_set():
        pipe = loop.next(None, _POLL)
    if pipe is not None:
        with contextlib.suppress(OSError):  # the loop has ended: see `_serve`
            pipe.send_bytes(msgspec.json.encode(introduction))
    return pipe


def _serve(
    perception: Perception | None,
    pipe: Connection | None,
    server: NewestPipe,
    handle: ProcessHandle,
    stop: Event,
) -> None:
    """Answer a control loop until it ends."""
    outbox = Outbox()
    Thread(target=outbox.forward, args=(server,), daemon=True).start()
    problem = ""
    with contextlib.suppress(EOFError, OSError):
        while pipe is not None and not stop.is_set():
            handle.beat()
            if pipe.poll(_POLL):
                before, problem = problem, answer(perception, pipe, outbox)
                if problem and problem != before:
                    pipe.send_bytes(PROBLEM + problem.encode())


def answer(perception: Perception | None, loop: Connection, outbox: Outbox) -> str:
    """Answer the newest request of the loop; return the reason without an answer, else empty.

    Without a picture it gives none, and the loop holds. It hides pictures under other lights.
    """
    request = newest(loop)
    if perception is None:
        return ""
    try:
        report = perception.tick(request)
    except InstrumentError as error:
        return str(error)
    loop.send_bytes(msgspec.msgpack.encode(report))
    if perception.shown and perception.image is not None:
        where, coded = to_shown(request.position), jpeg(perception.image)
        picture = messages.picture(messages.IMAGE, request.number, perception.taken, where, coded)
        outbox.newest(picture)
        if request.keep and request.number % FEW_PICTURES == 0:
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
    """Return a function that runs computations of `Perception` in a pool."""

    def later(work: Any) -> Any:
        future = pool.submit(work)
        return lambda: future.result() if future.done() else None

    return later


class StillTip(BenchTip):
    """A tip without devices, whose camera shows a texture under its three lights."""

    def __init__(self, lens: Pinhole) -> None:
        super().__init__(self)
        self._rng = np.random.default_rng(0)
        y, x = np.mgrid[0 : 1 : lens.height * 1j, 0 : 1 : lens.width * 1j]
        texture = 110.0 + 25.0 * (np.sin(_WAVES * x + 9.0 * y) + np.sin(_WAVES * (y - x**2)))
        self._pictures = texture * np.array([x, y, 1.0 - 0.5 * (x + y)]) / 1.5
        self.light((True, True, True))

    def frame(self) -> Frame:
        """Return a picture under the present lights, with noise."""
        image = self._lit + self._rng.uniform(4.0, 8.0, self._lit.shape)
        return Frame(0.0, image.astype(np.uint8))

    def light(self, lights: Sequence[bool]) -> None:
        """Switch the lights."""
        self._lit = self._pictures[np.array(lights)].sum(axis=0)


def _warm_up(perception: Perception) -> None:
    """Compile functions for which the first pictures would wait."""
    compile_outlines()
    first: list[CameraCommand] = [("pick", [320.0, 400.0]), ("find", [])]
    request = CameraRequest(number=0, t=0.0, position=(0.0, 0.0, 0.0, 0.0), stance=(0.0,) * 6)
    for n, commands in enumerate([*([],) * 8, first, *([],) * 8]):
        perception.tick(msgspec.structs.replace(request, t=0.04 * n, commands=commands))
    perception.finish()
    perception.tick(msgspec.structs.replace(request, t=1.0))
    perception.reset()
