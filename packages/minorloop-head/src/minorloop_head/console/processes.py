"""The processes of the console: plant, control loop, camera and server, under a supervisor.

To start fast, each process imports only the modules that it needs, and the supervisor none of them.
"""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Callable, Iterator
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any

from minorloop.lab.signals import Stopped, ended_by_signals
from minorloop.page.auth import Serving
from minorloop.page.process import be_nice
from minorloop_head.console.channel import NewestPipe
from minorloop_head.console.settings import LoopSettings
from minorloop_head.console.supervisor import Part, ProcessHandle, Supervisor

if TYPE_CHECKING:
    from minorloop_head.procedures.head_file import HeadFile

PIPES = (
    ("loop", "plant"),
    ("loop", "camera"),
    ("loop", "server"),
    ("camera", "server"),
    ("plant", "camera"),
)
"""Pairs of processes with a pipe; the pipe of plant and camera is for lights and pump."""


def supervised(
    settings: LoopSettings,
    how: Serving,
    notify: Callable[[str], None],
    tracking: socket.socket | None = None,
    head: HeadFile | None = None,
) -> None:
    """Run the console until a signal ends it.

    ``notify``: shows a sentence on a restarted process to the user. ``tracking``: receives the
    packets of a tracker of the operator's head; a restarted loop uses the same. ``head``: of the
    head, which is identified at the start without it.
    """
    control, calibration, cold = None, None, (0.0, 0.0)
    if head is not None:
        control = head.control(interval=settings.interval, by_camera=not settings.sensors)
        calibration, cold = head.calibration, tuple(control.cold.tolist())
    parts = [
        Part(
            name="plant", target=_run, args=("watchdog", settings), patience=settings.plant_patience
        ),
        Part(name="loop", target=_run, args=("loop", settings, tracking, control)),
        Part(
            name="camera",
            target=_run,
            args=("camera_process", settings, calibration, cold),
            patience=2.0,
        ),
        Part(name="server", target=serve, args=(settings, how), patience=2.0),
    ]
    supervisor = Supervisor(parts, PIPES, notify=notify)
    try:
        with contextlib.suppress(Stopped), ended_by_signals(exiting=True):
            supervisor.start()
            supervisor.run()
    finally:
        supervisor.end()


def _run(handle: ProcessHandle, module: str, *given: Any) -> None:
    """Import and run a module of the console, in a separate process."""
    import_module(f"minorloop_head.console.{module}").run(handle, *given)


def serve(handle: ProcessHandle, settings: LoopSettings, how: Serving) -> None:
    """Serve the pages until the supervisor ends, in a separate process.

    ``handle``: gives pipes to the control loop and to the camera.
    """
    import uvicorn

    from minorloop.page import serving
    from minorloop_head.console.link import ConsoleLink
    from minorloop_head.console.server import Console

    loop, camera = NewestPipe(), NewestPipe()
    stop = handle.begin(loop=loop, camera=camera)

    class Supervised(uvicorn.Server):
        async def on_tick(self, counter: int) -> bool:
            handle.beat()
            return stop.is_set() or await super().on_tick(counter)

        @contextlib.contextmanager
        def capture_signals(self) -> Iterator[None]:
            yield  # signals are for the supervisor

    be_nice(-5)  # the operator should not wait for other programs
    serving.serve(
        Console(
            authentication=how.authentication,
            loop=settings,
            link=partial(ConsoleLink, loop=loop, camera=camera),
        ).app(),
        how,
        server=Supervised,
    )
