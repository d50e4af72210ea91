"""The process of the plant: it makes the plant safe when no command comes, and switches its lines.

The control loop sends the inputs of each tick and receives the readings. When the loop is silent or
ends, the plant is made safe, and stays safe until a loop acknowledges it: each command has the
last time of this kind that its sender acknowledged, and is ignored if it is not the newest one.
"""

from __future__ import annotations

import contextlib
import math
import sys
import threading
import time
from collections.abc import Sequence
from multiprocessing import connection
from multiprocessing.connection import Connection
from typing import Any

import msgspec
import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import InstrumentError, MinorloopError, SafetyError
from minorloop_head.console.channel import NewestPipe
from minorloop_head.console.plant import open_plant
from minorloop_head.console.settings import LoopSettings
from minorloop_head.console.supervisor import ProcessHandle, raise_priority
from minorloop_head.procedures.actuator_plant import Wires
from minorloop_head.procedures.values import Plant

_PATIENCE = 0.5
"""Longest seconds to switch a line: the plant may be carrying out a command of the loop."""
_LOST = (math.nan,) * 4
_REST = np.zeros(4)
_SILENT = "no command came from the control loop for {:g} s"
_ENDED = "the control loop ended"
_RESTARTED = "its process was restarted"
_BACK = "a device of the head was lost, and is back"
_POLL = 0.1
_AGAIN = 0.5
"""Seconds between two attempts to open a missing plant."""


class Command(msgspec.Struct, frozen=True, array_like=True):
    """Inputs of a tick, and the last time of being made safe that the loop has acknowledged."""

    known: float
    u: list[float]


class Answer(msgspec.Struct, frozen=True, array_like=True):
    """Readings at the end of a tick."""

    safe_at: float
    """Time when the plant was last made safe, in seconds on the monotonic clock; 0 if never."""
    why: str
    """Reason why it was made safe."""
    tick: float
    """Duration of a tick, in seconds."""
    y: list[float]
    stance: list[float]
    """Readings as of `Plant`; NaN if a sensor is lost, or was not read."""
    safe: bool = True
    """Whether the plant has confirmed that it is safe, when it was last made safe."""
    time: float | None = None
    """Time as of `Plant`."""


# Made while the module is imported: see `minorloop_head.console.messages`.
_commands = msgspec.msgpack.Decoder(Command)
_answers = msgspec.msgpack.Decoder(Answer)


def run(handle: ProcessHandle, settings: LoopSettings) -> None:
    """Pass commands to the plant until the supervisor ends, in a separate process."""
    loop, camera = NewestPipe(), NewestPipe()
    stop = handle.begin(loop=loop, camera=camera)
    plant = _opened(settings, loop, handle, stop)
    if plant is None:
        return
    raise_priority()
    watched = WatchedPlant(plant, settings.patience, _RESTARTED if handle.again else "")
    try:
        watched.serve(loop, handle, stop, camera)
    finally:
        _end(plant)


def _end(plant: Plant) -> None:
    """Make the plant safe, and close its devices; warn if it may still be on."""
    try:
        plant.safe()
    except SafetyError as error:
        print(f"error: {error}", file=sys.stderr)
    finally:
        _close(plant)


def _close(plant: Plant | None) -> None:
    """Close the devices of a plant, if it has some."""
    getattr(plant, "close", lambda: None)()


def _opened(
    settings: LoopSettings, loop: NewestPipe, handle: ProcessHandle, stop: threading.Event
) -> Plant | None:
    """Return the plant as soon as it can be opened; until then send the reason to loops.

    The first heartbeat comes after the first attempt, which may have to import and compile.
    """
    last = None
    while not stop.is_set():
        plant = None
        try:
            plant = open_plant(settings.address, specimen=settings.specimen, seed=settings.seed)
            plant.exchange(_REST)  # compiles functions of the first command
            return plant
        except (MinorloopError, ImportError) as error:
            why = str(error)
            _close(plant)
        handle.beat()
        pipe = loop.next(last, _AGAIN)
        if pipe is not None:
            last = pipe
            missing = Answer(time.monotonic(), why, settings.interval, list(_LOST), [], safe=False)
            with contextlib.suppress(OSError):
                pipe.send_bytes(msgspec.msgpack.encode(missing))
        stop.wait(_AGAIN)
    return None


