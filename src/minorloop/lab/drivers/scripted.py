"""A conversation written down: what a driver has to say, and what it hears back."""

from __future__ import annotations

from collections.abc import Iterable

from minorloop.errors import InstrumentError

__all__ = ["SILENCE", "Script"]

SILENCE = "\0silence"
"""An answer that does not come."""


class Script:
    """A link that knows how the conversation has to go, for testing a driver.

    Parameters
    ----------
    lines : iterable of (str, str or None)
        Each line that the driver has to send, in order, and the answer; None where none is
        due, `SILENCE` for an answer that never comes. Several answers to one line are separated
        by newlines.

    Raises
    ------
    AssertionError
        When the driver says something else, or nothing more where `finished` is asked for.
    """

    def __init__(self, lines: Iterable[tuple[str, str | None]]) -> None:
        self.name = "script"
        self._lines = list(lines)
        self._heard: list[str] = []

    def tell(self, text: str) -> None:
        """Take one line."""
        if not self._lines:
            raise AssertionError(f"the driver says {text!r} after the end of the script")
        expected, answer = self._lines.pop(0)
        if text != expected:
            raise AssertionError(f"the driver says {text!r}; the script has {expected!r}")
        if answer is not None and answer != SILENCE:
            self._heard += answer.split("\n")

    def ask(self, text: str) -> str:
        """Take one line and give the answer."""
        self.tell(text)
        return self.read()

    def read(self) -> str:
        """The next answer.

        Raises
        ------
        InstrumentError
            If none comes.
        """
        if not self._heard:
            raise InstrumentError(f"{self.name} gave no answer")
        return self._heard.pop(0)

    def flush(self) -> None:
        """Forget what has come and was not read."""
        self._heard.clear()

    def close(self) -> None:
        """Do nothing."""

    def finished(self) -> bool:
        """Whether all of the script has been said and heard."""
        return not self._lines and not self._heard
