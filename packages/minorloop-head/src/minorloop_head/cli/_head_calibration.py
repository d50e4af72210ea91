"""Commands of ``minorloop head`` that calibrate its camera: take pictures, and evaluate them."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.errors import OutputError, ParameterError
from minorloop.values import called, parsed

if TYPE_CHECKING:
    from minorloop.lab.actuator import Actuator
    from minorloop_head.procedures.head_file import HeadFile

_PATIENCE = 3.0
"""Seconds that a camera may take for a picture."""
_LAST = 5
"""Readings at the end of a hold whose mean is the angle."""


_Camera = Annotated[
    str, typer.Option(show_default=False, help="Address, such as camera:/dev/video2.")
]
_Pictures = Annotated[
    Path, typer.Option(show_default=False, help="New or empty folder for the pictures.")
]
_Turned = Annotated[
    str | None,
    typer.Option(help="Head to turn between pictures, such as bench:head.toml; none by hand."),
]
_Plan = Annotated[
    str,
    typer.Option(
        metavar="KEY=VALUE,...",
        help="With a head: highest: largest current in A, 0.35 if not given; steps: levels of "
        "each current, 4; hold: time at each level in s, 40. By hand: count of pictures, 16; "
        "every: time for each in s, 4.",
    ),
]
_Exposure = Annotated[
    float | None, _common.number_option("Exposure in ms, where the camera offers it.")
]


def photograph(
    camera: _Camera,
    out: _Pictures,
    actuator: _Turned = None,
    plan: _Plan = "",
    exposure: _Exposure = None,
    as_json: _common.Json = False,
) -> None:
    """Take pictures for head calibrate, by hand or at several angles of the joints."""
    from minorloop.files import new_folder
    from minorloop_head.procedures.identify import check_head
    from minorloop_head.vision.video import LiveCamera, check_camera

    if exposure is not None and not 0.01 <= exposure <= 1000:
        raise ParameterError(f"--exposure is {exposure:g}; give 0.01 to 1000 ms")
    check_camera(camera)
    taken = 0
    with new_folder(out) as folder:
        live = LiveCamera(camera, patience=_PATIENCE)
        try:
            if exposure is not None:
                if not live.exposes:
                    raise ParameterError(
                        f"{camera} does not let its exposure be set from here; set it at the "
                        "camera, and leave --exposure out"
                    )
                live.expose(1e-3 * exposure)
            given = parsed(plan).options
            if actuator is None:
                for name in called(_by_hand, "--plan", given):
                    _keep(live, folder / f"{name}.png")
                    taken += 1
            else:
                with _common.connected(actuator) as plant, _common.working("turning") as now:
                    check_head(plant)
                    for name in called(_at_angles, "--plan with a head", given, plant=plant):
                        _keep(live, folder / f"{name}.png")
                        taken += 1
                        now(f"{taken} pictures, the last {name}")
        finally:
            live.close()
    if as_json:
        _common.print_json({"folder": str(folder), "pictures": taken})
        return
    typer.echo(f"{taken} pictures in {folder}; next: minorloop head calibrate")


_Head = Annotated[
    Path | None,
    typer.Option(
        help="File of the head to write. If it exists, what is not measured is kept, and "
        "a calibration is replaced with --force."
    ),
]
_OfLens = Annotated[
    Path | None,
    typer.Option(help="Folder of pictures of the target everywhere in the image, for the lens."),
]
_OfMount = Annotated[
    Path | None,
    typer.Option(
        help="Folder of pictures of the target at rest, at several angles of the joints, named "
        "such as pan12.5_tilt-3.png."
    ),
]
_Angles = Annotated[
    Path | None,
    typer.Option(
        help="Instead of angles in the names: table with a row for each picture of --mount, "
        "its name in the column picture, and pan and tilt in deg; or, of a camera on a robot, "
        "the pose of its flange: x, y, z in mm, and rx, ry, rz in deg (rotation vector) or qw, "
        "qx, qy, qz."
    ),
]
_AngleSd = Annotated[
    float, _common.number_option("Standard deviation of the angles of the joints, in deg.")
]
_Leds = Annotated[
    str | None,
    typer.Option(
        metavar="X,Y,Z;...",
        help="Places of the LEDs in mm: right of the lens, below it, before it. Or a folder "
        "with a folder for each LED: dark pictures of its reflection in a glossy target.",
    ),
]
_Target = Annotated[
    str,
    typer.Option(
        metavar="KIND,KEY=VALUE,...",
        help="Kind of the target: charuco, chessboard, circles or asymmetric-circles; auto "
        "finds out which the pictures show. squares=COLUMNSxROWS, or circles, found out too; "
        "side=MM of a square as measured, or distance of circles. on-axis=yes: in the pictures "
        "of --mount it is square to the pipe, upright, with its middle on the axis, so that "
        "the place of the head in the pipe is measured too.",
    ),
]
_Pipe = Annotated[
    str,
    typer.Option(
        metavar="KEY=VALUE,...",
        help="radius of the pipe and thickness of its wall in mm; 10 and 2 if never given.",
    ),
]
_Serial = Annotated[
    str | None, typer.Option(help="Serial number of the head; needed for a new file.")
]
_PrintTarget = Annotated[
    Path | None,
    typer.Option(help="Only write the target to this PDF, SVG or PNG file, to print at scale."),
]
_Report = Annotated[
    Path | None, typer.Option(help="Write a report with pictures of coverage and residuals.")
]


def calibrate(
    head: _Head = None,
    pictures: _OfLens = None,
    mount: _OfMount = None,
    angles: _Angles = None,
    angle_sd: _AngleSd = 0.1,
    leds: _Leds = None,
    target: _Target = "auto,side=3",
    pipe: _Pipe = "",
    serial: _Serial = None,
    print_target: _PrintTarget = None,
    report: _Report = None,
    force: _common.Force = False,
    as_json: _common.Json = False,
) -> None:
    """Calibrate lens, mount and LEDs of a head from pictures of a printed target."""
    from minorloop_head.cli import _calibration
    from minorloop_head.procedures.calibrate import calibrate_head
    from minorloop_head.procedures.head_file import save_head

    expected = _calibration.target_of(target)
    if print_target is not None:
        _calibration.print_target(expected, print_target, force=force, as_json=as_json)
        return
    if head is None:
        raise ParameterError("no file of a head is given; name it with --head")
    before = _before(head, serial, force)
    _common.check_outputs([report], inputs=[head], force=force)
    places, folder = _calibration.leds_of(leds)
    with _common.working("looking for the target") as now:
        result = calibrate_head(
            before,
            target=expected,
            pictures=pictures,
            mount=mount,
            angles=angles,
            angle_sd=angle_sd,
            leds=places,
            led_pictures=folder,
            **_calibration.pipe_of(pipe),
            told=now,
        )
    save_head(result.head, head, force=True)
    if report is not None:
        _common.write_report(lambda: _calibration.report(result), report, force=force)
    _calibration.show(result, head, as_json)
    if result.doubts:
        raise typer.Exit(1)


def _before(path: Path, serial: str | None, force: bool) -> HeadFile:
    """Return the head as known so far; refuse that of another one."""
    from minorloop_head.procedures.head_file import HeadFile, read_head

    before = read_head(path) if path.exists() else None
    if before is None and serial is None:
        raise ParameterError(f"{path} is new; give the serial number of the head with --serial")
    known = before or HeadFile(serial=str(serial))
    replace(known, identified=None).check_fits(serial, path)
    replaces = known.calibration is not None
    _common.check_outputs([path], force=force or not replaces)
    return known


def _at_angles(
    plant: Actuator, highest: float = 0.35, steps: int = 4, hold: float = 40.0
) -> Iterator[str]:
    """Hold both currents at all pairs of levels; yield a name with the angles in degrees."""
    import numpy as np

    _check("steps", steps, 2, 20)
    _check("hold", hold, 1, 3600)
    levels = np.linspace(0.0, highest, steps)
    try:
        for number, currents in enumerate(itertools.product(levels, levels)):
            readings = np.asarray(plant.apply(np.array(currents), hold, hold / (2 * _LAST)).y)
            pan, tilt = readings[:, -_LAST:].mean(axis=1)
            yield f"{number:02d}_pan{pan:.2f}_tilt{tilt:.2f}"
    finally:
        plant.safe()


def _by_hand(count: int = 16, every: float = 4.0) -> Iterator[str]:
    """Yield the names of pictures after equal times, in which the target is moved."""
    _check("count", count, 1, 1000)
    _check("every", every, 0, 3600)
    for number in range(count):
        typer.echo(f"picture {number + 1} of {count} in {every:g} s; hold the target", err=True)
        time.sleep(every)
        yield f"{number:02d}"


def _check(name: str, value: float, least: float, most: float) -> None:
    from minorloop.arrays import as_finite

    if not least <= as_finite(f"{name} of --plan", value) <= most:
        raise ParameterError(f"{name} of --plan is {value}; give {least:g} to {most:g}")


def _keep(camera: Any, path: Path) -> None:
    """Write the next picture of a camera to a PNG file."""
    from minorloop_head.vision.imaging import opencv

    if not opencv().imwrite(str(path), camera.frame().image):
        raise OutputError(f"{path} cannot be written; check the disk")
