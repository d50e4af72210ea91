"""The server's end of the control loop and of the camera process: pipes and their threads."""

from __future__ import annotations

import asyncio
import contextlib
import queue
import threading
from collections.abc import Callable

import msgspec

from minorloop_head.console import messages
from minorloop_head.console.channel import NewestPipe
from minorloop_head.console.settings import LoopSettings

_MOST_WAITING = 512
"""Most orders that wait for the loop: some ten seconds of a page."""
_FAILED = b'{"type":"failed"'
_MAKES_SAFE = "The head is made safe and its wires cool. The loop is restarted and then holds."
_SILENT = f"The control loop does not respond. {_MAKES_SAFE}"
_GONE = f"The control loop has ended. {_MAKES_SAFE}"


class ConsoleLink:
    """Connection to a control loop and a camera in processes of their own.

    ``received``: handles each of their messages; called in the event loop that ran ``start``.
    ``loop`` and ``camera``: pipes to the processes; without them, there are no such processes.
    """

    def __init__(
        self,
        settings: LoopSettings,
        received: Callable[[bytes], None],
        *,
        loop: NewestPipe | None = None,
        camera: NewestPipe | None = None,
    ) -> None:
        self._loop, self._camera = loop or NewestPipe(), camera or NewestPipe()
        self._silence, self._received = 2 * settings.patience, received
        self._orders: queue.Queue[bytes] = queue.Queue(maxsize=_MOST_WAITING)
        self._loop_runs = False

    def start(self) -> None:
        """Start the threads; call it where the event loop runs."""
        self._events = asyncio.get_running_loop()
        for work in (self._receive_from_loop, self._receive_from_camera, self._send_orders):
            threading.Thread(target=work, daemon=True).start()

    def order(self, message: messages.ToLoop) -> None:
        """Send an order to the loop; drop it if there is no loop to carry it out now."""
        if self._loop_runs or isinstance(message, messages.Release):
            with contextlib.suppress(queue.Full):
                self._orders.put_nowait(msgspec.msgpack.encode(message))

    def stop(self) -> None:
        """Disconnect from the loop; it continues without the server."""

    def _receive_from_loop(self) -> None:
        for pipe in self._loop.pipes():
            with contextlib.suppress(EOFError, OSError):
                while True:
                    if self._loop_runs and not pipe.poll(self._silence):
                        self._loop_runs = False
                        self._fail(_SILENT)
                    content = pipe.recv_bytes()
                    self._loop_runs = not content.startswith(_FAILED)
                    self._pass_on(content)
            self._loop_runs = False
            self._fail(_GONE)

    def _receive_from_camera(self) -> None:
        for pipe in self._camera.pipes():
            with contextlib.suppress(EOFError, OSError):
                while True:
                    self._pass_on(pipe.recv_bytes())

    def _fail(self, sentence: str) -> None:
        self._pass_on(messages.encode(messages.Failed(text=sentence, again=True)))

    def _pass_on(self, content: bytes) -> None:
        with contextlib.suppress(RuntimeError):  # the event loop may have ended
            self._events.call_soon_threadsafe(self._received, content)

    def _send_orders(self) -> None:
        while True:
            self._loop.send(self._orders.get())
