"""``minorloop console``: the operate page and the lab page, in a browser."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from minorloop.cli import _common, _page
from minorloop.errors import OutputError, ParameterError

if TYPE_CHECKING:
    from minorloop_head.procedures.head_file import HeadFile

NAME = "console"
EXAMPLE = "minorloop console --folder inspections"

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
_Seed = Annotated[
    int, _common.whole_option("Seed of the simulated pipe and noise; 0 is a demonstration.")
]
_Timeout = Annotated[
    float, _common.number_option("Seconds without a message of the operator until the head holds.")
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


def run(
    host: _page.Host = "127.0.0.1",
    port: _page.Port = 8765,
    plant: _Plant = "twin:pipe",
    folder: _Folder = Path("console"),
    specimen: _Specimen = None,
    seed: _Seed = 0,
    timeout: _Timeout = 0.1,
    certificate: _page.Certificate = None,
    private_key: _page.Key = None,
    name: _page.Name = None,
    tracker: _Tracker = None,
    head: _Head = None,
    camera: _Camera = None,
) -> None:
    """Steer the head of a catheter in a pipe, and identify models, in a browser."""
    from minorloop_head.console.settings import STATIC, LoopSettings

    _page.check(port, name, certificate, private_key)
    for option, number in (("--specimen", specimen or 0), ("--seed", seed)):
        if number < 0:
            raise ParameterError(f"{option} is {number}; give 0 or more")
    if not 0.05 <= timeout <= 5.0:
        raise ParameterError(f"--timeout is {timeout}; give 0.05 to 5 seconds")
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"{folder} is a file; give a folder for recorded sessions")
    from minorloop_head.console.processes import supervised
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
    serving = _page.listen(host, port, name, certificate, private_key, STATIC / "index.html")
    typer.echo("Ctrl-C ends the console; the head then holds and cools")
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
