"""The server's end of the control loop and of the camera: channels, and threads to hear them."""

from __future__ import annotations

import asyncio
import contextlib
import queue
import threading
from collections.abc import Callable

import msgspec

from minorloop.head.console import messages
from minorloop.head.console.channel import NewestPipe
from minorloop.head.console.settings import LoopSettings

_MOST_WAITING = 512
_FAILED = b'{"type":"failed"'
_MAKES_SAFE = "The head is made safe and its wires cool. It is started anew and holds then."
_SILENT = f"The control loop stands still. {_MAKES_SAFE}"
_GONE = f"The control loop has ended. {_MAKES_SAFE}"


class ConsoleLink:
    """A control loop and a camera, in processes of their own.

    Parameters
    ----------
    settings : LoopSettings
    said : callable
        What to do with each message of them; called in the event loop that ran ``start``.
    loop, camera : Channel, optional
        Without them, nobody is there.
    """

    def __init__(
        self,
        settings: LoopSettings,
        said: Callable[[bytes], None],
        *,
        loop: NewestPipe | None = None,
        camera: NewestPipe | None = None,
    ) -> None:
        self._loop, self._camera = loop or NewestPipe(), camera or NewestPipe()
        self._silence, self._said = 2 * settings.patience, said
        self._orders: queue.Queue[bytes] = queue.Queue(maxsize=_MOST_WAITING)
        self._there = False

    def start(self) -> None:
        """Begin to talk; has to be called where the event loop runs."""
        self._events = asyncio.get_running_loop()
        for work in (self._hear_loop, self._hear_camera, self._speak):
            threading.Thread(target=work, daemon=True).start()

    def order(self, message: messages.Inner) -> None:
        """Pass an order on; it is dropped where no loop is there that would carry it out now."""
        if self._there or isinstance(message, messages.Release):
            with contextlib.suppress(queue.Full):
                self._orders.put_nowait(msgspec.msgpack.encode(message))

    def stop(self) -> None:
        """Leave the loop alone; it goes on without the server."""

    def _hear_loop(self) -> None:
        for pipe in self._loop.pipes():
            with contextlib.suppress(EOFError, OSError):
                while True:
                    if self._there and not pipe.poll(self._silence):
                        self._there = False
                        self._fail(_SILENT)
                    content = pipe.recv_bytes()
                    self._there = not content.startswith(_FAILED)
                    self._tell(content)
            self._there = False
            self._fail(_GONE)

    def _hear_camera(self) -> None:
        for pipe in self._camera.pipes():
            with contextlib.suppress(EOFError, OSError):
                while True:
                    self._tell(pipe.recv_bytes())

    def _fail(self, sentence: str) -> None:
        self._tell(messages.encode("failed", text=sentence, again=True))

    def _tell(self, content: bytes) -> None:
        with contextlib.suppress(RuntimeError):  # the event loop may have ended
            self._events.call_soon_threadsafe(self._said, content)

    def _speak(self) -> None:
        while True:
            self._loop.send(self._orders.get())
