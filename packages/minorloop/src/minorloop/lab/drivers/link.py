"""Exchange lines of text with an instrument."""

import os
import re
import select
import socket
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol

from minorloop.errors import InstrumentError, MissingExtraError, ParameterError
from minorloop.lab.drivers.device import Section
from minorloop.lab.signals import Deferred

_LONGEST = 4096
"""Most characters of an answer."""
_ADVICE = "; connect it, or correct its address (minorloop devices lists what is there)"
_SHOWN = 40
"""Most bytes of an answer without an end that a message shows."""
_LONGEST_MESSAGE = 400
"""Most characters of an error message of a library."""
_PARTING = 1.0
"""Seconds for the other end to receive the last lines, before a connection is closed."""


class _UnendedError(InstrumentError):
    """Only part of an answer came."""


class Link(Protocol):
    """A connection to an instrument that exchanges lines of text."""

    name: str

    def send(self, text: str) -> None:
        """Send one line."""

    def ask(self, text: str) -> str:
        """Send one line, and return the answer.

        Raises an `InstrumentError` if there is no answer in time.
        """

    def read(self) -> str:
        """Return the next line, without a question."""

    def close(self) -> None:
        """Close the connection."""


class LinkSettings(Section, kw_only=True):
    """Keys of a connection in a file; see `VisaLink`."""

    resource: str
    library: str = "@py"
    timeout: float = 2.0
    baud: int | None = None


