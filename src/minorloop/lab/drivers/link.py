"""Lines of text to an instrument and back."""

from __future__ import annotations

import os
import socket
import time
from contextlib import suppress
from typing import Any, Protocol

from minorloop.errors import InstrumentError, MissingExtraError, ParameterError
from minorloop.lab.signals import Deferred

__all__ = ["Link", "VisaLink"]

LONGEST = 4096
"""Characters of an answer, at most."""
_SAID = 400
"""Characters of what a library says of an error, at most."""
_QUIET, _AT_ONCE = 20, 1
"""Milliseconds without a character after which nothing more is expected; what is there already."""
_PARTING = 1.0
"""Seconds for the other end to take what was sent, before a connection is closed."""


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

    Attributes
    ----------
    owed : int
        Answers that were given up and may still come, at most.
    last_lines : tuple of str
        What is sent last on a network connection in doubt before it is given up.

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
        self.name, self.owed = resource, 0
        self.last_lines: tuple[str, ...] = ()
        self._timeout, self._baud = timeout, baud
        self._doubtful = self._cut = self._stale = False
        try:
            self._manager = pyvisa.ResourceManager(library)
        except Exception as error:  # each backend has errors of its own
            raise InstrumentError(f"{resource} cannot be opened: {_short(error)}") from None
        self._resource: Any = None
        self._open()

    def tell(self, text: str) -> None:
        """Send one line."""
        with Deferred():
            self._settle()
            self._write(text)

    def ask(self, text: str) -> str:
        """Send one line and give the line that comes back; what came before it is forgotten."""
        with Deferred():
            try:
                self._settle()
                self._discard()
                self._write(text)
                return self._answer()
            except InstrumentError as error:
                raise InstrumentError(f"asked {text!r}, {error}") from None

    def read(self) -> str:
        """The next line, without asking."""
        with Deferred():
            self._settle()
            if self._stale:
                self._discard()
            return self._answer()

    def flush(self) -> None:
        """Forget what has come and was not read.

        Raises
        ------
        InstrumentError
            If it does not stop sending, or cannot be opened again.
        """
        with Deferred():
            if self._resource is None or self._socket:
                # Whatever the other side does with the old connection, it ends there.
                self._let_go()
                self._open()
            elif self._streams:
                self._drain(_QUIET)
            else:
                self._resource.clear()

    def close(self) -> None:
        """Let go of it; what was sent arrives."""
        with Deferred():
            self._let_go()
            if not self._manager.list_opened_resources():  # links of a library share its manager
                self._manager.close()

    def _write(self, text: str) -> None:
        self._doubtful = self._cut = True
        try:
            self._resource.write(text)
        except Exception as error:
            raise InstrumentError(f"{self.name} does not take {text!r}: {_short(error)}") from None
        self._doubtful = self._cut = False

    def _answer(self) -> str:
        self._doubtful = True
        self.owed += 1
        try:
            line = self._line()
        except Exception as error:
            raise InstrumentError(
                f"{self.name} gave no answer within {self._timeout:g} s: {_short(error)}"
            ) from None
        self._doubtful = False
        self.owed -= 1
        try:
            return line.decode("ascii").strip("\r\n \t")
        except UnicodeDecodeError:
            raise InstrumentError(f"{self.name} answers {line[:60]!r}, which is no text") from None

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
            self._send_at_once(resource)
        except Exception as error:
            raise InstrumentError(f"{self.name} cannot be opened: {_short(error)}") from None
        self._resource = resource
        self._socket = resource.resource_class == "SOCKET"
        self._streams = self._socket or self.name.upper().startswith("ASRL")
        # Who had a serial port before may have left half a line there.
        self._doubtful, self._cut = self._streams and not self._socket, False

    def _send_at_once(self, resource: Any) -> None:
        """Let no line wait in the queue of a socket for the one before to be acknowledged."""
        wire = self._wire(resource)
        if wire is not None:
            if failed := wire.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
                raise OSError(failed, os.strerror(failed))
            wire.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        elif resource.resource_class == "SOCKET":
            from pyvisa.constants import ResourceAttribute

            resource.set_visa_attribute(ResourceAttribute.tcpip_nodelay, True)

    def _wire(self, resource: Any) -> socket.socket | None:
        """The socket under a resource, where PyVISA-py has opened one."""
        sessions = getattr(self._manager.visalib, "sessions", {})
        wire = getattr(sessions.get(resource.session), "interface", None)
        return wire if isinstance(wire, socket.socket) else None

    def _settle(self) -> None:
        """Bring the line into a known state, after an exchange that did not end as it should."""
        if self._resource is None:
            self._open()
        if not self._doubtful:
            return
        try:
            if self._socket:
                self._let_go()
                self._open()
            elif self._streams:
                # What was cut off becomes a line of its own, and one that says nothing.
                self._resource.write_raw(b"!\n" if self._cut else b"\n")
                self.owed += 1  # some complain of an empty line
                self._stale = True
            else:
                self._resource.clear()
                self.owed = 0
        except Exception as error:
            self._let_go()
            raise InstrumentError(
                f"{self.name} is in no state to be used: {_short(error)}"
            ) from None
        self._doubtful = self._cut = False

    def _let_go(self) -> None:
        """Let go of the line; the next exchange opens it again."""
        resource, self._resource = self._resource, None
        with suppress(Exception):
            wire = self._wire(resource)
            if wire is not None:
                self._part(wire)
        with suppress(Exception):
            resource.close()
        self.owed = 0

    def _part(self, wire: socket.socket) -> None:
        """End a connection so that all that was sent arrives, which closing alone prevents.

        On one that is in doubt the last lines are sent before: whenever the instrument comes to
        read it, it ends with them.
        """
        end = time.monotonic() + min(self._timeout, _PARTING)
        wire.settimeout(min(self._timeout, _PARTING))
        if self._doubtful:
            lines = [*(["!"] if self._cut else []), *self.last_lines]
            wire.sendall("".join(f"{line}\n" for line in lines).encode())
        wire.shutdown(socket.SHUT_WR)
        while (left := end - time.monotonic()) > 0:
            wire.settimeout(left)
            if not wire.recv(65_536):
                break

    def _discard(self) -> None:
        """Forget what came since the last answer, or since one was given up."""
        if not self._streams:
            return
        try:
            self._drain(_QUIET if self._stale else _AT_ONCE)
        except Exception as error:
            self._doubtful = True
            raise InstrumentError(
                f"{self.name} is in no state to be asked: {_short(error)}"
            ) from None
        self._stale = False

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
