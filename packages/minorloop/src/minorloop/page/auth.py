"""Authentication: a key that is new at every start, and requests of this server's pages only."""

from __future__ import annotations

import ipaddress
import re
import secrets
import socket
from dataclasses import dataclass, field
from pathlib import Path

_LOOPBACK = ("127.0.0.1", "localhost", "::1")
_HOST = re.compile(r"(?:\[([0-9a-f:.]{2,45})\]|([a-z0-9._-]{1,253}))(?::[0-9]{1,5})?", re.I)
"""A Host header that is safe to repeat in an answer: an address or a name, and a port."""


@dataclass(frozen=True)
class Authentication:
    """Keys and host names that requests are checked against."""

    host: str
    """Address on which the server listens."""
    key: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    """Part of the printed address."""
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
        """Return whether a Cookie header holds the token, among any others."""
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
    """Where a server listens, and whom it admits."""

    authentication: Authentication
    listening: socket.socket
    """Bound; a restarted server uses the same."""
    certificate: Path | None = None
    private_key: Path | None = None
    """Files, for https."""


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
