"""The serial protocol of the firmware of the C export.

A question is one line of printable ASCII, and so is its answer::

    7 SET 0.25 *1C291CA3        question: number, command, arguments, CRC-32 of the text before
    7 OK 0.25 *40C4B8B3         answer: same number, OK or ERR, values, CRC-32

============  =====================  ====================================================
``HELLO``     ``minorloop 2 L H P``  protocol, version, limits of the input, patience in ms
``SET u``     ``u``                  apply an input; ERR if it is beyond the limits
``GET``       ``y``                  read the sensor
``STEP u``    ``y``                  output of the model in the firmware for an input
``AIM y``     ``u``                  input of the model for a target
``SAFE``                             go to the safe input
============  =====================  ====================================================

An answer counts only if it has the number of the question and a correct checksum. Late, duplicated
and damaged answers are discarded.

The firmware goes to the safe input by itself when it has received nothing for its patience, one
second by default. If an input was on, it then answers ``ERR safe`` to ``SET`` and ``GET`` until it
receives ``HELLO`` or ``SAFE``, because a reading would not belong to the input that was set. After
a power cut it does the same. `Board.keep_alive` sends questions often enough while an input is on.
"""

import math
import re
import threading
import time
import weakref
import zlib
from collections.abc import Sequence
from contextlib import suppress

from minorloop.errors import InstrumentError, counted
from minorloop.lab.drivers.link import Link, number
from minorloop.lab.signals import Deferred

_LINE = re.compile(r"(\d{1,5}) (OK|ERR)((?: [!-)+-~]{1,40}){0,8}) \*([0-9A-F]{8})")
_MOST = 65_536
_LONGEST = 3_600_000
_OFTEN = 3
"""Least number of questions within the patience of a board while an input is on."""


def write(sequence: int, *words: str) -> str:
    """Return a line with its number and its checksum."""
    body = f"{sequence} {' '.join(words)} "
    return f"{body}*{zlib.crc32(body.encode('ascii')):08X}"


def parse(line: str, sequence: int) -> tuple[bool, list[str]] | None:
    """Return whether an answer is OK, and its words; None if it answers another question."""
    found = _LINE.fullmatch(line) if line.isascii() else None
    if found is None or found[1] != str(sequence):
        return None
    body = line[: line.rindex("*")]
    if int(found[4], 16) != zlib.crc32(body.encode("ascii")):
        return None
    return found[2] == "OK", found[3].split()


class BoardLine:
    """The line to a board: it asks questions, checks answers, and keeps the board alive.

    ``link``: the connection to the board.

    Attributes
    ----------
    hello : list of str
        Answer of the board to ``HELLO``.
    patience : float
        Seconds without a question until the board goes to its safe input.
    """

    def __init__(self, link: Link) -> None:
        self._link, self._sequence = link, 0
        self._turn, self._on, self._asked = threading.Lock(), False, -math.inf
        self.patience = 1.0
        self.hello = self._ask("HELLO")

    def keep_alive(self) -> None:
        """Send questions while an input is on, as long as this program runs.

        Holds, and the time between two holds, may be longer than the patience of the board. If the
        program is stopped or ends, or the cable is pulled, the board receives nothing.
        """
        threading.Thread(target=_keep, args=(weakref.ref(self),), daemon=True).start()

    def _wait_at_most(self, patience: str) -> None:
        """Store the patience of the board, a text in ms."""
        found = number(patience, self._link.name)
        if not 1 <= found <= _LONGEST:
            raise InstrumentError(
                f"{self._link.name} has a patience of {found:g} ms; set it to 1 to {_LONGEST}"
            )
        self.patience = 1e-3 * found

    def _stay(self) -> float:
        """Send a question if it is due; return the waiting time until the next, in seconds."""
        every = self.patience / _OFTEN
        if not self._on:
            return every
        left = self._asked + every - time.monotonic()
        if left > 0:
            return left
        with suppress(InstrumentError):  # the next question of the program has the same error
            self._ask("GET")
        return every

    def _numbers(self, count: int, *words: str) -> list[float]:
        """Return the numbers of an answer, which has ``count`` of them."""
        answer = self._ask(*words)
        if len(answer) != count:
            raise InstrumentError(
                f"{self._link.name} answers {words[0]} with {counted(len(answer), 'word')}"
            )
        values = [number(word, self._link.name) for word in answer]
        for value in values:
            if not math.isfinite(value):
                raise InstrumentError(f"{self._link.name} answers {words[0]} with {value}")
        return values

    def _apply(self, values: Sequence[float], *words: str, command: str = "SET") -> None:
        """Set the inputs, or targets; raise an error if the answer differs."""
        self._on = True
        found = self._numbers(len(values), command, *words)
        for value, answer in zip(values, found, strict=True):
            if abs(answer - value) > 1e-6 * max(1.0, abs(value)):
                raise InstrumentError(
                    f"{self._link.name} was set to {value:g} and answers {answer:g}"
                )

    def _ask(self, *words: str) -> list[str]:
        """Return the words of the answer to this question."""
        with Deferred(), self._turn:
            found = self._converse(*words)
            self._asked = time.monotonic()
        ok, answer = found
        if ok:
            return answer
        if answer == ["safe"]:
            raise InstrumentError(
                f"{self._link.name} went to its safe input by itself: it received nothing in time, "
                "or its power was cut; the input is off, so begin again from there"
            )
        raise InstrumentError(f"{self._link.name} refuses {' '.join(words)}: {' '.join(answer)}")

    def _converse(self, *words: str) -> tuple[bool, list[str]]:
        """Return whether the answer to this question is OK, and its words."""
        self._sequence = (self._sequence + 1) % _MOST
        line = self._link.ask(write(self._sequence, *words))
        for _ in range(8):  # wrong answers that are discarded before the question fails
            found = parse(line, self._sequence)
            if found is not None:
                return found
            try:
                line = self._link.read()
            except InstrumentError:
                if not line:  # an empty line is not an answer
                    raise
                break
        raise InstrumentError(
            f"{self._link.name} gave no valid answer to {words[0]}, last {line[:60]!r}; check the "
            "cable and the baud rate"
        )


def _keep(kept: weakref.ref[BoardLine]) -> None:
    """Keep a board alive as long as it is referenced."""
    while (board := kept()) is not None:
        wait = board._stay()
        del board
        time.sleep(wait)
