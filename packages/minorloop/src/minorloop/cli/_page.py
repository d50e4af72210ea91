"""Options of verbs that serve pages, and the socket on which they listen."""

from __future__ import annotations

import re
import socket
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from minorloop.cli import _common
from minorloop.errors import ParameterError

if TYPE_CHECKING:
    from minorloop.page.auth import Serving

Host = Annotated[
    str,
    typer.Option(help="Address to listen on; 0.0.0.0 accepts other machines with the key."),
]
Port = Annotated[int, _common.whole_option("Port to listen on; 0 takes any that is free.")]
Certificate = Annotated[
    Path | None,
    typer.Option(help="Certificate (PEM), for https."),
]
Name = Annotated[
    str | None,
    typer.Option(help="Host name of an https proxy in front of the server."),
]
Key = Annotated[Path | None, typer.Option("--private-key", help="Its private key (PEM).")]
_WAITING = 128
"""Connections that wait before the server accepts them."""


def check(port: int, name: str | None, certificate: Path | None, private_key: Path | None) -> None:
    """Refuse options that cannot be used, before anything is started."""
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
    host: str,
    port: int,
    name: str | None,
    certificate: Path | None,
    private_key: Path | None,
    page: Path,
) -> Serving:
    """Listen, and print the address of a page, with a note if it is not built."""
    from minorloop.page.auth import Authentication, Serving

    listening = _listening(host, port)
    port = listening.getsockname()[1]
    authentication = Authentication(host, port=port, name=name)
    scheme = "http" if certificate is None else "https"
    if not page.is_file():
        typer.echo("note: the pages are not built; 'make pages' builds them", err=True)
    address = f"{scheme}://{_shown(host)}:{port}" if name is None else f"https://{name}"
    typer.echo(f"open {address}/?key={authentication.key}")
    return Serving(
        authentication=authentication,
        listening=listening,
        certificate=certificate,
        private_key=private_key,
    )


def _check_pair(certificate: Path, key: Path) -> None:
    """Refuse a certificate that the server cannot use, before the address is printed."""
    import ssl

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
    """Return a listening socket; a port in use is refused."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    found = socket.socket(family, socket.SOCK_STREAM)
    found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        found.bind((host, port))
        found.listen(_WAITING)  # clients that connect before the server has started wait
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
