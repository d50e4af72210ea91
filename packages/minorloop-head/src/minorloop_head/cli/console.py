"""``minorloop console``: the operate page and the lab page, in a browser."""

from __future__ import annotations

import re
import socket
import ssl
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from minorloop.cli import _common
from minorloop.errors import OutputError, ParameterError

if TYPE_CHECKING:
    from minorloop_head.procedures.head_file import HeadFile

NAME = "console"
EXAMPLE = "minorloop console --folder inspections"

_Host = Annotated[
    str,
    typer.Option(help="Address to listen on; 0.0.0.0 accepts other machines with the key."),
]
_WAITING = 128
"""Connections that wait before the server accepts them."""
_Port = Annotated[int, _common.whole_option("Port to listen on; 0 takes any that is free.")]
_Plant = Annotated[
    str,
    typer.Option(
        help="The plant: twin:pipe, a simulated head in a pipe, with camera and probe; or a head "
        "with --camera and --head: bench:FILE, module:PACKAGE.FACTORY and so on."
    ),
]
_Folder = Annotated[Path, typer.Option(help="Folder for recorded sessions.")]
_Specimen = Annotated[
    int | None, _common.whole_option("Seed of the simulated specimen; nominal without it.")
]
_Seed = Annotated[int, _common.whole_option("Seed of the simulated noise.")]
_Timeout = Annotated[
    float,
    _common.number_option("Seconds without a message of the operator until the head holds."),
]
_Certificate = Annotated[
    Path | None,
    typer.Option(help="Certificate (PEM): phones and headsets send their pose over https only."),
]
_Name = Annotated[
    str | None,
    typer.Option(help="Host name of an https proxy in front of the console."),
]
_Tracker = Annotated[
    str | None,
    typer.Option(
        help="Where a tracker of your head sends its poses, by the UDP protocol of OpenTrack: "
        "udp:4242, or udp:0.0.0.0:4242 for one on another machine; the browser's pose without it."
    ),
]
_Head = Annotated[
    Path | None,
    typer.Option(
        help="File of the head, as head identify writes it; a simulated head is identified at the "
        "start without it."
    ),
]
_Camera = Annotated[
    str | None,
    typer.Option(
        help="The camera: camera:0, camera:/dev/video0, camera:rtsp://..., camera:http://... "
        "(MJPEG), a video, or a folder of images; that of the plant without it."
    ),
]
_Key = Annotated[Path | None, typer.Option("--private-key", help="Its private key (PEM).")]


def run(
    host: _Host = "127.0.0.1",
    port: _Port = 8765,
    plant: _Plant = "twin:pipe",
    folder: _Folder = Path("console"),
    specimen: _Specimen = None,
    seed: _Seed = 0,
    timeout: _Timeout = 0.1,
    certificate: _Certificate = None,
    private_key: _Key = None,
    name: _Name = None,
    tracker: _Tracker = None,
    head: _Head = None,
    camera: _Camera = None,
) -> None:
    """Steer the head of a catheter in a pipe, and identify models, in a browser."""
    from minorloop_head.console.settings import STATIC, LoopSettings

    if not 0 <= port <= 65535:
        raise ParameterError(f"--port is {port}; give 0 to 65535")
    for option, number in (("--specimen", specimen or 0), ("--seed", seed)):
        if number < 0:
            raise ParameterError(f"{option} is {number}; give 0 or more")
    if name is not None and re.fullmatch(r"[A-Za-z0-9._-]{1,253}", name) is None:
        raise ParameterError(f"--name is {name!r}; give a host name such as console.example.org")
    if not 0.05 <= timeout <= 5.0:
        raise ParameterError(f"--timeout is {timeout}; give 0.05 to 5 seconds")
    if (certificate is None) != (private_key is None):
        raise ParameterError("give --certificate and --private-key together, or neither")
    for file in (certificate, private_key):
        if file is not None and not file.is_file():
            raise ParameterError(f"{file} is not a file; give a PEM file")
    if certificate is not None and private_key is not None:
        _check_pair(certificate, private_key)
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"{folder} is a file; give a folder for recorded sessions")
    from minorloop_head.console.auth import Authentication
    from minorloop_head.console.processes import Serving, supervised
    from minorloop_head.console.tracker import listening_for

    known, interval, sensors = _head(plant, specimen, head, camera)
    if camera is not None:
        from minorloop_head.vision.video import check_camera

        check_camera(camera)
    settings = LoopSettings(
        address=plant,
        specimen=specimen,
        seed=seed,
        folder=str(folder),
        timeout=timeout,
        camera=camera,
        interval=interval,
        sensors=sensors,
    )
    tracking = None if tracker is None else listening_for(tracker)
    listening = _listen(host, port)
    port = listening.getsockname()[1]
    authentication = Authentication(host, port=port, name=name)
    scheme = "http" if certificate is None else "https"
    if not (STATIC / "index.html").is_file():
        typer.echo("note: the pages are not built; 'make pages' builds them", err=True)
    address = f"{scheme}://{_shown(host)}:{port}" if name is None else f"https://{name}"
    typer.echo(f"open {address}/?key={authentication.key}")
    typer.echo("Ctrl-C ends the console; the head then holds and cools")
    serving = Serving(
        authentication=authentication,
        listening=listening,
        certificate=certificate,
        private_key=private_key,
    )
    supervised(
        settings, serving, lambda said: typer.echo(f"note: {said}", err=True), tracking, known
    )


def _head(
    plant: str, specimen: int | None, file: Path | None, camera: str | None
) -> tuple[HeadFile | None, float, bool]:
    """Return the file of the head at an address, and tick and sensors of the plant; probe it."""
    from minorloop_head.console.plant import head_at, open_plant
    from minorloop_head.console.settings import LoopSettings, is_pipe

    if is_pipe(plant):
        known = None if file is None else head_at(plant, specimen, file)[0]
        return known, LoopSettings.interval, True
    if plant.startswith("twin:"):
        open_plant(plant, specimen=specimen)
    if file is None or camera is None:
        raise ParameterError(
            f"--plant {plant} needs --camera, and --head with a file that minorloop head identify "
            "writes; only twin:pipe needs neither"
        )
    known, found = head_at(plant, specimen, file)
    known.control(interval=found.tick)
    if known.calibration is None:
        raise ParameterError(f"{file} has no calibration of the camera; calibrate it first")
    return known, found.tick, found.sensors


def _check_pair(certificate: Path, key: Path) -> None:
    """Refuse a certificate that the server cannot use, before the address is printed."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        context.load_cert_chain(
            certificate, key, password=""
        )  # without a password, openssl would ask for one
    except (OSError, ValueError) as error:  # errors of ssl are OSErrors
        reason = getattr(error, "reason", None) or error
        raise ParameterError(
            f"{certificate} and {key} are not a certificate and its private key ({reason}); give "
            "PEM files that belong together, the key without a password"
        ) from None


def _listen(host: str, port: int) -> socket.socket:
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
