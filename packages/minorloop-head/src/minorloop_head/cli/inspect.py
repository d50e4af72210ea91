"""``minorloop inspect``: find defects in pictures of a pipe that somebody else took."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from itertools import repeat
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.errors import OutputError, ParameterError, RecordError, counted

if TYPE_CHECKING:
    from minorloop.report import Report
    from minorloop_head.procedures.calibration import HeadCalibration
    from minorloop_head.procedures.pictures import InspectedPicture, PicturePose
    from minorloop_head.vision.calibrated_camera import Image

NAME = "inspect"
EXAMPLE = "minorloop inspect pictures --lens 520 --radius 10 --tilt 20 --out found"
_SHOWN = 20
"""Findings that are printed, and pictures in the report: those with the most evidence."""
_POSE = {"pan": "deg", "tilt": "deg", "advance": "mm", "roll": "deg"}
_LEFT_OUT = ("time [s]", "u [px]", "v [px]")
"""Columns that a terminal has no room for."""
_OBLIQUE = (
    "pictures without wall in view show it too obliquely or from too far away; check that --pan, "
    "--tilt, --lens and --radius are right"
)
_LARGEST_ANGLE = 180.0
"""Degrees from the axis of the pipe: the camera looks straight back."""
_MM = 1e-3
"""Metres in a millimetre."""


def run(
    source: Annotated[
        str, typer.Argument(help="A picture, a folder of pictures, or a video.", show_default=False)
    ],
    head: Annotated[
        Path | None, typer.Option(help="File of the head with the calibration of its camera.")
    ] = None,
    lens: Annotated[
        str | None,
        typer.Option(
            metavar="F[,U,V[,K1,K2[,P1,P2,K3,FY]]]",
            help="Instead of a head: focal length in pixels, centre of the picture, distortion, "
            "and focal length along the columns if pixels are not square.",
        ),
    ] = None,
    radius: Annotated[
        float | None,
        _common.number_option("Radius of the pipe in mm; that of the calibration if not given."),
    ] = None,
    lever: Annotated[
        float,
        _common.number_option("With --lens: from the pivot of the camera to its lens, in mm."),
    ] = 0.0,
    pan: Annotated[
        float | None,
        _common.number_option(
            "Line of sight from the axis, in deg; with --head, what the sensor of the joint reads."
        ),
    ] = None,
    tilt: Annotated[float | None, _common.number_option("The same upward, in deg.")] = None,
    poses: Annotated[
        Path | None,
        typer.Option(
            help=_common.plain(
                "CSV file with a row for each picture: pan [deg], tilt [deg], and perhaps "
                "advance [mm] and roll [deg]; instead of --pan and --tilt, and with their meaning. "
                "Or the journal.jsonl of an inspection, whose pictures are searched."
            )
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="New or empty folder for findings.csv, unusable.csv, findings.json, report.html "
            "and pictures with the findings marked."
        ),
    ] = None,
    as_json: _common.Json = False,
) -> None:
    """Find holes, pits and cracks in pictures of a pipe, each picture alone.

    The exit status is 1 if no picture could be searched.
    """
    from minorloop.files import new_folder
    from minorloop_head.procedures.pictures import (
        DAMAGED,
        TIME,
        InspectedPicture,
        inspect_picture,
        unusable,
    )
    from minorloop_head.vision.frame_checks import GOOD
    from minorloop_head.vision.video import frames, names

    if (head is None) == (lens is None):
        raise ParameterError("give either --head with the file of a head, or --lens and --radius")
    called, view = names(source), None
    known = _poses(poses, pan, tilt, joints=head is not None)
    opened = nullcontext(None) if out is None else new_folder(out)
    found: list[InspectedPicture] = []
    best: list[tuple[float, str, Image]] = []
    with (
        opened as made,
        _discarded_on_error(made),
        _common.working(f"inspecting {source}", logged=True) as now,
    ):
        folder = None if made is None else made / "pictures"
        for number, frame in enumerate(frames(source, damaged=True)):
            if view is None and frame.image.size:
                view = _view(head, lens, radius, lever, frame.image.shape)
            name = called[number] if called else f"frame {number}"
            if isinstance(known, dict) and name not in known:
                continue  # the journal has it as another picture's, with its findings marked
            pose = known[name] if isinstance(known, dict) else next(known, None)
            if pose is None:
                raise RecordError(
                    f"{poses} has {counted(number, 'row')}, and there are more pictures; give a "
                    "row for each"
                )
            picture = InspectedPicture(name=name, t=frame.t, verdict=DAMAGED)
            if view is not None:
                pose = _seen_from(pose, head, view)
                picture = inspect_picture(frame.image, view, pose, name, frame.t)
            found.append(picture)
            now(f"{counted(len(found), 'picture')} inspected")
            if folder is not None and picture.findings:
                folder.mkdir(exist_ok=True)
                marked = _mark(frame.image, picture, folder, number)
                best = _best([*best, (_weight(picture), name, marked)])
        now(f"{counted(len(found), 'picture')} inspected", kept=True)
        if not found:
            raise RecordError(f"{source} has no pictures; give a video that has some")
        if view is None:
            raise RecordError(f"{source} has no picture that can be read; give others")
        rows = [row for picture in found for row in picture.rows()]
        bad = [
            {"picture": each.name, TIME: round(each.t, 3), "verdict": each.verdict}
            for each in found
            if each.verdict != GOOD
        ]
        for row in (*rows, *bad) if called else ():
            del row[TIME]
        content = {
            "pictures": len(found),
            "unusable": unusable(found),
            "unusable pictures": bad,
            "searched": _searched(found),
            "advice": _advice(found),
            "findings": rows,
        }
        if out is not None:
            _write(out, content, best, source, still=bool(called))
    _show(content, out, as_json)
    check_usable(content, "picture")


def check_usable(content: dict[str, Any], what: str = "view") -> None:
    """End with status 1 if no view could be searched: nothing found says nothing then.

    ``content``: numbers of views and of those that are not usable, with the reason; ``what``:
    ``view`` or ``picture``.
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


