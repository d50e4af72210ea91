"""The line protocol of the firmware that the C export sketches.

One line of printable ASCII asks, one answers::

    7 SET 0.25 *1C291CA3        ask: number, command, arguments, CRC-32 of what stands before
    7 OK 0.25 *40C4B8B3         answer: the same number, OK or ERR, values, CRC-32

============  =====================  ====================================================
``HELLO``     ``minorloop 2 L H P``  protocol, version, limits of the input, patience in ms
``SET u``     ``u``                  put an input on; ERR if it is beyond the limits
``GET``       ``y``                  read the sensor
``STEP u``    ``y``                  what the model in the firmware gives for an input
``AIM y``     ``u``                  the input that the model asks for
``SAFE``                             go to the safe input
============  =====================  ====================================================

An answer counts only if its number is that of the question and its sum is right: one that comes
late, doubled or damaged is thrown away.

The firmware goes to the safe input by itself when it has heard nothing for its patience, a second
as it is exported. If an input was on, ``SET`` and ``GET`` are answered ``ERR safe`` from then on,
and so they are after a loss of power, until ``HELLO`` or ``SAFE`` is said: what is read then is not
of the input that was set. `Board.keep_alive` asks something often enough while an input is on.
"""

from __future__ import annotations

import math
import re
import threading
import time
import weakref
import zlib
from contextlib import suppress

from minorloop.errors import InstrumentError
from minorloop.lab.drivers.link import Link
from minorloop.lab.drivers.scpi import number
from minorloop.lab.signals import Deferred

__all__ = ["Board", "parse", "write"]

VERSION = 2
_LINE = re.compile(r"(\d{1,5}) (OK|ERR)((?: [!-)+-~]{1,40}){0,8}) \*([0-9A-F]{8})")
_PATIENCE = 8
_MOST = 65_536
_LONGEST = 3_600_000
_OFTEN = 3
"""Questions within the patience of a board while an input is on, at least."""


def write(sequence: int, *words: str) -> str:
    """A line with its number and its sum."""
    body = f"{sequence} {' '.join(words)} "
    return f"{body}*{zlib.crc32(body.encode('ascii')):08X}"


def parse(line: str, sequence: int) -> tuple[bool, list[str]] | None:
    """Whether an answer is OK, and its words; None if it is none to the question of this number."""
    found = _LINE.fullmatch(line) if line.isascii() else None
    if found is None or found[1] != str(sequence):
        return None
    body = line[: line.rindex("*")]
    if int(found[4], 16) != zlib.crc32(body.encode("ascii")):
        return None
    return found[2] == "OK", found[3].split()


class Board:
    """A board with the firmware of the C export: a source and a meter in one.

    Parameters
    ----------
    link : Link
        The line to the board.

    Attributes
    ----------
    low : float
        Lower limit of the input that the firmware keeps, in its unit.
    high : float
        Upper limit.
    patience : float
        Seconds without a question after which the board goes to its safe input.

    Raises
    ------
    InstrumentError
        If what answers is no such board.
    """

    def __init__(self, link: Link) -> None:
        self._link, self._sequence = link, 0
        self._turn, self._on, self._asked = threading.Lock(), False, -math.inf
        words = self._ask("HELLO")
        if len(words) != 5 or words[:2] != ["minorloop", str(VERSION)]:
            raise InstrumentError(
                f"{link.name} answers {' '.join(words)!r}; its firmware speaks another protocol "
                f"than minorloop {VERSION}: export it again"
            )
        self.low, self.high, patience = (number(word, link.name) for word in words[2:])
        if not 1 <= patience <= _LONGEST:
            raise InstrumentError(
                f"{link.name} says that its patience is {patience:g} ms; give it 1 to {_LONGEST}"
            )
        self.patience = 1e-3 * patience

    def set(self, value: float) -> None:
        """Put an input on.

        Raises
        ------
        InstrumentError
            If the board refuses it, has gone to its safe input by itself, or says that another
            is on.
        """
        self._on = True
        found = self._number("SET", repr(float(value)))
        if abs(found - value) > 1e-6 * max(1.0, abs(value)):
            raise InstrumentError(f"{self._link.name} was told {value:g} and has {found:g} on")

    def read(self) -> float:
        """The sensor now."""
        return self._number("GET")

    def step(self, u: float) -> float:
        """What the model in the firmware gives for an input, which it remembers."""
        return self._number("STEP", repr(float(u)))

    def aim(self, y: float) -> float:
        """The input that the model in the firmware asks for."""
        return self._number("AIM", repr(float(y)))

    def safe(self) -> None:
        """Go to the safe input.

        Raises
        ------
        InstrumentError
            If the board does not say that it did. Left alone, it goes there after its patience.
        """
        self._on = False
        self._ask("SAFE")

    def keep_alive(self) -> None:
        """Ask something in time while an input is on, as long as this program runs.

        A hold is longer than the board is patient, and so may be what is done between two holds.
        The board hears nothing from a program that is stopped, dead or cut off.
        """
        threading.Thread(target=_keep, args=(weakref.ref(self),), daemon=True).start()

    def _stay(self) -> float:
        """Ask something if it is time to; gives how long it can wait for the next."""
        every = self.patience / _OFTEN
        if not self._on:
            return every
        left = self._asked + every - time.monotonic()
        if left > 0:
            return left
        with suppress(InstrumentError):  # the next question of the program meets it again
            self._ask("GET")
        return every

    def _number(self, *words: str) -> float:
        answer = self._ask(*words)
        if len(answer) != 1:
            raise InstrumentError(f"{self._link.name} answers {words[0]} with {len(answer)} words")
        value = number(answer[0], self._link.name)
        if not math.isfinite(value):
            raise InstrumentError(f"{self._link.name} answers {words[0]} with {value}")
        return value

    def _ask(self, *words: str) -> list[str]:
        """The words of the answer to this question and no other."""
        with Deferred(), self._turn:
            found = self._converse(*words)
            self._asked = time.monotonic()
        ok, answer = found
        if ok:
            return answer
        if answer == ["safe"]:
            raise InstrumentError(
                f"{self._link.name} went to its safe input by itself: it had heard nothing in "
                "time, or lost its power; what was on is lost, so begin again "
                "from there"
            )
        raise InstrumentError(f"{self._link.name} refuses {' '.join(words)}: {' '.join(answer)}")

    def _converse(self, *words: str) -> tuple[bool, list[str]]:
        """Whether the answer to this question is OK, and its words."""
        self._sequence = (self._sequence + 1) % _MOST
        line = self._link.ask(write(self._sequence, *words))
        for _ in range(_PATIENCE):
            found = parse(line, self._sequence)
            if found is not None:
                return found
            line = self._link.read()
        raise InstrumentError(
            f"{self._link.name} gave no sound answer to {words[0]}, last {line[:60]!r}; check the "
            "cable and the baud rate"
        )


def _keep(kept: weakref.ref[Board]) -> None:
    """Keep a board alive as long as somebody has it."""
    while (board := kept()) is not None:
        wait = board._stay()
        del board
        time.sleep(wait)
