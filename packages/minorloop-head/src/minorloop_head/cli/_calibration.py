"""What ``minorloop head calibrate`` prints and draws."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from minorloop.cli import _common
from minorloop.errors import OutputError, ParameterError, counted
from minorloop.values import called, parsed

if TYPE_CHECKING:
    from minorloop.arrays import FloatArray
    from minorloop.report import Report
    from minorloop_head.procedures.calibrate import CalibratedHead, ExpectedTarget
    from minorloop_head.vision.lens_calibration import LensFit
    from minorloop_head.vision.mount_calibration import MountFit
    from minorloop_head.vision.targets import Target

_INCH = 25.4
_BAR = 20.0
"""Length in mm of the bar by which the scale of a print is checked."""
_NEAREST, _FARTHEST = 0.2, 50.0
"""Distances of an LED from the lens in mm: the smallest camera modules are 0.6 mm wide, and an LED
beyond the pipe lights nothing."""
_FORMATS = (".pdf", ".svg", ".png")
_ENLARGED = 100
"""Length of a residual in the report, in its own length."""


def target_of(text: str) -> ExpectedTarget:
    """Return the target of ``auto,side=3``."""
    from minorloop.arrays import as_finite
    from minorloop_head.procedures.calibrate import AUTO, ExpectedTarget
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


def pipe_of(text: str) -> dict[str, float]:
    """Return radius and thickness in metres of ``radius=10,thickness=2``, those that are given."""
    from minorloop.arrays import as_finite

    def made(radius: float | None = None, thickness: float | None = None) -> dict[str, float]:
        given = {"radius": (radius, 1000.0), "thickness": (thickness, 100.0)}
        for name, (value, most) in given.items():
            if value is not None and not 0.1 <= as_finite(f"{name} of --pipe", value) <= most:
                raise ParameterError(f"{name} of --pipe is {value}; give 0.1 to {most:g} mm")
        return {name: 1e-3 * value for name, (value, _) in given.items() if value is not None}

    return called(made, "--pipe", parsed(text).options)


def leds_of(text: str | None) -> tuple[FloatArray | None, Path | None]:
    """Return positions (N, 3) in metres of ``x,y,z;x,y,z`` in mm, or a folder of pictures."""
    import numpy as np

    if text is None or Path(text).is_dir():
        return None, None if text is None else Path(text)
    form = "x,y,z in mm for each LED, with ; between them, or a folder of pictures"
    places = [_common.numbers("leds", part, (3,), form) for part in text.split(";")]
    found = np.array(places)
    away = np.linalg.norm(found, axis=1)
    if not (away.min() >= _NEAREST and away.max() <= _FARTHEST):
        raise ParameterError(
            f"--leds is {text!r}; give places {_NEAREST:g} to {_FARTHEST:g} mm from the lens, in mm"
        )
    return 1e-3 * found, None


def print_target(expected: ExpectedTarget, path: Path, *, force: bool, as_json: bool) -> None:
    """Write a target to be printed at scale, with a bar to check the scale."""
    from matplotlib.figure import Figure

    from minorloop.files import check_writable, write_atomically

    if path.suffix.lower() not in _FORMATS:
        raise OutputError(f"{path} is of no known format; let it end in {', '.join(_FORMATS)}")
    check_writable(path, force=force)
    target = expected.printed()
    rim = max(1e3 * target.square, 8.0)
    wide, high = 1e3 * target.size
    page_wide, page_high = max(wide, 2 * _BAR) + 2 * rim, high + 2 * rim
    figure = Figure(figsize=(page_wide / _INCH, page_high / _INCH))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(-rim, page_wide - rim), ylim=(page_high - rim, -rim))
    axes.set_axis_off()
    for left, top, width in _runs(target):
        # A little overlap downwards keeps renderers from leaving gaps between rows.
        axes.add_patch(_rectangle(left, top, width, _cell(target) * 1.01))
    below = high + 0.35 * rim
    axes.add_patch(_rectangle(0.0, below, _BAR, 0.5))
    words = (
        f"{_BAR:g} mm; {target.kind} {target.columns}x{target.rows}, side "
        f"{1e3 * target.square:g} mm"
    )
    axes.text(0.0, below + 1.0, words, fontsize=5, va="top")
    write_atomically(path, _drawn(figure, path.suffix.lower()[1:]))
    if as_json:
        _common.print_json({"target": str(path)})
    else:
        typer.echo(f"kept in {path}; print it at 100 %, and measure the bar and a square")


def _drawn(figure: Any, kind: str) -> bytes:
    import io

    from matplotlib import rc_context

    out = io.BytesIO()
    metadata = {"Software": None} if kind == "png" else {"Creator": None}
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "minorloop"}):
        figure.savefig(out, format=kind, dpi=600, metadata=metadata)
    return out.getvalue()


def _cell(target: Target) -> float:
    from minorloop_head.vision.targets import CELLS

    return 1e3 * target.square / CELLS


def _runs(target: Target) -> list[tuple[float, float, float]]:
    """Return left, top and width in mm of each run of black cells in a row."""
    import numpy as np

    size, runs = _cell(target), []
    for number, row in enumerate(target.cells()):
        edges = np.flatnonzero(np.diff(np.concatenate([[True], row, [True]])))
        for first, last in edges.reshape(-1, 2):
            runs.append((size * first, size * number, size * (last - first)))
    return runs


def _rectangle(left: float, top: float, width: float, height: float) -> Any:
    from matplotlib.patches import Rectangle

    return Rectangle((left, top), width, height, facecolor="black", linewidth=0)


def show(found: CalibratedHead, path: Path, as_json: bool) -> None:
    """Print a calibration."""
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
    _common.print_table(("what", "value", "sd", "unit"), _rows(found), f"head {head.serial}")
    typer.echo(_summary(found))
    for name, why in found.left_out.items():
        typer.echo(f"left out: {name} ({why})")
    _common.print_advice(found.advice)
    for sentence in found.warnings:
        typer.echo(f"warning: {sentence}", err=True)
    typer.echo(f"kept in {path}; next: minorloop head identify --head {path}")


def report(found: CalibratedHead) -> Report:
    """Return a report with pictures of coverage and residuals."""
    from minorloop.report import Picture, Report, Table

    page = Report(f"Calibration of head {found.head.serial}", _summary(found))
    columns = ("what", "value", "sd", "unit")
    page.add("Measured", table=Table(columns, _rows(found)), notes=(*found.warnings, *found.advice))
    if found.lens is not None:
        page.add(
            "Lens",
            pictures=[
                Picture(_coverage(found.lens), "Corners of all pictures, and ninths of the image."),
                Picture(_residuals(found.lens), f"Residuals, {_ENLARGED} times as long."),
            ],
        )
    if found.mount is not None:
        caption = "Read less fitted angles of the joints."
        page.add("Mount", pictures=[Picture(_joints(found.mount), caption)])
    if found.left_out:
        page.add("Left out", table=Table(("picture", "why"), list(found.left_out.items())))
    return page


def _rows(found: CalibratedHead) -> list[tuple[str, str, str, str]]:
    rows = []
    for each in found.head.measured:
        places = max(1 - math.floor(math.log10(each.sd)), 0) if each.sd > 0 else 3
        numbers = f"{each.value:.{places}f}", f"{each.sd:.{places}f}"
        rows.append((each.name, *numbers, each.unit))
    return rows


def _summary(found: CalibratedHead) -> str:
    used = [f"{counted(count, 'picture')} for {what}" for what, count in found.used.items()]
    said = f"used: {', '.join(used) or 'no pictures'}; left out: {len(found.left_out)}"
    if found.target is not None:
        said += f"; {found.target}"
    if found.lens is not None:
        said += (
            f"; residual of the corners {found.lens.rms:.2g} px rms, {found.lens.rms_left_out:.2g} "
            f"in pictures left out; free in the lens: {found.lens.model}"
        )
    if found.mount is not None:
        said += f"; residual of the angles {found.mount.rms:.2g} deg rms"
    return said


def _image_axes(lens: LensFit) -> Any:
    from matplotlib.figure import Figure

    size = (6.0, 6.0 * lens.lens.height / lens.lens.width)
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.add_subplot(xlabel="u [px]", ylabel="v [px]", aspect="equal")
    axes.set(xlim=(-0.5, lens.lens.width - 0.5), ylim=(lens.lens.height - 0.5, -0.5))
    return axes


def _coverage(lens: LensFit) -> Any:
    axes = _image_axes(lens)
    for each in lens.seen:
        axes.plot(each.pixels[:, 0], each.pixels[:, 1], ".", markersize=3)
    for third in (1, 2):
        axes.axvline(third * lens.lens.width / 3 - 0.5, color="grey", linewidth=0.8)
        axes.axhline(third * lens.lens.height / 3 - 0.5, color="grey", linewidth=0.8)
    return axes.figure


def _residuals(lens: LensFit) -> Any:
    import numpy as np

    axes = _image_axes(lens)
    pixels = np.concatenate([each.pixels for each in lens.seen])
    off = np.concatenate([pose.residuals for pose in lens.poses])
    axes.quiver(*pixels.T, *off.T, angles="xy", scale_units="xy", scale=1 / _ENLARGED, width=0.0015)
    return axes.figure


def _joints(mount: MountFit) -> Any:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.0, 3.0), layout="constrained")
    axes = figure.add_subplot(xlabel="picture", ylabel="read less fitted [deg]")
    for column, name in enumerate(("pan", "tilt")):
        axes.plot(mount.joints[:, column], "o", markersize=4, label=name)
    axes.axhline(0.0, color="grey", linewidth=0.8)
    axes.legend()
    return figure
