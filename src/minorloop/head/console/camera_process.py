"""The eyes as a process: they take the newest word of the loop, and pictures go to the server."""

from __future__ import annotations

import contextlib
import gc
import os
import pickle
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection
from threading import Event, Thread
from typing import Any

import msgspec

from minorloop.errors import MinorloopError
from minorloop.head.console import messages
from minorloop.head.console.camera_protocol import PICTURED, CameraRequest, Wish
from minorloop.head.console.channel import NewestPipe, Outbox
from minorloop.head.console.imaging import opencv
from minorloop.head.console.perception import Perception
from minorloop.head.console.plant import open_tip
from minorloop.head.console.settings import LoopSettings
from minorloop.head.console.supervisor import ProcessHandle
from minorloop.head.vision.calibrated_camera import Image

_QUALITY = 78
_RECORD_EVERY = 5
_LOOK_EVERY = 0.1


def run(post: ProcessHandle, settings: LoopSettings) -> None:
    """Look until the control loop or the supervisor ends; for a process of its own.

    Parameters
    ----------
    post : ProcessHandle
        Brings pipes to the control loop, and to the server for pictures and jobs.
    settings : LoopSettings
    """
    server, loop = NewestPipe(), NewestPipe()
    over = post.begin(server=server, loop=loop)
    with contextlib.suppress(OSError, AttributeError):
        os.nice(-5)  # allowed to few; it helps where others use the same cores
    try:
        tip, view = open_tip(settings.address, specimen=settings.specimen, seed=settings.seed)
        opencv()
    except (MinorloopError, ImportError) as error:
        _serve(None, {"failed": str(error)}, loop, server, post, over)
        return
    pool = ThreadPoolExecutor(1)
    eyes = Perception(tip, view, _in(pool))
    _warm_up(eyes)
    gc.collect()
    gc.freeze()
    _serve(eyes, view.told(), loop, server, post, over)
    pool.shutdown(wait=False, cancel_futures=True)


def _serve(
    eyes: Perception | None,
    introduction: dict[str, Any],
    loop: NewestPipe,
    server: NewestPipe,
    post: ProcessHandle,
    over: Event,
) -> None:
    """Introduce the eyes to a control loop, and look for it until it ends."""
    outbox = Outbox()
    Thread(target=outbox.forward, args=(server,), daemon=True).start()
    pipe = None
    while pipe is None and not over.is_set():
        pipe = loop.next(None, _LOOK_EVERY)
    if pipe is None:
        return
    with contextlib.suppress(EOFError, OSError):
        pipe.send_bytes(msgspec.json.encode(introduction))
        while not over.is_set():
            post.beat()
            if pipe.poll(_LOOK_EVERY):
                _look(eyes, pipe, outbox)


def _look(eyes: Perception | None, loop: Connection, outbox: Outbox) -> None:
    """Answer the newest word of the loop."""
    look = newest(loop)
    if eyes is None:
        return
    seen = eyes.tick(look)
    loop.send_bytes(msgspec.msgpack.encode(seen))
    if eyes.image is not None:
        coded = jpeg(eyes.image)
        picture = messages.picture(messages.IMAGE, look.number, look.t, look.where, coded)
        outbox.newest(picture)
        if look.keep and look.number % _RECORD_EVERY == 0:
            loop.send_bytes(PICTURED + picture)
    while eyes.jobs:
        outbox.event(bytes([messages.JOB]) + pickle.dumps(eyes.jobs.pop(0)))


def newest(pipe: Connection) -> CameraRequest:
    """The newest word in a pipe, with the wishes of those before it."""
    decoder = msgspec.msgpack.Decoder(CameraRequest)
    look = decoder.decode(pipe.recv_bytes())
    while pipe.poll():
        later = decoder.decode(pipe.recv_bytes())
        look = msgspec.structs.replace(later, wishes=[*look.wishes, *later.wishes])
    return look


def jpeg(grey: Image) -> bytes:
    """A picture, packed."""
    cv2 = opencv()
    _, encoded = cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return bytes(encoded)


def _in(pool: ThreadPoolExecutor) -> Callable[[Callable[[], Any]], Callable[[], Any | None]]:
    """What does things in a pool, for `Perception`."""

    def later(work: Callable[[], Any]) -> Callable[[], Any | None]:
        future = pool.submit(work)
        return lambda: future.result() if future.done() else None

    return later


def _warm_up(eyes: Perception) -> None:
    """Compile what the first pictures would wait for."""
    look = CameraRequest(number=0, t=0.0, where=(0.0, 0.0, 0.0, 0.0), stance=(0.0,) * 6)
    for _ in range(8):
        eyes.tick(look)
    first: list[Wish] = [("pick", [320.0, 400.0]), ("find", [])]
    for wishes in (first, *([],) * 8):
        eyes.tick(msgspec.structs.replace(look, wishes=wishes))
    eyes.forget()
