"""The plant in a process of its own, which makes it safe when no command comes.

The control loop sends the inputs of each tick and gets the readings back. When it is silent, ends
or stands still, the plant is made safe, and stays safe until a loop has taken notice: a command
carries the time at which the plant was last made safe as far as its sender knows, and is not
carried out if there is a later one.
"""

from __future__ import annotations

import contextlib
import math
import threading
import time
from multiprocessing.connection import Connection

import msgspec
import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import MinorloopError
from minorloop.head.console.channel import NewestPipe
from minorloop.head.console.plant import open_plant
from minorloop.head.console.settings import LoopSettings
from minorloop.head.console.supervisor import ProcessHandle, hurry
from minorloop.head.procedures.values import Plant

_LOST = (math.nan,) * 4
_REST = np.zeros(4)
_SILENT = "no command came from the control loop for {:g} s"
_ENDED = "the control loop ended"
_ANEW = "its process was started anew"
_LOOK_EVERY = 0.1


class Command(msgspec.Struct, frozen=True, array_like=True):
    """Inputs for a tick, and when the plant was last made safe as far as the loop knows."""

    known: float
    u: list[float]


class Answer(msgspec.Struct, frozen=True, array_like=True):
    """Readings at the end of a tick.

    Parameters
    ----------
    safe_at : float
        When the plant was last made safe, in seconds on the monotonic clock; 0 if never.
    why : str
        Why it was made safe.
    tick : float
        In seconds.
    y, stance : list of float
        As of `Plant`; NaN where a sensor is lost, and where nothing was read.
    """

    safe_at: float
    why: str
    tick: float
    y: list[float]
    stance: list[float]


def run(post: ProcessHandle, settings: LoopSettings) -> None:
    """Pass commands on to the plant until the supervisor ends; for a process of its own."""
    loop = NewestPipe()
    over = post.begin(loop=loop)
    try:
        plant = open_plant(settings.address, specimen=settings.specimen, seed=settings.seed)
    except (MinorloopError, ImportError):
        while not over.wait(_LOOK_EVERY):  # the loop says what is wrong
            post.beat()
        return
    plant.exchange(_REST)  # compiles what the first command would wait for
    hurry()
    guarded = WatchedPlant(plant, settings.patience, _ANEW if post.again else "")
    try:
        guarded.serve(loop, post, over)
    finally:
        plant.safe()


class WatchedPlant:
    """A plant that is made safe when no command comes.

    Parameters
    ----------
    plant : Plant
    patience : float
        Seconds to wait for a command.
    why : str
        Why it has to be made safe before anything else; empty where it has not been used before.
    """

    def __init__(self, plant: Plant, patience: float, why: str = "") -> None:
        self._plant, self._patience = plant, patience
        self.safe_at, self.why = 0.0, ""
        self._y, self._used = list(_LOST), False
        plant.safe()
        if why:
            self._make_safe(why)

    def serve(self, loop: NewestPipe, post: ProcessHandle, over: threading.Event) -> None:
        """Answer one loop after the other until it is over."""
        last = None
        while not over.is_set():
            post.beat()
            pipe = loop.next(last, _LOOK_EVERY)
            if pipe is None:
                continue
            last = pipe
            with contextlib.suppress(EOFError, OSError):
                pipe.send_bytes(msgspec.msgpack.encode(self._answer()))
                while not over.is_set():
                    post.beat()
                    self._listen(pipe)
            self._stop(_ENDED)

    def _listen(self, pipe: Connection) -> None:
        if not pipe.poll(self._patience):
            self._stop(_SILENT.format(self._patience))
            return
        command = msgspec.msgpack.decode(pipe.recv_bytes(), type=Command)
        if command.known == self.safe_at:
            self._carry_out(command)
        pipe.send_bytes(msgspec.msgpack.encode(self._answer()))

    def _carry_out(self, command: Command) -> None:
        self._used = True
        try:
            self._y = np.asarray(self._plant.exchange(np.array(command.u))).tolist()
        except (MinorloopError, OSError) as error:
            self._y = list(_LOST)
            self._make_safe(f"a command could not be carried out: {error}")

    def _stop(self, why: str) -> None:
        """Make it safe, unless it has been safe since it was last used."""
        if self._used:
            self._make_safe(why)

    def _make_safe(self, why: str) -> None:
        self._plant.safe()
        self.safe_at, self.why, self._used = time.monotonic(), why, False

    def _answer(self) -> Answer:
        stance = list(self._plant.stance())
        return Answer(self.safe_at, self.why, self._plant.tick, self._y, stance)


class RemotePlant:
    """The plant of another process, for the control loop; it waits for nobody.

    Parameters
    ----------
    channel : NewestPipe
        To that process.
    patience : float
        Seconds that an answer may take; as long as none comes, readings are NaN.
    """

    def __init__(self, channel: NewestPipe, patience: float) -> None:
        self._channel, self._patience = channel, patience
        self._pipe: Connection | None = None
        self._waiting = True
        self.there = False
        self.answer = Answer(0.0, "", 0.0, list(_LOST), [])
        self._known = 0.0

    @property
    def tick(self) -> float:
        """How long one ``exchange`` takes, in seconds."""
        return self.answer.tick

    def meet(self, timeout: float) -> bool:
        """Wait for the first word of it, which tells where it is; whether it came."""
        pipe = self._channel.next(self._pipe, timeout)
        if pipe is not None:
            self._pipe, self._waiting = pipe, True
        self.there = self._hear(timeout)
        return self.there

    def exchange(self, u: FloatArray) -> FloatArray:
        """The readings after a tick; NaN where no answer came in time."""
        pipe = self._channel.next(self._pipe, 0.0)
        if pipe is not None:
            self._pipe, self._waiting = pipe, True
        patience = self._patience if self.there else 0.0
        if not self._waiting and self._pipe is not None:
            with contextlib.suppress(OSError):
                command = Command(self._known, np.asarray(u).tolist())
                self._pipe.send_bytes(msgspec.msgpack.encode(command))
                self._waiting = True
        self.there = self._hear(patience)
        return np.array(self.answer.y if self.there else _LOST)

    def accept(self) -> None:
        """Take notice that it was made safe; commands are carried out again."""
        self._known = self.answer.safe_at

    @property
    def made_safe(self) -> bool:
        """Whether it was made safe since the last `accept`."""
        return self.answer.safe_at != self._known

    def stance(self) -> tuple[float, ...]:
        """What a simulated tip has to be told of where it is."""
        return tuple(self.answer.stance)

    def safe(self) -> None:
        """Leave it alone; it makes itself safe."""
        if self._pipe is not None:
            self._pipe.close()

    def _hear(self, patience: float) -> bool:
        if self._pipe is None or not self._waiting:
            return False
        with contextlib.suppress(EOFError, OSError):
            if self._pipe.poll(patience):
                self.answer = msgspec.msgpack.decode(self._pipe.recv_bytes(), type=Answer)
                self._waiting = False
                return True
        return False
