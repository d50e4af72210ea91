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

if TYPE_CHECKING:
    from minorloop.arrays import FloatArray
    from minorloop.lab.actuator import Actuator
    from minorloop_head.procedures.head_file import HeadFile
    from minorloop_head.vision.measured import Measured

_MM = 1e-3
_PATIENCE = 3.0
"""Seconds that a camera may take for a picture."""
_LAST = 5
"""Readings at the end of a hold whose mean is the angle."""


def photograph(
    camera: Annotated[
        str, typer.Option(show_default=False, help="Address, such as camera:/dev/video2.")
    ],
    out: Annotated[
        Path, typer.Option(show_default=False, help="New or empty folder for the pictures.")
    ],
    actuator: Annotated[
        str | None,
        typer.Option(help="Head to turn between pictures, such as bench:head.toml; none by hand."),
    ] = None,
    highest: Annotated[float, _common.number_option("With a head: largest current, in A.")] = 0.35,
    steps: Annotated[int, _common.whole_option("With a head: levels of each current.")] = 4,
    hold: Annotated[float, _common.number_option("With a head: time at each level, in s.")] = 40.0,
    count: Annotated[int, _common.whole_option("By hand: pictures.")] = 16,
    every: Annotated[float, _common.number_option("By hand: time for each, in s.")] = 4.0,
    exposure: Annotated[
        float | None, _common.number_option("Exposure in ms, where the camera offers it.")
    ] = None,
    as_json: _common.Json = False,
) -> None:
    """Take pictures for head calibrate, by hand or at several angles of the joints."""
    from minorloop.files import new_folder
    from minorloop_head.procedures.identify import check_head
    from minorloop_head.vision.video import LiveCamera, check_camera

    limits: dict[str, tuple[float, int, int]] = {
        "steps": (steps, 2, 20),
        "count": (count, 1, 1000),
        "hold": (hold, 1, 3600),
        "every": (every, 0, 3600),
    }
    for name, (value, least, most) in limits.items():
        if not least <= value <= most:
            raise ParameterError(f"--{name} is {value:g}; give {least} to {most}")
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
            if actuator is None:
                for name in _by_hand(count, every):
                    _keep(live, folder / f"{name}.png")
                    taken += 1
            else:
                with _common.connected(actuator) as plant, _common.working("turning") as now:
                    check_head(plant)
                    for name, (pan, tilt) in _at_angles(plant, highest, steps, hold):
                        _keep(live, folder / f"{name}.png")
                        taken += 1
                        now(f"picture {taken} of {steps**2}: pan {pan:.1f}, tilt {tilt:.1f} deg")
        finally:
            live.close()
    if as_json:
        _common.print_json({"folder": str(folder), "pictures": taken})
        return
    typer.echo(f"{taken} pictures in {folder}; next: minorloop head calibrate")


