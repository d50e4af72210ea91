"""``minorloop inspect``: find defects in third-party pictures of a pipe or plate."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from itertools import repeat
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.errors import ParameterError, RecordError

if TYPE_CHECKING:
    from minorloop_head.procedures.calibration import HeadCalibration
    from minorloop_head.procedures.pictures import PicturePose

NAME = "inspect"
EXAMPLE = "minorloop inspect pictures --lens 520 --radius 10 --tilt 20 --out found"
_POSE = {"pan": "deg", "tilt": "deg", "advance": "mm", "roll": "deg"}
_LEFT_OUT = ("time [s]", "u [px]", "v [px]")
"""Columns that are left out on a terminal."""
_OBLIQUE = (
    "pictures without wall in view show it too obliquely or from too far away; check that --pan, "
    "--tilt, --lens and --radius are right"
)
_LARGEST_ANGLE = 180.0
"""Degrees from the axis of the pipe: the camera looks straight back."""
_MM = 1e-3
"""Metres in a millimetre."""


_Source = Annotated[
    str, typer.Argument(help="A picture, a folder of pictures, or a video.", show_default=False)
]
_Head = Annotated[
    Path | None, typer.Option(help="File of the head with the calibration of its camera.")
]
_Lens = Annotated[
    str | None,
    typer.Option(
        metavar="F[,U,V[,K1,K2[,P1,P2,K3,FY]]]",
        help="Instead of a head: focal length in pixels, centre of the picture, distortion, "
        "and focal length along the columns if pixels are not square.",
    ),
]
_Radius = Annotated[
    float | None,
    _common.number_option("Radius of the pipe in mm; that of the calibration if not given."),
]
_Plate = Annotated[
    float | None,
    _common.number_option(
        "Instead of a head or lens: size in mm of a pixel on a flat rough surface, seen from "
        "straight above in any light. It is searched for dark cracks only."
    ),
]
_Lever = Annotated[
    float,
    _common.number_option("With --lens: from the pivot of the camera to its lens, in mm."),
]
_Pan = Annotated[
    float | None,
    _common.number_option(
        "Line of sight from the axis, in deg; with --head, the reading of the joint."
    ),
]
_Tilt = Annotated[float | None, _common.number_option("The same upward, in deg.")]
_Poses = Annotated[
    Path | None,
    typer.Option(
        help=_common.plain(
            "CSV file with a row for each picture: pan [deg], tilt [deg], and perhaps "
            "advance [mm] and roll [deg]; instead of --pan and --tilt, and with their meaning."
        )
    ),
]
_Out = Annotated[
    Path | None,
    typer.Option(
        help="New or empty folder for findings.csv, unusable.csv, findings.json, report.html "
        "and pictures with the findings marked."
    ),
]


def run(
    source: _Source,
    head: _Head = None,
    lens: _Lens = None,
    radius: _Radius = None,
    plate: _Plate = None,
    lever: _Lever = 0.0,
    pan: _Pan = None,
    tilt: _Tilt = None,
    poses: _Poses = None,
    out: _Out = None,
    as_json: _common.Json = False,
) -> None:
    """Find holes, pits and cracks in pictures of a pipe or a plate, each picture alone.

    The exit status is 1 if no picture could be searched.
    """
    from minorloop_head.inspection.inspect_pictures import inspect_pictures, inspect_plates

    if sum(given is not None for given in (head, lens, plate)) != 1:
        raise ParameterError(
            "give one of --head with the file of a head, --lens with --radius, or --plate"
        )
    posed = lever != 0.0 or any(each is not None for each in (radius, pan, tilt, poses))
    if plate is not None and posed:
        raise ParameterError("--plate is of a flat surface from straight above; leave the pose out")
    known = _poses(poses, pan, tilt)
    with _common.working(f"inspecting {source}", logged=True) as now:
        if plate is not None:
            content = inspect_plates(source, _MM * plate, out=out, told=now)
        else:
            content = inspect_pictures(
                source,
                partial(_view, head, lens, radius, lever),
                known,
                joints=head is not None,
                out=out,
                told=now,
            )
    _show(content, out, as_json)
    check_usable(content, "picture")


def check_usable(content: dict[str, Any], what: str = "view") -> None:
    """End with status 1 if no view could be searched: no finding means nothing then.

    ``content``: numbers of views and of unusable ones, with the reason; ``what``: ``view`` or
    ``picture``.
    """
    if sum(content["unusable"].values()) == content[f"{what}s"]:
        typer.echo(
            f"warning: no {what} could be searched, so that the wall was not inspected; check the "
            "camera, its exposure and the light",
            err=True,
        )
        raise typer.Exit(1)


def _view(
    head: Path | None, lens: str | None, radius: float | None, lever: float, shape: tuple[int, ...]
) -> HeadCalibration:
    """Return the calibration by the file of a head, or by lens and radius."""
    from dataclasses import replace

    import numpy as np

    from minorloop_head.geometry import Pinhole
    from minorloop_head.procedures.calibration import HeadCalibration
    from minorloop_head.procedures.head_file import read_head

    if not 0.0 <= lever <= 1000.0:
        raise ParameterError(f"--lever is {lever}; give 0 to 1000 mm")
    if radius is not None and not 0.5 <= radius <= 1000.0:
        raise ParameterError(f"--radius is {radius}; give 0.5 to 1000 mm")
    if head is not None:
        known = read_head(head).calibration
        if known is None:
            raise ParameterError(
                f"{head} has no calibration; give --lens and --radius instead of --head"
            )
        size = (known.lens.height, known.lens.width)
        if shape != size:
            raise ParameterError(
                f"the pictures have {shape[1]} by {shape[0]} pixels, and the camera in {head} "
                f"{size[1]} by {size[0]}; give pictures of this camera"
            )
        return known if radius is None else replace(known, radius=_MM * radius)
    if radius is None:
        raise ParameterError("--lens needs the radius of the pipe; give --radius, in mm")
    height, width = shape
    forms = "F, or F,U,V, or F,U,V,K1,K2, or F,U,V,K1,K2,P1,P2,K3,FY"
    numbers = _common.numbers("lens", lens or "", (1, 3, 5, 9), forms)
    usual = [math.nan, (width - 1) / 2, (height - 1) / 2, *[0.0] * 5, numbers[0]]
    focal, u, v, k1, k2, p1, p2, k3, fy = [*numbers, *usual[len(numbers) :]]
    optics = Pinhole(width, height, focal, (u, v), k1, k2, k3, p1, p2, fy / focal)
    return HeadCalibration(
        lens=optics, leds=np.zeros((1, 3)), lever=_MM * lever, radius=_MM * radius
    )


def _poses(file: Path | None, pan: float | None, tilt: float | None) -> Iterator[PicturePose]:
    """Yield the stated poses of the pictures, one after the other; NaN is along the pipe."""
    from minorloop.lab.columns import read_columns, read_headers
    from minorloop_head.procedures.pictures import PicturePose

    if file is None:
        for name, value in (("--pan", pan), ("--tilt", tilt)):
            if value is not None:
                _check_angle(name, value)
        given = (math.nan if value is None else math.radians(value) for value in (pan, tilt))
        return repeat(PicturePose(**dict(zip(("pan", "tilt"), given, strict=True))))
    wanted = {f"{name} [{unit}]": name for name, unit in _POSE.items()}
    headers = [header for header in read_headers(file) if header in wanted]
    if not {"pan [deg]", "tilt [deg]"} <= set(headers):
        raise RecordError(f"{file} has no columns 'pan [deg]' and 'tilt [deg]'; add them")
    columns = read_columns(file, headers)
    for name in ("pan", "tilt"):
        for row, value in enumerate(columns[f"{name} [deg]"].tolist(), 1):
            _check_angle(f"{name} of row {row} of {file}", value)
    scaled = {wanted[header]: columns[header] * _unit(header) for header in headers}
    rows = zip(*(values.tolist() for values in scaled.values()), strict=True)
    return iter([PicturePose(**dict(zip(scaled, row, strict=True))) for row in rows])


def _unit(header: str) -> float:
    """Return the unit of a column of poses in metres or radians."""
    return _MM if header.endswith("[mm]") else math.radians(1.0)


def _check_angle(name: str, value: float) -> None:
    """Refuse an angle of more than half a turn."""
    if not abs(value) <= _LARGEST_ANGLE:
        raise ParameterError(
            f"{name} is {value:g} degrees; give {-_LARGEST_ANGLE:g} to {_LARGEST_ANGLE:g}, from "
            "the axis of the pipe to the line of sight"
        )


def _show(content: dict[str, Any], out: Path | None, as_json: bool) -> None:
    from minorloop_head.inspection.inspect_pictures import SHOWN, picture_summary
    from minorloop_head.inspection.report import table
    from minorloop_head.vision.defects import NOT_IN_VIEW

    if as_json:
        _common.print_json(content)
        return
    rows = content["findings"]
    columns = [name for row in rows[:1] for name in row if name not in _LEFT_OUT]
    first = table(rows[:SHOWN], columns)
    if first:
        _common.print_table(columns, first)
    typer.echo(picture_summary(content))
    oblique = [_OBLIQUE] if content["unusable"].get(NOT_IN_VIEW) else []
    _common.print_advice([*oblique, *content["advice"]])
    if len(rows) > len(first):
        typer.echo(f"the first {len(first)} are shown; --out writes all of them")
    if out is not None:
        typer.echo(f"kept in {out}")