class WatchedPlant:
    """A plant that is made safe when no command comes.

    ``patience``: seconds to wait for a command. ``why``: reason to make it safe first; empty if it
    was not used before.
    """

    def __init__(self, plant: Plant, patience: float, why: str = "") -> None:
        self._plant, self._patience = plant, patience
        self.safe_at, self.why, self.is_safe = 0.0, "", True
        self._y, self._used = list(_LOST), False
        self._lines: NewestPipe | None = None
        self._make_safe(why)
        if not why and self.is_safe:
            self.safe_at = 0.0

    def serve(
        self,
        loop: NewestPipe,
        handle: ProcessHandle,
        stop: threading.Event,
        lines: NewestPipe | None = None,
    ) -> None:
        """Answer one loop after the other until the event is set.

        ``lines``: commands for lights and pump.
        """
        self._lines, last = lines, None
        while not stop.is_set():
            handle.beat()
            pipe = loop.next(last, _POLL)
            if pipe is None:
                continue
            last = pipe
            with contextlib.suppress(EOFError, OSError):
                while pipe.poll():  # sent while the plant was missing
                    pipe.recv_bytes()
                pipe.send_bytes(msgspec.msgpack.encode(self._answer()))
                while not stop.is_set():
                    handle.beat()
                    self._answer_next(pipe)
            self._stop(_ENDED)

    def _answer_next(self, pipe: Connection) -> None:
        if not self._wait_for_command(pipe):
            self._stop(_SILENT.format(self._patience))
            return
        command = _commands.decode(pipe.recv_bytes())
        if not self.is_safe:
            self._make_safe(_BACK)
        elif command.known == self.safe_at:
            self._carry_out(command)
        pipe.send_bytes(msgspec.msgpack.encode(self._answer()))

    def _wait_for_command(self, pipe: Connection) -> bool:
        """Return whether a command comes in time; switch lights and pump meanwhile."""
        deadline = time.monotonic() + self._patience
        while True:
            lines = None if self._lines is None else self._lines.next(None, 0.0)
            waiting = [pipe] if lines is None or lines.closed else [pipe, lines]
            ready = connection.wait(waiting, max(deadline - time.monotonic(), 0.0))
            if pipe in ready:
                return True
            if not ready:
                return False
            self._switch(waiting[1])

    def _switch(self, lines: Connection) -> None:
        """Switch lights and pump; after a failure the plant was made safe."""
        try:
            carry_out(self._plant, lines)  # type: ignore[arg-type]
        except (EOFError, OSError):
            lines.close()

    def _carry_out(self, command: Command) -> None:
        self._used = True
        try:
            self._y = np.asarray(self._plant.exchange(np.array(command.u))).tolist()
        except (MinorloopError, OSError) as error:
            self._y = list(_LOST)
            self._make_safe(f"a command could not be carried out: {error}")

    def _stop(self, why: str) -> None:
        """Make the plant safe if it was used since the last time."""
        if self._used:
            self._make_safe(why)

    def _make_safe(self, why: str) -> None:
        """Make the plant safe; if it does not confirm, the next command tries again."""
        was_safe, self.is_safe = self.is_safe, True
        try:
            self._plant.safe()
        except SafetyError as error:
            self.is_safe = False
            if not was_safe:
                return
            why = str(error)
        self.safe_at, self.why, self._used = time.monotonic(), why, False

    def _answer(self) -> Answer:
        stance = list(self._plant.stance())
        tick, now = self._plant.tick, self._plant.time
        return Answer(self.safe_at, self.why, tick, self._y, stance, self.is_safe, now)