def _seen_from(pose: PicturePose, head: Path | None, view: HeadCalibration) -> PicturePose:
    """Return a pose with the line of sight; the angles of a head are what its joints read."""
    from dataclasses import replace

    read = [pose.pan, pose.tilt]
    sight = read if head is None else view.line_of_sight(read).tolist()
    pan, tilt = (0.0 if math.isnan(angle) else angle for angle in sight)
    return replace(pose, pan=pan, tilt=tilt)


def _searched(pictures: Sequence[InspectedPicture]) -> float:
    """Return the mean share of a picture that was searched."""
    shares = [0.0 if each.light is None else each.light.searched for each in pictures]
    return round(sum(shares) / len(shares), 3)


def _advice(pictures: Sequence[InspectedPicture]) -> list[str]:
    """Return what is likely to be wrong with the poses."""
    from statistics import median

    wrong = [each for each in pictures if each.light is not None and each.light.off is not None]
    if not wrong:
        return []
    off = [each.light.off for each in wrong if each.light is not None and each.light.off]
    pan, tilt = (5 * round(median(pair[n] for pair in off) / 5) for n in (0, 1))
    return [
        f"the light in {counted(len(wrong), 'picture')} ({wrong[0].name} first) does not fit pan "
        f"and tilt, and would fit about {pan:+d} and {tilt:+d} degrees more; places and sizes are "
        "wrong then, and holes are missed. With --head, pan and tilt are what the sensors read; "
        "with --lens, they are from the axis of the pipe"
    ]


def _poses(
    file: Path | None, pan: float | None, tilt: float | None, *, joints: bool
) -> Iterator[PicturePose] | dict[str, PicturePose]:
    """Return the poses of the pictures as given, one after the other; NaN is along the pipe.

    Those of a journal are returned by the names of the pictures; it has both what the ``joints``
    read and the line of sight.
    """
    from minorloop.lab.columns import read_columns, read_headers
    from minorloop_head.procedures.pictures import PicturePose

    if file is None:
        for name, value in (("--pan", pan), ("--tilt", tilt)):
            if value is not None:
                _check_angle(name, value)
        given = (math.nan if value is None else math.radians(value) for value in (pan, tilt))
        return repeat(PicturePose(**dict(zip(("pan", "tilt"), given, strict=True))))
    wanted = {f"{name} [{unit}]": name for name, unit in _POSE.items()}
    if file.suffix == ".jsonl":
        return _journalled(file, joints=joints)
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


def _journalled(file: Path, *, joints: bool) -> dict[str, PicturePose]:
    """Return the poses in the journal of an inspection, by the names of its pictures.

    A line that was not written to its end, as when the program was killed, is left out.
    """
    from minorloop_head.inspection.journal import journal_lines
    from minorloop_head.inspection.lines import ViewLine
    from minorloop_head.procedures.pictures import PicturePose

    found = {}
    for view in journal_lines(file, ViewLine):
        pose, sight = view.pose.si(), view.sight.si()
        found[view.picture] = PicturePose(**(pose if joints else {**pose, **sight}))
    if not found:
        raise RecordError(f"{file} has no views; give the journal of an inspection that has some")
    return found


