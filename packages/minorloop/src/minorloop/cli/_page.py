"""Options of verbs that serve pages, and the socket on which they listen."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from minorloop.cli import _common

if TYPE_CHECKING:
    from minorloop.page.auth import Serving

Host = Annotated[
    str, typer.Option(help="Address to listen on; 0.0.0.0 accepts other machines with the key.")
]
Port = Annotated[int, _common.whole_option("Port to listen on; 0 takes any that is free.")]
Certificate = Annotated[Path | None, typer.Option(help="Certificate (PEM), for https.")]
Name = Annotated[
    str | None, typer.Option(help="Host name of an https proxy in front of the server.")
]
Key = Annotated[Path | None, typer.Option("--private-key", help="Its private key (PEM).")]


def check(port: int, name: str | None, certificate: Path | None, private_key: Path | None) -> None:
    """Refuse options that cannot be used, before anything is started."""
    from minorloop.page.auth import check_address

    check_address(port, name, certificate, private_key)


def listen(
    host: str,
    port: int,
    name: str | None,
    certificate: Path | None,
    private_key: Path | None,
    page: Path,
) -> Serving:
    """Listen, and print the address of a page, with a note if it is not built."""
    from minorloop.page.auth import listen

    found = listen(host, port, name, certificate, private_key)
    if not page.is_file():
        typer.echo("note: the pages are not built; 'make pages' builds them", err=True)
    typer.echo(f"open {found.address}")
    return found