class RemotePlant:
    """The plant in another process, for the control loop.

    ``channel``: to that process. ``patience``: seconds without an answer after which it counts as
    silent, and no call waits any more. ``wait``: longest wait of one exchange in seconds; the
    patience without it. If the plant is later, the reading is NaN, and the loop is not delayed.
    """

    def __init__(self, channel: NewestPipe, patience: float, wait: float | None = None) -> None:
        self._channel, self._patience = channel, patience
        self._wait = patience if wait is None else wait
        self._pipe: Connection | None = None
        self._waiting, self._sent = True, -math.inf
        self.responds = False
        self.answer = Answer(0.0, "", 0.0, list(_LOST), [])
        self._known = 0.0

    @property
    def tick(self) -> float:
        """Duration of one ``exchange``, in seconds."""
        return self.answer.tick

    @property
    def time(self) -> float | None:
        """Time as of `Plant`, at its last answer."""
        return self.answer.time

    def meet(self, timeout: float) -> bool:
        """Wait for the first answer with the first readings; return whether it came."""
        pipe = self._channel.next(self._pipe, timeout)
        if pipe is not None:
            self._pipe, self._waiting = pipe, True
        self.responds = self._receive(timeout)
        return self.responds

    def exchange(self, u: FloatArray) -> FloatArray:
        """Apply inputs for a tick; return the readings, NaN without an answer in time.

        While an answer is late, nothing else is sent.
        """
        pipe = self._channel.next(self._pipe, 0.0)
        if pipe is not None:
            self._pipe, self._waiting = pipe, True
        if not self._waiting and self._pipe is not None:
            self._sent = -math.inf  # one that has ended takes nothing
            with contextlib.suppress(OSError):
                command = Command(self._known, np.asarray(u).tolist())
                self._pipe.send_bytes(msgspec.msgpack.encode(command))
                self._waiting, self._sent = True, time.monotonic()
        answered = self._receive(self._wait if self.responds else 0.0)
        late = time.monotonic() - self._sent < self._patience
        self.responds = answered or (self.responds and late)
        return np.array(self.answer.y if answered else _LOST)

    def accept(self) -> None:
        """Acknowledge that the plant was made safe; commands are carried out again."""
        self._known = self.answer.safe_at

    @property
    def made_safe(self) -> bool:
        """Whether the plant was made safe since the last `accept`."""
        return self.answer.safe_at != self._known

    def stance(self) -> tuple[float, ...]:
        """Return the pose of the simulated tip; see `Plant.stance`."""
        return tuple(self.answer.stance)

    def safe(self) -> None:
        """Close the pipe; the plant then makes itself safe."""
        if self._pipe is not None:
            self._pipe.close()

    def _receive(self, patience: float) -> bool:
        if self._pipe is None or not self._waiting:
            return False
        try:
            if self._pipe.poll(patience):
                self.answer = _answers.decode(self._pipe.recv_bytes())
                self._waiting = False
                return True
        except (EOFError, OSError):  # it has ended: nothing is late
            self._sent = -math.inf
        return False


class LineCommand(msgspec.Struct, frozen=True, kw_only=True):
    """Lights to switch, or the pump."""

    number: int
    """Number of the command, which the answer repeats."""
    lights: list[bool] | None = None
    pump: bool | None = None


# Made while the module is imported: see `minorloop_head.console.messages`.
_line_commands = msgspec.msgpack.Decoder(LineCommand)


class RemoteWires:
    """Lights and pump of the plant in another process.

    ``channel``: to that process; ``patience``: seconds to wait for an answer.
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

        Raises an `InstrumentError` if the plant does not answer, or fails.
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
    """Carry out the command that waits in a pipe, and answer with an error or an empty one.

    Raises an `EOFError` or `OSError` if the other process has ended.
    """
    command = _line_commands.decode(pipe.recv_bytes())
    said = ""
    try:
        if command.lights is not None:
            wires.light(command.lights)
        if command.pump is not None:
            wires.flood(command.pump)
    except (MinorloopError, OSError) as error:
        said = str(error)
    pipe.send_bytes(f"{command.number} {said}".encode())
