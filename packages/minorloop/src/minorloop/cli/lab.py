"""``minorloop lab``: the lab page, in a browser."""

from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from minorloop.cli import _page
from minorloop.errors import MissingExtraError, OutputError
from minorloop.lab.signals import Stopped, ended_by_signals

NAME = "lab"
EXAMPLE = "minorloop lab --port 8765"

_Folder = Annotated[
    Path | None,
    typer.Option(
        help="Folder for files that are dropped, which are deleted at the end; that of the system "
        "for temporary files without it."
    ),
]


def run(
    host: _page.Host = "127.0.0.1",
    port: _page.Port = 8765,
    folder: _Folder = None,
    certificate: _page.Certificate = None,
    private_key: _page.Key = None,
    name: _page.Name = None,
) -> None:
    """Identify models from files that you drop, in a browser."""
    _page.check(port, name, certificate, private_key)
    if folder is not None and not folder.is_dir():
        raise OutputError(f"{folder} is not a folder; give one that exists")
    try:
        from minorloop.page import lab, serving
    except ImportError:
        raise MissingExtraError("starlette", "page") from None
    how = _page.listen(host, port, name, certificate, private_key, lab.STATIC / "lab.html")
    typer.echo("Ctrl-C ends the lab")
    with suppress(Stopped), ended_by_signals(exiting=True):
        serving.serve(lab.application(how.authentication, lab.LabPage(folder=folder)), how)
