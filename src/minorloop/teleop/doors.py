"""Who may come in: a key that is new at every start, and pages of this server only."""

from __future__ import annotations

import ipaddress
import secrets
import socket
from dataclasses import dataclass, field
from http.cookies import CookieError, SimpleCookie
from urllib.parse import urlsplit

_LOOPBACK = ("127.0.0.1", "localhost", "::1")


@dataclass(frozen=True)
class Doors:
    """The checks at the door.

    Parameters
    ----------
    host : str
        On which the server listens.
    key : str
        What the address that is printed carries.
    token : str
        What a browser that came with the key carries from then on.
    """

    host: str
    key: str = field(default_factory=lambda: secrets.token_urlsafe(24))
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24))

    cookie = "minorloop"

    def opens(self, key: str | None) -> bool:
        """Whether a key is the key."""
        return secrets.compare_digest((key or "").encode(), self.key.encode())

    def known(self, cookies: str | None) -> bool:
        """Whether a Cookie header carries the token."""
        try:
            found = SimpleCookie(cookies or "").get(self.cookie)
        except CookieError:
            return False
        value = "" if found is None else found.value
        return secrets.compare_digest(value.encode(), self.token.encode())

    def serves(self, host: str | None) -> bool:
        """Whether a Host header names this server, so that no other name can be bound to it."""
        try:
            name = urlsplit(f"//{host or ''}").hostname
        except ValueError:
            return False
        if name is None:
            return False
        if name in (*_LOOPBACK, self.host):
            return True
        return self.host not in _LOOPBACK and (_is_address(name) or name == socket.gethostname())

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