@contextmanager
def _discarded_on_error(made: Path | None) -> Iterator[None]:
    """Remove the marked pictures after an error, so that the same command can be given again."""
    try:
        yield
    except BaseException:
        if made is not None:
            shutil.rmtree(made / "pictures", ignore_errors=True)
        raise


def _check_angle(name: str, value: float) -> None:
    """Refuse an angle of more than half a turn."""
    if not abs(value) <= _LARGEST_ANGLE:
        raise ParameterError(
            f"{name} is {value:g} degrees; give {-_LARGEST_ANGLE:g} to {_LARGEST_ANGLE:g}, from "
            "the axis of the pipe to the line of sight"
        )


def _weight(picture: InspectedPicture) -> float:
    """Return by what pictures are chosen for the report."""
    evidence = [each.evidence for each in picture.findings if not math.isnan(each.evidence)]
    return max(evidence, default=0.0)


def _best(pictures: list[tuple[float, str, Any]]) -> list[tuple[float, str, Any]]:
    return sorted(pictures, key=lambda each: -each[0])[:_SHOWN]


def _mark(image: Image, picture: InspectedPicture, folder: Path, number: int) -> Any:
    """Write a picture with its findings marked, and return it."""
    from minorloop_head.procedures.pictures import annotated
    from minorloop_head.vision.imaging import opencv

    marked = annotated(image, picture.findings)
    path = folder / f"{number:06d}.jpg"
    if not opencv().imwrite(str(path), marked):
        raise OutputError(f"{path} cannot be written; check the disk")
    return marked


def _write(
    out: Path, content: dict[str, Any], best: list[Any], source: str, *, still: bool
) -> None:
    from minorloop.files import write_atomically
    from minorloop_head.procedures.pictures import COLUMNS, TIME

    rows, bad = content["findings"], content["unusable pictures"]
    columns = [name for name in COLUMNS if name != TIME or not still]
    table = {name: [row[name] for row in rows] for name in columns}
    _common.write_csv(out / "findings.csv", table, force=False)
    names = ("picture", "verdict") if still else ("picture", TIME, "verdict")
    listed = {name: [row[name] for row in bad] for name in names}
    _common.write_csv(out / "unusable.csv", listed, force=False)
    write_atomically(out / "findings.json", f"{json.dumps(content, indent=1)}\n")
    _common.write_report(
        lambda: _report(columns, content, best, source), out / "report.html", force=False
    )


def _report(
    columns: Sequence[str], content: dict[str, Any], best: list[Any], source: str
) -> Report:
    from minorloop.report import Picture, Report, Table
    from minorloop_head.inspection.report import figure_of

    said = "; ".join([_summary(content), *content["advice"]])
    report = Report(f"Inspection of {Path(source).name}", said)
    cells = [_cells(row, columns) for row in content["findings"]]
    report.add("Findings", table=Table(tuple(columns), cells))
    pictures = [Picture(figure_of(marked), name) for _, name, marked in best]
    report.add("Pictures with the most evidence", pictures=pictures)
    return report


def _cells(row: dict[str, Any], columns: Sequence[str]) -> list[str]:
    return ["" if row[name] is None else str(row[name]) for name in columns]


def _summary(content: dict[str, Any]) -> str:
    bad = ", ".join(f"{verdict} ({count})" for verdict, count in content["unusable"].items())
    count, pictures = len(content["findings"]), content["pictures"]
    said = f"{counted(count, 'finding')} in {counted(pictures, 'picture')}"
    said = f"{said}; not usable: {bad}" if bad else said
    return f"{said}; {content['searched']:.0%} of their area searched"


def _show(content: dict[str, Any], out: Path | None, as_json: bool) -> None:
    from minorloop_head.procedures.pictures import COLUMNS
    from minorloop_head.vision.defects import NOT_IN_VIEW

    if as_json:
        _common.print_json(content)
        return
    rows = content["findings"]
    columns = [name for name in COLUMNS if name not in _LEFT_OUT]
    first = [_cells(row, columns) for row in rows[:_SHOWN]]
    if first:
        _common.print_table(columns, first)
    typer.echo(_summary(content))
    oblique = [_OBLIQUE] if content["unusable"].get(NOT_IN_VIEW) else []
    _common.print_advice([*oblique, *content["advice"]])
    if len(rows) > len(first):
        typer.echo(f"the first {len(first)} are shown; --out writes all of them")
    if out is not None:
        typer.echo(f"kept in {out}")
