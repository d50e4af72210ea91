"""Lines of text to an instrument and back."""

from __future__ import annotations

from contextlib import suppress
from typing import Any, Protocol

from minorloop.errors import InstrumentError, MissingExtraError, ParameterError

__all__ = ["Link", "VisaLink"]

LONGEST = 4096
_AT_ONCE, _MOST_LINES = 20, 64


class Link(Protocol):
    """A line to an instrument."""

    name: str

    def tell(self, text: str) -> None:
        """Send one line."""

    def ask(self, text: str) -> str:
        """Send one line and give the line that comes back.

        Raises
        ------
        InstrumentError
            If nothing comes in time.
        """

    def read(self) -> str:
        """The next line, without asking."""

    def flush(self) -> None:
        """Forget what has come and was not read."""

    def close(self) -> None:
        """Let go of it."""


class VisaLink:
    """An instrument that PyVISA reaches: GPIB, USB, LAN, or a serial port.

    Parameters
    ----------
    resource : str
        VISA address, such as ``GPIB0::5::INSTR`` or ``ASRL/dev/ttyACM0::INSTR``.
    library : str
        VISA library, ``@py`` for PyVISA-py; ``bench.yaml@sim`` for a simulation.
    timeout : float
        Seconds to wait for an answer.
    baud : int, optional
        Of a serial port.

    Raises
    ------
    MissingExtraError
        If PyVISA is not installed.
    InstrumentError
        If there is no such instrument.
    """

    def __init__(
        self, resource: str, *, library: str = "@py", timeout: float = 2.0, baud: int | None = None
    ) -> None:
        try:
            import pyvisa
        except ImportError:
            raise MissingExtraError("pyvisa", "instruments") from None
        if not 0 < timeout <= 3600:
            raise ParameterError(f"timeout is {timeout!r} s; give a time up to an hour")
        self.name = resource
        self._timeout, self._late = timeout, False
        try:
            self._manager = pyvisa.ResourceManager(library)
            self._resource: Any = self._manager.open_resource(resource)
            if not hasattr(self._resource, "write"):
                raise InstrumentError("it is no instrument that takes lines of text")
            self._resource.timeout = round(1000 * timeout)
            self._resource.read_termination = "\n"
            self._resource.write_termination = "\n"
            if baud is not None:
                self._resource.baud_rate = baud
        except Exception as error:  # each backend has errors of its own
            raise InstrumentError(f"{resource} cannot be opened: {_short(error)}") from None

    def tell(self, text: str) -> None:
        """Send one line."""
        if self._late:  # an answer that was given up may have come since
            self.flush()
            self._late = False
        try:
            self._resource.write(text)
        except Exception as error:
            raise InstrumentError(f"{self.name} does not take {text!r}: {_short(error)}") from None

    def ask(self, text: str) -> str:
        """Send one line and give the line that comes back."""
        self.tell(text)
        try:
            return self.read()
        except InstrumentError as error:
            raise InstrumentError(f"asked {text!r}, {error}") from None

    def read(self) -> str:
        """The next line, without asking."""
        try:
            answer = str(self._resource.read())
        except Exception as error:
            # What comes late must not be taken for the answer to the next question.
            self._late = True
            self.flush()
            raise InstrumentError(
                f"{self.name} gave no answer within {self._timeout:g} s: {_short(error)}"
            ) from None
        if len(answer) > LONGEST:
            raise InstrumentError(f"{self.name} answers with {len(answer)} characters")
        return answer.strip("\r\n \t")

    def flush(self) -> None:
        """Forget what has come and was not read."""
        try:
            self._resource.clear()
        except Exception:  # not every interface can; read what there is
            with suppress(Exception):
                self._resource.timeout = _AT_ONCE
                for _ in range(_MOST_LINES):
                    self._resource.read_raw()
        finally:
            self._resource.timeout = round(1000 * self._timeout)

    def close(self) -> None:
        """Let go of it."""
        self._resource.close()
        self._manager.close()


def _short(error: Exception) -> str:
    return " ".join(f"{error or type(error).__name__}".split())[:200]
