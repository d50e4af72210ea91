"""Lights and pump from the camera process to the process of the plant, which has the lines."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection
from typing import Any

import msgspec

from minorloop.errors import InstrumentError, MinorloopError
from minorloop_head.console.channel import NewestPipe
from minorloop_head.procedures.actuator_plant import Wires

_PATIENCE = 0.5
"""Seconds until the plant has switched a line: it may be carrying out a command of the loop."""


class LineCommand(msgspec.Struct, frozen=True, kw_only=True):
    """Lights to switch, or the pump."""

    number: int
    """Of the command; it is in the answer."""
    lights: list[bool] | None = None
    pump: bool | None = None


# Made while the module is imported: see `minorloop_head.console.messages`.
_commands = msgspec.msgpack.Decoder(LineCommand)


class RemoteWires:
    """Lights and pump of the plant in another process.

    Parameters
    ----------
    channel : NewestPipe
        To that process.
    patience : float
        Seconds to wait for an answer.
    """

    def __init__(self, channel: NewestPipe, patience: float = _PATIENCE) -> None:
        self._channel, self._patience = channel, patience
        self._lock, self._number = threading.Lock(), 0

    def light(self, lights: Sequence[bool]) -> None:
        """Switch the lights on or off; return only when they are."""
        self._ask(lights=[bool(on) for on in lights])

    def flood(self, on: bool) -> None:
        """Switch the pump on or off; return only when it is."""
        self._ask(pump=bool(on))

    def _ask(self, **what: Any) -> None:
        """Send a command and wait until it is carried out.

        Raises
        ------
        InstrumentError
            If the plant does not answer, or could not do it.
        """
        with self._lock:
            pipe = self._channel.next(None, self._patience)
            said = "the plant does not answer"
            self._number += 1
            with contextlib.suppress(EOFError, OSError):
                if pipe is not None:
                    command = LineCommand(number=self._number, **what)
                    pipe.send_bytes(msgspec.msgpack.encode(command))
                    due = time.monotonic() + self._patience
                    while pipe.poll(max(due - time.monotonic(), 0.0)):
                        number, _, answer = pipe.recv_bytes().decode().partition(" ")
                        if int(number) == self._number:  # not one that came too late
                            said = answer
                            break
            if said:
                raise InstrumentError(f"the lights and the pump were not switched: {said}")


def carry_out(wires: Wires, pipe: Connection) -> None:
    """Carry out the command that waits in a pipe, and answer with an error, or with nothing.

    Raises
    ------
    EOFError, OSError
        If the other process has ended.
    """
    command = _commands.decode(pipe.recv_bytes())
    said = ""
    try:
        if command.lights is not None:
            wires.light(command.lights)
        if command.pump is not None:
            wires.flood(command.pump)
    except (MinorloopError, OSError) as error:
        said = str(error)
    pipe.send_bytes(f"{command.number} {said}".encode())
