"""Authentication: a key that is new at every start, and the origin of requests."""

import ipaddress
import re
import secrets
import socket
import ssl
from dataclasses import dataclass, field
from pathlib import Path

from minorloop.errors import ParameterError

WAITING = 128
"""Most connections that wait until the server accepts them, and that it accepts together."""
_LOOPBACK = ("127.0.0.1", "localhost", "::1")
_HOST = re.compile(r"(?:\[([0-9a-f:.]{2,45})\]|([a-z0-9._-]{1,253}))(?::[0-9]{1,5})?", re.I)
"""A Host header that is safe to repeat in an answer: an address or a name, and a port."""


@dataclass(frozen=True)
class Authentication:
    """Keys and host names to check requests against."""

    host: str
    """Address on which the server listens."""
    key: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    """Key in the printed address."""
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    """Cookie of a browser that has sent the key."""
    port: int = 0
    """Port on which the server listens."""
    name: str | None = None
    """Host name of a proxy in front of the server."""

    @property
    def cookie(self) -> str:
        """Name of the cookie; browsers share cookies between the ports of a host."""
        return f"minorloop-{self.port}"

    def is_key(self, key: str | None) -> bool:
        """Return whether this is the key."""
        return secrets.compare_digest((key or "").encode(), self.key.encode())

    def has_token(self, cookies: str | None) -> bool:
        """Return whether a Cookie header contains the token."""
        token = self.token.encode()
        found = False
        for pair in (cookies or "").split(";"):
            name, _, value = pair.partition("=")
            if name.strip() == self.cookie:
                found |= secrets.compare_digest(value.strip().encode(), token)
        return found

    def is_own_host(self, host: str | None) -> bool:
        """Return whether a Host header names this server; this prevents DNS rebinding."""
        match = _HOST.fullmatch(host or "")
        if match is None:
            return False
        name = (match[1] or match[2]).lower()
        if name in (*_LOOPBACK, self.host.lower(), (self.name or self.host).lower()):
            return True
        if self.host in _LOOPBACK:
            return False
        return _is_address(name) or name == socket.gethostname().lower()

    def is_own_page(self, origin: str | None, host: str | None) -> bool:
        """Return whether an Origin header is that of a page of this server."""
        if not origin or not self.is_own_host(host):
            return False
        return origin in (f"http://{host}", f"https://{host}")


@dataclass(frozen=True, kw_only=True)
class Serving:
    """Socket on which a server listens, and its authentication."""

    authentication: Authentication
    listening: socket.socket
    """Bound socket; a restarted server uses the same."""
    certificate: Path | None = None
    private_key: Path | None = None
    """Files of certificate and private key, for https."""

    @property
    def address(self) -> str:
        """Address for the browser, with the key."""
        known = self.authentication
        scheme = "http" if self.certificate is None else "https"
        place = f"{scheme}://{_shown(known.host)}:{known.port}"
        if known.name is not None:
            place = f"https://{known.name}"
        return f"{place}/?key={known.key}"


def check_address(
    port: int, name: str | None, certificate: Path | None, private_key: Path | None
) -> None:
    """Raise a `ParameterError` for an invalid port, name of a proxy, or file for https."""
    if not 0 <= port <= 65535:
        raise ParameterError(f"--port is {port}; give 0 to 65535")
    if name is not None and re.fullmatch(r"[A-Za-z0-9._-]{1,253}", name) is None:
        raise ParameterError(f"--name is {name!r}; give a host name such as lab.example.org")
    if (certificate is None) != (private_key is None):
        raise ParameterError("give --certificate and --private-key together, or neither")
    for file in (certificate, private_key):
        if file is not None and not file.is_file():
            raise ParameterError(f"{file} is not a file; give a PEM file")
    if certificate is not None and private_key is not None:
        _check_pair(certificate, private_key)


def listen(
    host: str, port: int, name: str | None, certificate: Path | None, private_key: Path | None
) -> Serving:
    """Listen on an address.

    Raises a `ParameterError` if the port is in use, or the host is invalid.
    """
    listening = _listening(host, port)
    authentication = Authentication(host, port=listening.getsockname()[1], name=name)
    return Serving(
        authentication=authentication,
        listening=listening,
        certificate=certificate,
        private_key=private_key,
    )


def _check_pair(certificate: Path, key: Path) -> None:
    """Refuse a certificate that the server cannot use, before the address is printed."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        # Without a password openssl would ask for one.
        context.load_cert_chain(certificate, key, password="")
    except (OSError, ValueError) as error:  # errors of ssl are OSErrors
        reason = getattr(error, "reason", None) or error
        raise ParameterError(
            f"{certificate} and {key} are not a certificate and its private key ({reason}); give "
            "PEM files that belong together, the key without a password"
        ) from None


def _listening(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    found = socket.socket(family, socket.SOCK_STREAM)
    found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        found.bind((host, port))
        found.listen(WAITING)  # clients that connect before the start of the server wait
    except OSError as error:
        found.close()
        other = "--host" if isinstance(error, socket.gaierror) else "--port"
        raise ParameterError(
            f"cannot listen on {host} port {port}: {error.strerror or error}; give another {other}"
        ) from None
    return found


def _shown(host: str) -> str:
    """Return the host as written in an address."""
    if host in ("0.0.0.0", "::"):
        return socket.gethostname()
    return f"[{host}]" if ":" in host else host


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def is_loopback(address: str) -> bool:
    """Return whether an address is a loopback address of this machine."""
    try:
        found = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return False
    mapped = getattr(found, "ipv4_mapped", None)
    return found.is_loopback or (mapped is not None and mapped.is_loopback)
