"""The processes of the console: plant, control loop, camera and server, and who supervises them."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from minorloop.teleop import lookout, watchdog
from minorloop.teleop import loop as control_loop
from minorloop.teleop.channel import Channel
from minorloop.teleop.doors import Doors
from minorloop.teleop.settings import LoopSettings
from minorloop.teleop.supervisor import Part, Post, Supervisor

STATIC = Path(__file__).parent / "static"
PIPES = (("loop", "plant"), ("loop", "camera"), ("loop", "server"), ("camera", "server"))
_PREFIX = "minorloop-console-"


@dataclass(frozen=True, kw_only=True)
class Serving:
    """How the pages are served.

    Parameters
    ----------
    doors : Doors
    listening : socket
        Bound; it stays the same when the server is started anew.
    certificate, private_key : str, optional
        Files, for https.
    """

    doors: Doors
    listening: socket.socket
    certificate: str | None = None
    private_key: str | None = None


def supervised(settings: LoopSettings, serving: Serving, said: Callable[[str], None]) -> None:
    """Run the console until a signal ends it.

    Parameters
    ----------
    settings : LoopSettings
    serving : Serving
    said : callable
        What to do with a sentence on a process that was started anew.
    """
    _remove_left_behind()
    scratch = tempfile.mkdtemp(prefix=f"{_PREFIX}{os.getpid()}-")

    def cleared(name: str) -> None:
        if name == "server":
            shutil.rmtree(scratch, ignore_errors=True)

    parts = [
        Part(name="plant", target=watchdog.run, args=(settings,)),
        Part(name="loop", target=control_loop.run, args=(settings,)),
        Part(name="camera", target=lookout.run, args=(settings,), patience=2.0),
        Part(name="server", target=serve, args=(settings, serving, scratch), patience=2.0),
    ]
    supervisor = Supervisor(parts, PIPES, said=said, cleared=cleared)
    try:
        with _ended_by_signals():
            supervisor.start()
            supervisor.run()
    finally:
        supervisor.end()
        cleared("server")


def serve(post: Post, settings: LoopSettings, serving: Serving, scratch: str) -> None:
    """Serve the pages until the supervisor ends; for a process of its own.

    Parameters
    ----------
    post : Post
        Brings pipes to the control loop and to the camera.
    settings : LoopSettings
    serving : Serving
    scratch : str
        Folder for temporary files, which is removed at the end.
    """
    loop, camera = Channel(), Channel()
    over = post.begin(loop=loop, camera=camera)
    os.makedirs(scratch, mode=0o700, exist_ok=True)
    tempfile.tempdir = scratch
    import uvicorn

    from minorloop.teleop.link import Link
    from minorloop.teleop.server import Console

    class Server(uvicorn.Server):
        async def on_tick(self, counter: int) -> bool:
            post.beat()
            return over.is_set() or await super().on_tick(counter)

        @contextlib.contextmanager
        def capture_signals(self) -> Iterator[None]:
            yield  # they are for the supervisor

    with contextlib.suppress(OSError, AttributeError):
        os.nice(-5)  # allowed to few: what an operator does should not wait for other programs
    console = Console(
        doors=serving.doors, loop=settings, link=partial(Link, loop=loop, camera=camera)
    )
    config = uvicorn.Config(
        console.app(),
        log_level="warning",
        access_log=False,
        ws_max_size=1 << 14,
        ws_max_queue=64,
        ws_per_message_deflate=False,
        ws_ping_interval=10.0,
        ws_ping_timeout=10.0,
        ssl_certfile=serving.certificate,
        ssl_keyfile=serving.private_key,
        timeout_graceful_shutdown=2,
        server_header=False,
    )
    try:
        Server(config).run(sockets=[serving.listening])
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


@contextlib.contextmanager
def _ended_by_signals() -> Iterator[None]:
    """A signal that ends a program ends what is done here; further ones do not disturb the end."""
    asked = [
        number
        for name in ("SIGINT", "SIGTERM", "SIGHUP")
        if (number := getattr(signal, name, None)) is not None
        and signal.getsignal(number) != signal.SIG_IGN  # as nohup does
    ]

    def end(*_: object) -> None:
        for number in asked:
            signal.signal(number, signal.SIG_IGN)
        raise KeyboardInterrupt

    for number in asked:
        signal.signal(number, end)
    with contextlib.suppress(KeyboardInterrupt):
        yield


def _remove_left_behind() -> None:
    """Remove the temporary files of consoles that were killed together with all their processes."""
    for folder in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*-*"):
        number = folder.name.removeprefix(_PREFIX).split("-")[0]
        if number.isdigit() and not _runs(int(number)):
            shutil.rmtree(folder, ignore_errors=True)


def _runs(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        pass
    return True
