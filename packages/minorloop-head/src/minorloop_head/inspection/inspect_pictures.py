"""Inspection of third-party pictures of a pipe or plate: each picture is searched alone."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

from minorloop.errors import OutputError, RecordError, counted
from minorloop.files import PathLike, new_folder, table_text, write_atomically
from minorloop.report import Picture, Report, Table
from minorloop_head.inspection.journal import Told, untold
from minorloop_head.inspection.report import figure_of, table, written
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.pictures import (
    COLUMNS,
    DAMAGED,
    PLATE_COLUMNS,
    TIME,
    InspectedPicture,
    PicturePose,
    annotated,
    inspect_picture,
    inspect_plate,
    unusable,
)
from minorloop_head.vision.calibrated_camera import Image
from minorloop_head.vision.frame_checks import GOOD
from minorloop_head.vision.imaging import opencv
from minorloop_head.vision.video import frames, names

SHOWN = 20
"""Most findings on a terminal, and most pictures in the report: those with the most evidence."""


def inspect_pictures(
    source: str,
    calibrated: Callable[[tuple[int, ...]], HeadCalibration],
    poses: Iterator[PicturePose],
    *,
    joints: bool = False,
    out: PathLike | None = None,
    told: Told = untold,
) -> dict[str, Any]:
    """Find holes, pits and cracks in pictures of a pipe, each picture alone.

    Parameters
    ----------
    source : str
        A picture, a folder of pictures, or a video.
    calibrated : callable
        Returns the calibration of the camera for the shape of the first picture.
    poses : iterator of PicturePose
        One for each picture. NaN is along the pipe.
    joints : bool
        Whether pan and tilt are readings of the joints; those of the line of sight otherwise.
    out : path, optional
        New or empty folder for findings, report and marked pictures.
    told : callable
        Called with texts on the progress.

    Returns
    -------
    dict
        Of ``findings.json``.

    Raises
    ------
    RecordError
        If there is no picture that can be read, or no pose for one.
    ParameterError
        If the source cannot be read.
    OutputError
        If the folder is not empty, or cannot be written.
    """
    views: list[HeadCalibration] = []

    def inspected(image: Image, number: int, name: str, t: float) -> InspectedPicture:
        pose = next(poses, None)
        if pose is None:
            raise RecordError(
                f"the poses have {counted(number, 'row')}, and there are more pictures; give a row "
                "for each"
            )
        if not image.size:
            return InspectedPicture(name=name, t=t, verdict=DAMAGED)
        if not views:
            views.append(calibrated(image.shape))
        sight = _line_of_sight(pose, views[0] if joints else None)
        return inspect_picture(image, views[0], sight, name, t)

    return _inspected(source, inspected, COLUMNS, out, told)


def inspect_plates(
    source: str, pixel: float, *, out: PathLike | None = None, told: Told = untold
) -> dict[str, Any]:
    """Find dark cracks in pictures of a flat rough surface, each alone, in light that is not known.

    Parameters
    ----------
    source : str
        A picture, a folder of pictures, or a video, from straight above.
    pixel : float
        Size of a pixel on the surface, in metres.
    out, told
        As of `inspect_pictures`.

    Returns
    -------
    dict
        Of ``findings.json``, with places from the left and from the top of the picture.

    Raises
    ------
    RecordError, OutputError
        As by `inspect_pictures`.
    ParameterError
        If the source cannot be read, or the size of a pixel is not positive.
    """

    def inspected(image: Image, number: int, name: str, t: float) -> InspectedPicture:
        return inspect_plate(image, pixel, name, t)

    return _inspected(source, inspected, PLATE_COLUMNS, out, told)


def _inspected(
    source: str,
    inspected: Callable[[Image, int, str, float], InspectedPicture],
    columns: Sequence[str],
    out: PathLike | None,
    told: Told,
) -> dict[str, Any]:
    """Inspect the pictures of a source one by one; write and return what was found."""
    called = names(source)
    found: list[InspectedPicture] = []
    best: list[tuple[float, str, Image]] = []
    with nullcontext(None) if out is None else _folder(out) as folder:
        for number, frame in enumerate(frames(source, damaged=True)):
            name = called[number] if called else f"frame {number}"
            picture = inspected(frame.image, number, name, frame.t)
            found.append(picture)
            told(f"{counted(len(found), 'picture')} inspected")
            if folder is not None and picture.findings:
                marked = _mark(frame.image, picture, folder / "pictures", number)
                best = sorted([*best, (_evidence(picture), name, marked)], key=lambda one: -one[0])
                best = best[:SHOWN]
        told(f"{counted(len(found), 'picture')} inspected", kept=True)
        if all(picture.verdict == DAMAGED for picture in found):
            has = "no picture that can be read" if found else "no pictures"
            raise RecordError(f"{source} has {has}; give others")
        content = _content(found, still=bool(called))
        if folder is not None:
            used = [name for name in columns if name != TIME or not called]
            _write(folder, content, used, best, Path(source).name)
    return content


@contextmanager
def _folder(out: PathLike) -> Iterator[Path]:
    """Yield a new folder; remove its pictures after an error, so that a second try can use it."""
    with new_folder(out) as folder:
        try:
            yield folder
        except BaseException:
            shutil.rmtree(folder / "pictures", ignore_errors=True)
            raise


def _line_of_sight(pose: PicturePose, view: HeadCalibration | None) -> PicturePose:
    """Return a pose with the line of sight; a calibration converts angles of the joints."""
    read = [pose.pan, pose.tilt]
    sight = read if view is None else view.line_of_sight(read).tolist()
    pan, tilt = (0.0 if math.isnan(angle) else angle for angle in sight)
    return replace(pose, pan=pan, tilt=tilt)


def _content(found: Sequence[InspectedPicture], *, still: bool) -> dict[str, Any]:
    """Return the content of ``findings.json``; still pictures have no time."""
    rows = [row for picture in found for row in picture.rows()]
    bad = [
        {"picture": each.name, TIME: round(each.t, 3), "verdict": each.verdict}
        for each in found
        if each.verdict != GOOD
    ]
    for row in (*rows, *bad) if still else ():
        del row[TIME]
    shares = [0.0 if each.light is None else each.light.searched for each in found]
    return {
        "pictures": len(found),
        "unusable": unusable(found),
        "unusable pictures": bad,
        "searched": round(sum(shares) / len(shares), 3),
        "advice": _advice(found),
        "findings": rows,
    }


def _advice(pictures: Sequence[InspectedPicture]) -> list[str]:
    """Return a warning if the light contradicts the poses."""
    wrong = [(each.name, each.light.off) for each in pictures if each.light and each.light.off]
    if not wrong:
        return []
    pan, tilt = (5 * round(median(off[n] for _, off in wrong) / 5) for n in (0, 1))
    return [
        f"the light in {counted(len(wrong), 'picture')} ({wrong[0][0]} first) does not fit pan "
        f"and tilt, and would fit about {pan:+d} and {tilt:+d} degrees more; places and sizes are "
        "wrong then, and holes are missed. With --head, pan and tilt are readings of the sensors; "
        "with --lens, they are from the axis of the pipe"
    ]


def _evidence(picture: InspectedPicture) -> float:
    """Return the evidence of a picture, by which pictures are chosen for the report."""
    evidence = [each.evidence for each in picture.findings if not math.isnan(each.evidence)]
    return max(evidence, default=0.0)


def _mark(image: Image, picture: InspectedPicture, folder: Path, number: int) -> Any:
    """Write a picture with its findings marked, and return it."""
    marked = annotated(image, picture.findings)
    folder.mkdir(exist_ok=True)
    path = folder / f"{number:06d}.jpg"
    if not opencv().imwrite(str(path), marked):
        raise OutputError(f"{path} cannot be written; check the disk")
    return marked


def _write(
    out: Path,
    content: dict[str, Any],
    columns: Sequence[str],
    best: Sequence[tuple[float, str, Any]],
    title: str,
) -> None:
    """Write findings, by the headers of their table, unusable pictures and report."""
    listed = [name for name in ("picture", TIME, "verdict") if name != TIME or name in columns]
    tables = (("findings", columns, "findings"), ("unusable", listed, "unusable pictures"))
    for name, headers, rows in tables:
        values = ([row[header] for header in headers] for row in content[rows])
        write_atomically(out / f"{name}.csv", table_text(headers, values))
    write_atomically(out / "findings.json", f"{json.dumps(content, indent=1)}\n")

    def drawn() -> Report:
        said = "; ".join([picture_summary(content), *content["advice"]])
        report = Report(f"Inspection of {title}", said)
        cells = table(content["findings"], columns)
        report.add("Findings", table=Table(tuple(columns), cells))
        pictures = [Picture(figure_of(marked), name) for _, name, marked in best]
        report.add("Pictures with the most evidence", pictures=pictures)
        return report

    written(drawn, out / "report.html")


def picture_summary(content: Mapping[str, Any]) -> str:
    """Return the numbers of findings, of pictures, and of unusable pictures as a sentence."""
    bad = ", ".join(f"{verdict} ({count})" for verdict, count in content["unusable"].items())
    count, pictures = len(content["findings"]), content["pictures"]
    said = f"{counted(count, 'finding')} in {counted(pictures, 'picture')}"
    said = f"{said}; not usable: {bad}" if bad else said
    return f"{said}; {content['searched']:.0%} of their area searched"
