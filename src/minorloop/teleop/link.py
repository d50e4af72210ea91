"""The server's end of the control loop: its process, and a thread each way."""

from __future__ import annotations

import asyncio
import contextlib
import multiprocessing
import queue
import threading
from collections.abc import Callable

import msgspec

from minorloop.teleop import loop, messages

_MOST_WAITING = 512


class Link:
    """A control loop in a process of its own.

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
        self.process = context.Process(target=loop.run, args=(theirs, self._settings), daemon=True)
        self.process.start()
        theirs.close()
        events = asyncio.get_running_loop()
        for work in (lambda: self._listen(events), self._speak):
            threading.Thread(target=work, daemon=True).start()

    def order(self, message: messages.Order) -> None:
        """Pass an order on; it is dropped where the loop has not taken in hundreds of them."""
        with contextlib.suppress(queue.Full):
            self._orders.put_nowait(msgspec.msgpack.encode(message))

    def stop(self) -> None:
        """End the process: it holds, makes the plant safe and finishes its recording."""
        with contextlib.suppress(queue.Full):
            self._orders.put_nowait(None)
        self.process.join(timeout=5.0)
        if self.process.is_alive():
            self.process.terminate()

    def _listen(self, events: asyncio.AbstractEventLoop) -> None:
        with contextlib.suppress(EOFError, OSError, RuntimeError):
            while True:
                content = self._pipe.recv_bytes()
                events.call_soon_threadsafe(self._said, content)
        gone = messages.encode("failed", text="the control loop has ended; start the console again")
        with contextlib.suppress(RuntimeError):  # the event loop may have ended, too
            events.call_soon_threadsafe(self._said, gone)

    def _speak(self) -> None:
        with contextlib.suppress(OSError):
            while (content := self._orders.get()) is not None:
                self._pipe.send_bytes(content)
            self._pipe.send_bytes(loop.END)
