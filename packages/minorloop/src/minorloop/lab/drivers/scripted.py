"""A scripted conversation with an instrument, for testing a driver."""

from collections.abc import Iterable

from minorloop.errors import InstrumentError

SILENCE = "\0silence"
"""Stands for an answer that never comes."""


class Script:
    """A link that checks what a driver sends and gives prepared answers.

    Raises an `AssertionError` when the driver sends something else.

    ``lines``: each line that the driver must send, in order, and the answer: None if there is none,
    `SILENCE` for an answer that never comes. Several answers to one line are separated by newlines.
    """

    def __init__(self, lines: Iterable[tuple[str, str | None]]) -> None:
        self.name = "script"
        self._lines = list(lines)
        self._answers: list[str] = []

    def send(self, text: str) -> None:
        """Check one line."""
        if not self._lines:
            raise AssertionError(f"the driver sends {text!r} after the end of the script")
        expected, answer = self._lines.pop(0)
        if text != expected:
            raise AssertionError(f"the driver sends {text!r}; the script has {expected!r}")
        if answer is not None and answer != SILENCE:
            self._answers += answer.split("\n")

    def ask(self, text: str) -> str:
        """Check one line, and return the answer."""
        self.send(text)
        return self.read()

    def read(self) -> str:
        """Return the next answer.

        Raises an `InstrumentError` if there is none.
        """
        if not self._answers:
            raise InstrumentError(f"{self.name} gave no answer")
        return self._answers.pop(0)

    def close(self) -> None:
        """Do nothing."""

    def finished(self) -> bool:
        """Whether all lines were sent and all answers read."""
        return not self._lines and not self._answers
