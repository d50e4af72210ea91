"""Report of the calibration of a head."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from minorloop.errors import counted
from minorloop.report import Picture, Report, Table
from minorloop_head.procedures.calibrate import CalibratedHead

if TYPE_CHECKING:
    from minorloop_head.vision.lens_calibration import LensFit
    from minorloop_head.vision.mount_calibration import MountFit

_ENLARGED = 100
"""Length of a residual in the report over its true length."""


def calibration_report(found: CalibratedHead) -> Report:
    """Return a report with pictures of coverage and residuals."""
    page = Report(f"Calibration of head {found.head.serial}", summary(found))
    columns = ("what", "value", "sd", "unit")
    page.add("Measured", table=Table(columns, rows(found)), notes=(*found.warnings, *found.advice))
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


def rows(found: CalibratedHead) -> list[tuple[str, str, str, str]]:
    """Return name, value, standard deviation and unit of each result as text."""
    shown = []
    for each in found.head.measured:
        places = max(1 - math.floor(math.log10(each.sd)), 0) if each.sd > 0 else 3
        numbers = f"{each.value:.{places}f}", f"{each.sd:.{places}f}"
        shown.append((each.name, *numbers, each.unit))
    return shown


def summary(found: CalibratedHead) -> str:
    """Return sentences on the used pictures and their residuals."""
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
    axes = _image_axes(lens)
    pixels = np.concatenate([each.pixels for each in lens.seen])
    off = np.concatenate([pose.residuals for pose in lens.poses])
    axes.quiver(*pixels.T, *off.T, angles="xy", scale_units="xy", scale=1 / _ENLARGED, width=0.0015)
    return axes.figure


def _joints(mount: MountFit) -> Any:
    figure = Figure(figsize=(6.0, 3.0), layout="constrained")
    axes = figure.add_subplot(xlabel="picture", ylabel="read less fitted [deg]")
    for column, name in enumerate(("pan", "tilt")):
        axes.plot(mount.joints[:, column], "o", markersize=4, label=name)
    axes.axhline(0.0, color="grey", linewidth=0.8)
    axes.legend()
    return figure