def calibrate(
    head: Annotated[
        Path | None,
        typer.Option(
            help="File of the head to write. If it exists, what is not measured is kept, and "
            "a calibration is replaced with --force."
        ),
    ] = None,
    pictures: Annotated[
        Path | None,
        typer.Option(
            help="Folder of pictures of the target everywhere in the image, for the lens."
        ),
    ] = None,
    mount: Annotated[
        Path | None,
        typer.Option(
            help="Folder of pictures of the target at rest, at several angles of the joints, named "
            "such as pan12.5_tilt-3.png."
        ),
    ] = None,
    angles: Annotated[
        Path | None,
        typer.Option(
            help="Instead of angles in the names: table with a row for each picture, its name in "
            "the column picture, and pan and tilt in deg."
        ),
    ] = None,
    robot: Annotated[
        Path | None,
        typer.Option(
            help="Instead of joints that pan and tilt: table with a row for each picture of "
            "--mount, its name in the column picture, and the pose of a robot's flange: x, y, z in "
            "mm, and rx, ry, rz in deg (rotation vector) or qw, qx, qy, qz."
        ),
    ] = None,
    on_axis: Annotated[
        bool,
        typer.Option(
            "--on-axis",
            help="In the pictures of --mount the target is square to the pipe, upright, with its "
            "middle on the axis: measure the place of the head in the pipe too.",
        ),
    ] = False,
    angle_sd: Annotated[
        float, _common.number_option("Standard deviation of the angles of the joints, in deg.")
    ] = 0.1,
    led_pictures: Annotated[
        Path | None,
        typer.Option(
            help="Folder with a folder for each LED: dark pictures of its reflection in a glossy "
            "target."
        ),
    ] = None,
    leds: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z;...",
            help="Places of the LEDs in mm: right of the lens, below it, before it.",
        ),
    ] = None,
    target: Annotated[
        str,
        typer.Option(
            metavar="KIND,KEY=VALUE,...",
            help="Kind of the target: charuco, chessboard, circles or asymmetric-circles; auto "
            "finds out which the pictures show. squares=COLUMNSxROWS, or circles, found out too; "
            "side=MM of a square as measured, or distance of circles.",
        ),
    ] = "auto,side=3",
    radius: Annotated[
        float | None, _common.number_option("Radius of the pipe, in mm; 10 if never given.")
    ] = None,
    thickness: Annotated[
        float | None, _common.number_option("Thickness of its wall, in mm; 2 if never given.")
    ] = None,
    serial: Annotated[
        str | None, typer.Option(help="Serial number of the head; needed for a new file.")
    ] = None,
    print_target: Annotated[
        Path | None,
        typer.Option(help="Only write the target to this PDF, SVG or PNG file, to print at scale."),
    ] = None,
    report: Annotated[
        Path | None, typer.Option(help="Write a report with pictures of coverage and residuals.")
    ] = None,
    force: _common.Force = False,
    as_json: _common.Json = False,
) -> None:
    """Calibrate lens, mount and LEDs of a head from pictures of a printed target."""
    from minorloop_head.cli import _calibration
    from minorloop_head.procedures import calibrate as steps
    from minorloop_head.procedures.head_file import save_head
    from minorloop_head.vision.targets import KINDS, Target

    kind, said, side = _calibration.target_of(target)
    if print_target is not None:
        board = Target(KINDS[0] if kind == steps.AUTO else kind, *(said or (9, 7)), side)
        _calibration.print_target(board, print_target, force=force)
        if as_json:
            _common.print_json({"target": str(print_target)})
            return
        typer.echo(f"kept in {print_target}; print it at 100 %, and measure the bar and a square")
        return
    if head is None:
        raise ParameterError("no file of a head is given; name it with --head")
    _check_calibration(
        pictures, mount, angles, robot, led_pictures, leds, angle_sd, radius, thickness
    )
    before = _before(head, serial, force)
    _common.check_outputs([report], inputs=[head], force=force)
    lens = fit = None
    used: dict[str, int] = {}
    left_out: dict[str, str] = {}
    known_target: Target | None = None
    with _common.working("looking for the target") as now:

        def looked(folder: Path, what: str) -> steps.TargetPictures:
            nonlocal known_target
            now(f"looking for the target in {folder}")
            known_target = known_target or steps.find_target(folder, side, kind, said)
            found = steps.look_through(folder, known_target)
            used[what] = len(found.seen)
            left_out.update({f"{folder.name}/{n}": why for n, why in found.left_out.items()})
            return found

        sd = steps.CORNER_SD
        if pictures is not None:
            lens = steps.calibrate_lens(looked(pictures, "the lens"))
            sd = lens.rms / 2**0.5
            left_out.update({f"{pictures.name}/{n}": why for n, why in lens.left_out.items()})
            used["the lens"] = len(lens.seen)
        known = lens.lens if lens is not None else steps.lens_of(before)
        doubts: tuple[str, ...] = ()
        measured: tuple[Measured, ...] = ()
        if mount is not None and robot is not None:
            shown_at = looked(mount, "the flange")
            measured = steps.calibrate_hand_eye(shown_at, known, robot, corner_sd=sd).measured
        elif mount is not None:
            shown_at = looked(mount, "the mount")
            fit = steps.calibrate_mount(
                shown_at, known, angles,
                corner_sd=sd, angle_sd=angle_sd, on_axis=on_axis,
                centre_sd=steps.centre_sd_of(before.measured if lens is None else lens.measured),
            )  # fmt: skip
            names = [each.name for each in shown_at.seen]
            doubts = steps.mount_doubts(fit, names, angle_sd)
        places = None if leds is None else _calibration.led_places(leds)
        if led_pictures is not None:
            folders = steps.led_folders(led_pictures)
            shown = [looked(each, f"LED {n}") for n, each in enumerate(folders, 1)]
            places, lit = steps.calibrate_leds(shown, known, sd)
            measured = (*measured, *lit)
    found, advice = steps.calibrated_head(
        before, lens=lens, mount=fit, leds=places, measured=measured,
        radius=None if radius is None else _MM * radius,
        thickness=None if thickness is None else _MM * thickness,
    )  # fmt: skip
    result = steps.CalibratedHead(found, lens, fit, left_out, used, advice, doubts, known_target)
    save_head(found, head, force=True)
    if report is not None:
        _common.write_report(lambda: _calibration.report(result), report, force=force)
    _calibration.show(result, head, as_json)
    if doubts:
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


