"""Who may come in: a key that is new at every start, and pages of this server only."""

from __future__ import annotations

import ipaddress
import re
import secrets
import socket
from dataclasses import dataclass, field

_LOOPBACK = ("127.0.0.1", "localhost", "::1")
_HOST = re.compile(r"(?:\[([0-9a-f:.]{2,45})\]|([a-z0-9._-]{1,253}))(?::[0-9]{1,5})?", re.I)
"""A Host header that may be repeated in an answer: an address or a name, and a port."""


@dataclass(frozen=True)
class Authentication:
    """The checks at the door.

    Parameters
    ----------
    host : str
        On which the server listens.
    key : str
        What the address that is printed carries.
    token : str
        What a browser that came with the key carries from then on.
    port : int
        On which the server listens.
    name : str, optional
        Under which browsers reach a proxy that stands before the server.
    """

    host: str
    key: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    port: int = 0
    name: str | None = None

    @property
    def cookie(self) -> str:
        """Name of the cookie; browsers do not keep apart those of two ports of a host."""
        return f"minorloop-{self.port}"

    def opens(self, key: str | None) -> bool:
        """Whether a key is the key."""
        return secrets.compare_digest((key or "").encode(), self.key.encode())

    def known(self, cookies: str | None) -> bool:
        """Whether a Cookie header carries the token, whatever else is in it."""
        token = self.token.encode()
        found = False
        for pair in (cookies or "").split(";"):
            name, _, value = pair.partition("=")
            if name.strip() == self.cookie:
                found |= secrets.compare_digest(value.strip().encode(), token)
        return found

    def serves(self, host: str | None) -> bool:
        """Whether a Host header names this server, so that no other name can be bound to it."""
        match = _HOST.fullmatch(host or "")
        if match is None:
            return False
        name = (match[1] or match[2]).lower()
        if name in (*_LOOPBACK, self.host.lower(), (self.name or self.host).lower()):
            return True
        if self.host in _LOOPBACK:
            return False
        return _is_address(name) or name == socket.gethostname().lower()

    def own(self, origin: str | None, host: str | None) -> bool:
        """Whether an Origin header is that of a page of this server."""
        if not origin or not self.serves(host):
            return False
        return origin in (f"http://{host}", f"https://{host}")


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def is_loopback(address: str) -> bool:
    """Whether an address is one of this machine's own."""
    try:
        found = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return False
    mapped = getattr(found, "ipv4_mapped", None)
    return found.is_loopback or (mapped is not None and mapped.is_loopback)
