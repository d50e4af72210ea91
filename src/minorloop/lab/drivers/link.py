"""Lines of text to an instrument and back."""

from __future__ import annotations

import time
from contextlib import suppress
from typing import Any, Protocol

from minorloop.errors import InstrumentError, MissingExtraError, ParameterError

__all__ = ["Link", "VisaLink"]

LONGEST = 4096
"""Characters of an answer, at most."""
_SAID = 400
"""Characters of what a library says of an error, at most."""
_QUIET, _AT_ONCE = 20, 1
"""Milliseconds without a character after which nothing more is expected; what is there already."""


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
        self._timeout, self._baud, self._late = timeout, baud, False
        try:
            self._manager = pyvisa.ResourceManager(library)
        except Exception as error:  # each backend has errors of its own
            raise InstrumentError(f"{resource} cannot be opened: {_short(error)}") from None
        self._resource: Any = None
        self._open()

    def tell(self, text: str) -> None:
        """Send one line."""
        if self._resource is None:
            self._open()
        try:
            self._resource.write(text)
        except Exception as error:
            self._forget()
            raise InstrumentError(f"{self.name} does not take {text!r}: {_short(error)}") from None

    def ask(self, text: str) -> str:
        """Send one line and give the line that comes back; what came before it is forgotten."""
        try:
            self._forget_late()
            self.tell(text)
            return self.read()
        except InstrumentError as error:
            raise InstrumentError(f"asked {text!r}, {error}") from None

    def read(self) -> str:
        """The next line, without asking."""
        if self._resource is None:
            self._open()
        try:
            line = self._line()
        except Exception as error:
            # What comes late must not be taken for the answer to the next question.
            self._late = True
            self._forget()
            raise InstrumentError(
                f"{self.name} gave no answer within {self._timeout:g} s: {_short(error)}"
            ) from None
        try:
            return line.decode("ascii").strip("\r\n \t")
        except UnicodeDecodeError:
            raise InstrumentError(f"{self.name} answers {line[:60]!r}, which is no text") from None

    def flush(self) -> None:
        """Forget what has come and was not read.

        Raises
        ------
        InstrumentError
            If it does not stop sending, or cannot be opened again.
        """
        if self._resource is None or self._socket:
            # Whatever the other side does with the old connection, it ends there.
            self._let_go()
            self._open()
        elif self._streams:
            self._drain(_QUIET)
        else:
            self._resource.clear()

    def close(self) -> None:
        """Let go of it."""
        self._let_go()
        self._manager.close()

    def _open(self) -> None:
        try:
            resource: Any = self._manager.open_resource(
                self.name, open_timeout=round(1000 * self._timeout)
            )
            if not hasattr(resource, "write"):
                raise InstrumentError("it is no instrument that takes lines of text")
            resource.timeout = round(1000 * self._timeout)
            resource.read_termination = "\n"
            resource.write_termination = "\n"
            if self._baud is not None:
                resource.baud_rate = self._baud
        except Exception as error:
            raise InstrumentError(f"{self.name} cannot be opened: {_short(error)}") from None
        self._resource = resource
        self._socket = resource.resource_class == "SOCKET"
        self._streams = self._socket or self.name.upper().startswith("ASRL")

    def _let_go(self) -> None:
        """Let go of the line; the next question opens it again."""
        with suppress(Exception):
            self._resource.close()
        self._resource = None

    def _forget(self) -> None:
        try:
            self.flush()
        except Exception:
            self._let_go()

    def _forget_late(self) -> None:
        """Forget what came since the last answer, or since one was given up."""
        try:
            if self._resource is not None and self._streams:
                self._drain(_AT_ONCE)
            elif self._late:
                self.flush()
        except Exception as error:
            self._let_go()
            raise InstrumentError(
                f"{self.name} is in no state to be asked: {_short(error)}"
            ) from None
        self._late = False

    def _line(self) -> bytes:
        """Bytes to the end of a line, which has to come by one deadline.

        A stream is read byte by byte, because a longer read ends only when nothing comes.
        """
        deadline = time.monotonic() + self._timeout
        found = b""
        while not found.endswith(b"\n"):
            if len(found) > LONGEST or time.monotonic() > deadline:
                raise InstrumentError(f"{found[:40]!r} and so on, without the end of a line")
            found += self._some(1 if self._streams else LONGEST + 1)
            if not self._streams and len(found) <= LONGEST:
                break  # a message has an end of its own
        return found

    def _some(self, most: int) -> bytes:
        """What one read of the library gives: not nothing, whatever it says of the reason."""
        from pyvisa.constants import StatusCode

        status = StatusCode.success_max_count_read, StatusCode.success_device_not_present
        with self._resource.ignore_warning(*status):
            found, _ = self._resource.visalib.read(self._resource.session, most)
        if not found:
            raise InstrumentError("nothing came")
        return bytes(found)

    def _drain(self, quiet: int) -> None:
        """Read a stream until nothing comes for so many milliseconds."""
        deadline = time.monotonic() + self._timeout
        self._resource.timeout = quiet
        try:
            while time.monotonic() < deadline:
                self._some(1)
        except Exception:  # how each backend says that nothing comes
            return
        finally:
            self._resource.timeout = round(1000 * self._timeout)
        raise InstrumentError(f"{self.name} does not stop sending")


def _short(error: Exception) -> str:
    said = " ".join(f"{error or type(error).__name__}".split())
    return said if len(said) <= _SAID else f"{said[:_SAID]} ..."