def _check_calibration(
    pictures: Path | None,
    mount: Path | None,
    angles: Path | None,
    robot: Path | None,
    led_pictures: Path | None,
    leds: str | None,
    angle_sd: float,
    radius: float | None,
    thickness: float | None,
) -> None:
    if not any((pictures, mount, led_pictures, leds)):
        raise ParameterError(
            "there is nothing to calibrate; give --pictures, --mount, --led-pictures or --leds"
        )
    for name, table in (("angles", angles), ("robot", robot)):
        if table is not None and mount is None:
            raise ParameterError(f"--{name} are those of the pictures of --mount; give it too")
    if angles is not None and robot is not None:
        raise ParameterError("give either --angles or --robot")
    if leds is not None and led_pictures is not None:
        raise ParameterError("give either --leds or --led-pictures")
    if not 1e-3 <= angle_sd <= 10.0:
        raise ParameterError(f"--angle-sd is {angle_sd}; give 0.001 to 10 degrees")
    for name, value, most in (("radius", radius, 1000.0), ("thickness", thickness, 100.0)):
        if value is not None and not 0.1 <= value <= most:
            raise ParameterError(f"--{name} is {value}; give 0.1 to {most:g} mm")


def _at_angles(
    plant: Actuator, highest: float, steps: int, hold: float
) -> Iterator[tuple[str, FloatArray]]:
    """Hold both currents at all pairs of levels; yield a name with the angles, and these in deg."""
    import numpy as np

    levels = np.linspace(0.0, highest, steps)
    try:
        for number, currents in enumerate(itertools.product(levels, levels)):
            readings = np.asarray(plant.apply(np.array(currents), hold, hold / (2 * _LAST)).y)
            pan, tilt = angles = readings[:, -_LAST:].mean(axis=1)
            yield f"{number:02d}_pan{pan:.2f}_tilt{tilt:.2f}", angles
    finally:
        plant.safe()


def _by_hand(count: int, every: float) -> Iterator[str]:
    """Yield the names of pictures after equal times, in which the target is moved."""
    for number in range(count):
        typer.echo(f"picture {number + 1} of {count} in {every:g} s; hold the target", err=True)
        time.sleep(every)
        yield f"{number:02d}"


def _keep(camera: Any, path: Path) -> None:
    """Write the next picture of a camera to a PNG file."""
    from minorloop_head.vision.imaging import opencv

    if not opencv().imwrite(str(path), camera.frame().image):
        raise OutputError(f"{path} cannot be written; check the disk")
