"""The server's end of the control loop and of its eyes: two processes, and threads to hear them."""

from __future__ import annotations

import asyncio
import contextlib
import multiprocessing
import queue
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection

import msgspec

from minorloop.teleop import lookout, loop, messages

_MOST_WAITING = 512


class Link:
    """A control loop and its eyes, in processes of their own.

    Parameters
    ----------
    settings : LoopSettings
    said : callable
        What to do with each message of the loop; called in the event loop that ran ``start``.
    """

    def __init__(self, settings: loop.LoopSettings, said: Callable[[bytes], None]) -> None:
        self._settings, self._said = settings, said
        self._orders: queue.Queue[bytes | None] = queue.Queue(maxsize=_MOST_WAITING)

    def start(self) -> None:
        """Start the process; has to be called where the event loop runs."""
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._pictures, shown = context.Pipe(duplex=False)
        looking, seeing = context.Pipe()
        self.process = context.Process(
            target=loop.run, args=(theirs, looking, self._settings), daemon=True
        )
        self.eyes = context.Process(
            target=lookout.run, args=(seeing, shown, self._settings), daemon=True
        )
        self.process.start()
        self.eyes.start()
        for end in (theirs, shown, looking, seeing):
            end.close()
        events = asyncio.get_running_loop()
        gone = "the control loop has ended; start the console again"
        for work in (
            lambda: self._listen(self._pipe, events, gone),
            lambda: self._listen(self._pictures, events, "the camera has gone"),
            self._speak,
        ):
            threading.Thread(target=work, daemon=True).start()

    def order(self, message: messages.Inner) -> None:
        """Pass an order on; it is dropped where the loop has not taken in hundreds of them."""
        with contextlib.suppress(queue.Full):
            self._orders.put_nowait(msgspec.msgpack.encode(message))

    def stop(self) -> None:
        """End the process: it holds, makes the plant safe and finishes its recording."""
        with contextlib.suppress(queue.Full):
            self._orders.put_nowait(None)
        self.process.join(timeout=5.0)
        for process in (self.process, self.eyes):
            if process.is_alive():
                process.terminate()

    def _listen(self, pipe: Connection, events: asyncio.AbstractEventLoop, gone: str) -> None:
        with contextlib.suppress(EOFError, OSError, RuntimeError):
            while True:
                events.call_soon_threadsafe(self._said, pipe.recv_bytes())
        with contextlib.suppress(RuntimeError):  # the event loop may have ended, too
            events.call_soon_threadsafe(self._said, messages.encode("failed", text=gone))

    def _speak(self) -> None:
        with contextlib.suppress(OSError):
            while (content := self._orders.get()) is not None:
                self._pipe.send_bytes(content)
            self._pipe.send_bytes(loop.END)
