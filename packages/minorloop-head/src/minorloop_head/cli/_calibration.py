"""Commands of ``minorloop head`` that calibrate its camera: take pictures, and evaluate them."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.errors import ParameterError
from minorloop.values import called, parsed

if TYPE_CHECKING:
    from minorloop.arrays import FloatArray
    from minorloop_head.procedures.calibrate import CalibratedHead
    from minorloop_head.procedures.head_file import HeadFile
    from minorloop_head.procedures.target_pictures import ExpectedTarget

_NEAREST, _FARTHEST = 0.2, 50.0
"""Distances of an LED from the lens in mm: the smallest camera modules are 0.6 mm wide, and an LED
beyond the pipe lights nothing."""

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
    from minorloop_head.procedures.identify import check_head
    from minorloop_head.procedures.target_pictures import at_angles, by_hand
    from minorloop_head.procedures.target_pictures import photograph as keep
    from minorloop_head.vision.video import check_camera

    if exposure is not None and not 0.01 <= exposure <= 1000:
        raise ParameterError(f"--exposure is {exposure:g}; give 0.01 to 1000 ms")
    check_camera(camera)
    given, seconds = parsed(plan).options, None if exposure is None else 1e-3 * exposure
    if actuator is None:
        names = called(by_hand, "--plan", given, told=partial(typer.echo, err=True))
        taken = keep(camera, out, names, exposure=seconds)
    else:
        with _common.connected(actuator) as plant, _common.working("turning") as now:
            check_head(plant)
            names = called(at_angles, "--plan with a head", given, plant=plant)
            taken = keep(camera, out, names, exposure=seconds, told=now)
    if as_json:
        _common.print_json({"folder": str(out), "pictures": taken})
        return
    typer.echo(f"{taken} pictures in {out}; next: minorloop head calibrate")


_Head = Annotated[
    Path | None,
    typer.Option(
        help="File of the head to write. If it exists, its other parameters are kept, and "
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
    from minorloop_head.procedures.calibrate import calibrate_head
    from minorloop_head.procedures.calibration_report import calibration_report
    from minorloop_head.procedures.head_file import save_head
    from minorloop_head.vision.print_target import print_target as write_target

    expected = _target_of(target)
    if print_target is not None:
        write_target(expected.printed(), print_target, force=force)
        if as_json:
            _common.print_json({"target": str(print_target)})
        else:
            typer.echo(
                f"kept in {print_target}; print it at 100 %, and measure the bar and a square"
            )
        return
    if head is None:
        raise ParameterError("no file of a head is given; name it with --head")
    before = _before(head, serial, force)
    _common.check_outputs([report], inputs=[head], force=force)
    places = _leds_of(leds)
    with _common.working("looking for the target") as now:
        result = calibrate_head(
            before,
            target=expected,
            pictures=pictures,
            mount=mount,
            angles=angles,
            angle_sd=angle_sd,
            leds=places,
            **_pipe_of(pipe),
            told=now,
        )
    save_head(result.head, head, force=True)
    if report is not None:
        _common.write_report(lambda: calibration_report(result), report, force=force)
    _show(result, head, as_json)
    if result.doubts:
        raise typer.Exit(1)


def _before(path: Path, serial: str | None, force: bool) -> HeadFile:
    """Return the head as known so far; refuse the file of another head."""
    from minorloop_head.procedures.head_file import HeadFile, read_head

    before = read_head(path) if path.exists() else None
    if before is None and serial is None:
        raise ParameterError(f"{path} is new; give the serial number of the head with --serial")
    known = before or HeadFile(serial=str(serial))
    replace(known, identified=None).check_fits(serial, path)
    replaces = known.calibration is not None
    _common.check_outputs([path], force=force or not replaces)
    return known


def _target_of(text: str) -> ExpectedTarget:
    """Return the target of ``auto,side=3``."""
    from minorloop.arrays import as_finite
    from minorloop_head.procedures.target_pictures import AUTO, ExpectedTarget
    from minorloop_head.vision.targets import KINDS

    given = parsed(text)
    kind = given.kind or given.what or AUTO
    if kind not in (AUTO, *KINDS):
        raise ParameterError(f"--target is {kind!r}; give {AUTO}, {', '.join(KINDS)}")

    def made(squares: str = "", side: float = 3.0, on_axis: bool = False) -> ExpectedTarget:
        counts = squares.lower().split("x") if squares else []
        if squares and not (
            len(counts) == 2 and all(each.isascii() and each.isdigit() for each in counts)
        ):
            raise ParameterError(
                f"squares of --target is {squares!r}; give columns and rows such as 9x7"
            )
        said = (int(counts[0]), int(counts[1])) if counts else None
        return ExpectedTarget(1e-3 * as_finite("side of --target", side), kind, said, on_axis)

    return called(made, "--target", given.options)


def _pipe_of(text: str) -> dict[str, float]:
    """Return radius and thickness in metres of ``radius=10,thickness=2``; both are optional."""
    from minorloop.arrays import as_finite

    def made(radius: float | None = None, thickness: float | None = None) -> dict[str, float]:
        given = {"radius": (radius, 1000.0), "thickness": (thickness, 100.0)}
        for name, (value, most) in given.items():
            if value is not None and not 0.1 <= as_finite(f"{name} of --pipe", value) <= most:
                raise ParameterError(f"{name} of --pipe is {value}; give 0.1 to {most:g} mm")
        return {name: 1e-3 * value for name, (value, _) in given.items() if value is not None}

    return called(made, "--pipe", parsed(text).options)


def _leds_of(text: str | None) -> FloatArray | Path | None:
    """Return positions (N, 3) in metres of ``x,y,z;x,y,z`` in mm, or a folder of pictures."""
    import numpy as np

    if text is None or Path(text).is_dir():
        return None if text is None else Path(text)
    form = "x,y,z in mm for each LED, with ; between them, or a folder of pictures"
    places = [_common.numbers("leds", part, (3,), form) for part in text.split(";")]
    found = np.array(places)
    away = np.linalg.norm(found, axis=1)
    if not (away.min() >= _NEAREST and away.max() <= _FARTHEST):
        raise ParameterError(
            f"--leds is {text!r}; give places {_NEAREST:g} to {_FARTHEST:g} mm from the lens, in mm"
        )
    return 1e-3 * found


def _show(found: CalibratedHead, path: Path, as_json: bool) -> None:
    from minorloop_head.procedures.calibration_report import rows, summary

    head = found.head
    if as_json:
        content: dict[str, Any] = {"head": str(path), "serial": head.serial}
        content["measured"] = {
            each.name: {"value": each.value, "sd": each.sd, "unit": each.unit}
            for each in head.measured
        }
        content |= {"used": found.used, "left_out": found.left_out, "advice": found.advice}
        content["target"] = None if found.target is None else str(found.target)
        content["rms_px"] = None if found.lens is None else found.lens.rms
        content["rms_left_out_px"] = None if found.lens is None else found.lens.rms_left_out
        content["lens_model"] = None if found.lens is None else found.lens.model
        content["rms_angles_deg"] = None if found.mount is None else found.mount.rms
        content["warnings"] = found.warnings
        _common.print_json(content)
        return
    _common.print_table(("what", "value", "sd", "unit"), rows(found), f"head {head.serial}")
    typer.echo(summary(found))
    for name, why in found.left_out.items():
        typer.echo(f"left out: {name} ({why})")
    _common.print_advice(found.advice)
    for sentence in found.warnings:
        typer.echo(f"warning: {sentence}", err=True)
    typer.echo(f"kept in {path}; next: minorloop head identify --head {path}")
