"""The eyes as a process: they take the newest word of the loop, and pictures go to the server."""

from __future__ import annotations

import contextlib
import gc
import os
import pickle
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection
from typing import Any

import msgspec

from minorloop.errors import MinorloopError
from minorloop.teleop import messages
from minorloop.teleop.eyes import Eyes
from minorloop.teleop.imaging import opencv
from minorloop.teleop.loop import PICTURED, LoopSettings
from minorloop.teleop.plant import open_tip
from minorloop.teleop.sight import Look, Wish
from minorloop.vision.eye import Image

_QUALITY = 78
_RECORD_EVERY = 5


def run(loop: Connection, shown: Connection, settings: LoopSettings) -> None:
    """Look until the loop goes away; for a process of its own.

    Parameters
    ----------
    loop : Connection
        To the control loop.
    shown : Connection
        To the server, for pictures and jobs.
    settings : LoopSettings
    """
    with contextlib.suppress(OSError, AttributeError):
        os.nice(-5)  # allowed to few; it helps where others use the same cores
    try:
        tip, view = open_tip(settings.address, specimen=settings.specimen, seed=settings.seed)
        opencv()
    except (MinorloopError, ImportError):
        loop.close()  # the loop says what is wrong
        return
    pool = ThreadPoolExecutor(1)
    eyes = Eyes(tip, view, _in(pool))
    _warm_up(eyes)
    gc.collect()
    gc.freeze()
    with contextlib.suppress(EOFError, OSError, KeyboardInterrupt):
        loop.send_bytes(msgspec.json.encode(view.told()))
        _look(eyes, loop, shown)
    pool.shutdown(wait=False, cancel_futures=True)


def _look(eyes: Eyes, loop: Connection, shown: Connection) -> None:
    decoder, encoder = msgspec.msgpack.Decoder(Look), msgspec.msgpack.Encoder()
    while True:
        look = newest(loop, decoder)
        seen = eyes.tick(look)
        loop.send_bytes(encoder.encode(seen))
        if eyes.image is not None:
            coded = jpeg(eyes.image)
            picture = messages.picture(messages.IMAGE, look.number, look.t, look.where, coded)
            shown.send_bytes(picture)
            if look.keep and look.number % _RECORD_EVERY == 0:
                loop.send_bytes(PICTURED + picture)
        while eyes.jobs:
            shown.send_bytes(bytes([messages.JOB]) + pickle.dumps(eyes.jobs.pop(0)))


def newest(pipe: Connection, decoder: msgspec.msgpack.Decoder[Look]) -> Look:
    """The newest word in a pipe, with the wishes of those before it."""
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
    """What does things in a pool, for `Eyes`."""

    def later(work: Callable[[], Any]) -> Callable[[], Any | None]:
        future = pool.submit(work)
        return lambda: future.result() if future.done() else None

    return later


def _warm_up(eyes: Eyes) -> None:
    """Compile what the first pictures would wait for."""
    look = Look(number=0, t=0.0, where=(0.0, 0.0, 0.0, 0.0), stance=(0.0,) * 6)
    for _ in range(8):
        eyes.tick(look)
    first: list[Wish] = [("pick", [320.0, 400.0]), ("find", [])]
    for wishes in (first, *([],) * 8):
        eyes.tick(msgspec.structs.replace(look, wishes=wishes))
    eyes.forget()