class VisaLink:
    """A connection through PyVISA: GPIB, USB, LAN, or a serial port.

    Raises a `MissingExtraError` if PyVISA is not installed; an `InstrumentError` if there is no
    such instrument.

    ``resource``: VISA address, such as ``GPIB0::5::INSTR`` or ``ASRL/dev/ttyACM0::INSTR``;
    ``library``: VISA library, ``@py`` for PyVISA-py; ``bench.yaml@sim`` for a simulation;
    ``timeout``: seconds to wait for an answer; ``baud``: baud rate of a serial port.

    Attributes
    ----------
    owed : int
        Most answers that may still arrive after their deadline.
    last_lines : tuple of str
        Lines to send on a network connection in an unknown state before it is closed.
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
        except Exception as error:  # each backend has its own errors
            raise InstrumentError(f"{resource} cannot be opened: {_short(error)}") from None
        self._resource: Any = None
        self._lock: int | None = None
        self._open()

    def send(self, text: str) -> None:
        """Send one line."""
        with Deferred():
            self._settle()
            self._write(text)

    def ask(self, text: str) -> str:
        """Send one line, and return the answer; discard earlier input."""
        with Deferred():
            try:
                self._settle()
                self._discard()
                self._write(text)
                return self._answer()
            except InstrumentError as error:
                raise InstrumentError(f"asked {text!r}, {error}") from None

    def read(self) -> str:
        """Return the next line, without asking."""
        with Deferred():
            self._settle()
            if self._stale:
                self._discard()
            return self._answer()

    def close(self) -> None:
        """Close the connection after all lines have arrived."""
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
            which = "no whole answer" if isinstance(error, _UnendedError) else "no answer"
            raise InstrumentError(
                f"{self.name} gave {which} within {self._timeout:g} s: {_short(error)}; check "
                "its power and cable, and the timeout"
            ) from None
        self._doubtful = False
        self.owed -= 1
        try:
            return line.decode("ascii").strip("\r\n \t")
        except UnicodeDecodeError:
            raise InstrumentError(f"{self.name} answers {line[:60]!r}, which is not text") from None

    def _open(self) -> None:
        try:
            self._keep_others_out()
            resource: Any = self._manager.open_resource(
                self.name, open_timeout=round(1000 * self._timeout)
            )
            if not hasattr(resource, "write"):
                raise InstrumentError("it is not an instrument that takes lines of text")
            resource.timeout = round(1000 * self._timeout)
            resource.read_termination = "\n"
            resource.write_termination = "\n"
            if self._baud is not None:
                resource.baud_rate = self._baud
            self._send_at_once(resource)
        except Exception as error:
            self._let_others_in()
            advice = "" if isinstance(error, InstrumentError) else _ADVICE
            said = f"{self.name} cannot be opened: {_short(error)}{advice}"
            raise InstrumentError(said) from None
        self._resource = resource
        self._socket = resource.resource_class == "SOCKET"
        self._streams = self._socket or self.name.upper().startswith("ASRL")
        # An earlier program may have left half a line on a serial port.
        self._doubtful, self._cut = self._streams and not self._socket, False

    def _send_at_once(self, resource: Any) -> None:
        """Send each line without waiting for the acknowledgement of the previous line."""
        wire = self._wire(resource)
        if wire is not None:
            if failed := wire.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
                raise OSError(failed, os.strerror(failed))
            wire.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        elif resource.resource_class == "SOCKET":
            from pyvisa.constants import ResourceAttribute

            resource.set_visa_attribute(ResourceAttribute.tcpip_nodelay, True)

    def _keep_others_out(self) -> None:
        """Lock a serial port; raise an error if another program uses it.

        The lock comes first, because the library discards input for the other program as it opens.
        """
        from pyvisa.rname import ResourceName

        if not self.name.upper().startswith("ASRL") or sys.platform == "win32":
            return  # Windows lets only one program open a port
        port = getattr(ResourceName.from_string(self.name), "board", "")
        if not Path(port).is_char_device():
            return
        import fcntl

        self._lock = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InstrumentError("another program uses it; end that program") from None

    def _let_others_in(self) -> None:
        lock, self._lock = self._lock, None
        if lock is not None:
            os.close(lock)

    def _session(self, resource: Any) -> Any:
        """Return the session of a resource, if PyVISA-py has opened one."""
        return getattr(self._manager.visalib, "sessions", {}).get(resource.session)

    def _wire(self, resource: Any) -> socket.socket | None:
        """Return the socket of a resource, if PyVISA-py has opened one."""
        wire = getattr(self._session(resource), "interface", None)
        return wire if isinstance(wire, socket.socket) else None

    def _settle(self) -> None:
        """Bring the connection into a known state after a failed exchange."""
        if self._resource is None:
            self._open()
        if not self._doubtful:
            return
        try:
            if self._socket:
                self._let_go()
                self._open()
            elif self._streams:
                # This ends an incomplete line, in a way that the instrument does not understand.
                self._resource.write_raw(b"!\n" if self._cut else b"\n")
                self.owed += 1  # some instruments answer an empty line with an error
                self._stale = True
            else:
                self._resource.clear()
                self.owed = 0
        except Exception as error:
            self._let_go()
            raise InstrumentError(f"{self.name} cannot be used: {_short(error)}") from None
        self._doubtful = self._cut = False

    def _let_go(self) -> None:
        """Close the connection; the next exchange opens it again."""
        resource, self._resource = self._resource, None
        with suppress(Exception):
            wire = self._wire(resource)
            if wire is not None:
                self._part(wire)
        with suppress(Exception):
            resource.close()
        self._let_others_in()
        self.owed = 0

    def _part(self, wire: socket.socket) -> None:
        """Shut a connection down so that all sent lines arrive; closing alone prevents this.

        In an unknown state ``last_lines`` are sent first, so that the instrument reads them last.
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
        """Discard input since the last answer or the last missed deadline."""
        if not self._streams:
            return
        try:
            # Milliseconds without a character after which input has ended: of late answers, and of
            # characters that have already arrived
            self._drain(20 if self._stale else 1)
        except Exception as error:
            self._doubtful = True
            raise InstrumentError(f"{self.name} cannot be asked: {_short(error)}") from None
        self._stale = False

    def _line(self) -> bytes:
        """Return the bytes of a line, which must arrive before one deadline.

        A stream is read byte by byte, because a longer read ends only at a timeout.
        """
        deadline = time.monotonic() + self._timeout
        found = b""
        while not found.endswith(b"\n"):
            if len(found) > _LONGEST or time.monotonic() > deadline:
                raise _unended(found)
            try:
                found += self._some(1 if self._streams else _LONGEST + 1)
            except Exception:
                if not found:
                    raise
                raise _unended(found) from None
            if not self._streams and len(found) <= _LONGEST:
                break  # a message has its own end
        return found

    def _some(self, most: int) -> bytes:
        """Return the bytes of one read of the library; raise an error if there are none."""
        from pyvisa.constants import StatusCode

        self._wait()
        status = StatusCode.success_max_count_read, StatusCode.success_device_not_present
        with self._resource.ignore_warning(*status):
            found, _ = self._resource.visalib.read(self._resource.session, most)
        if not found:
            raise InstrumentError("nothing was received")
        return bytes(found)

    def _wait(self) -> None:
        """Wait for bytes on a socket: PyVISA-py spins if the other end has closed it."""
        wire = self._wire(self._resource)
        received: bytes = getattr(self._session(self._resource), "_pending_buffer", b"")
        if wire is None or received:
            return
        ready, _, _ = select.select([wire], [], [], self._resource.timeout / 1e3)
        if not ready:
            raise InstrumentError("nothing was received")
        if not wire.recv(1, socket.MSG_PEEK):
            raise InstrumentError("the other end closed the connection")

    def _drain(self, quiet: int) -> None:
        """Read a stream until nothing arrives for a number of milliseconds."""
        deadline = time.monotonic() + self._timeout
        self._resource.timeout = quiet
        try:
            while time.monotonic() < deadline:
                self._some(1)
        except Exception:  # each backend has its own error for this
            return
        finally:
            self._resource.timeout = round(1000 * self._timeout)
        raise InstrumentError(f"{self.name} does not stop sending")


def _unended(found: bytes) -> _UnendedError:
    """Return the error for an incomplete answer."""
    more = " and so on" if len(found) > _SHOWN else ""
    return _UnendedError(f"{found[:_SHOWN]!r}{more}, without the end of a line")


def _short(error: Exception) -> str:
    """Return the message of a library without the repeated message of its inner error."""
    message = " ".join(f"{error or type(error).__name__}".split())
    message = re.split(r": (?=\[Errno \d+\])", message)[-1]
    return message if len(message) <= _LONGEST_MESSAGE else f"{message[:_LONGEST_MESSAGE]} ..."


def opened(how: LinkSettings, folder: Path) -> VisaLink:
    """Return a connection; the file of a simulated library is relative to a folder."""
    name, at, kind = how.library.rpartition("@")
    library = f"{folder / name}{at}{kind}" if name else how.library
    return VisaLink(how.resource, library=library, timeout=how.timeout, baud=how.baud)


def number(answer: str, name: str) -> float:
    """Return the number in an answer.

    Raises an `InstrumentError` if it is not exactly one number.
    """
    try:
        if "_" in answer or not answer.isascii():
            raise ValueError
        return float(answer)
    except ValueError:
        raise InstrumentError(f"{name} answers {answer[:80]!r}, which is not a number") from None
