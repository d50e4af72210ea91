"""Print a target at scale."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from minorloop.errors import OutputError
from minorloop.files import check_writable, write_atomically
from minorloop_head.vision.targets import CELLS, Target

_INCH = 25.4
_BAR = 20.0
"""Length in mm of the bar by which the scale of a print is checked."""
_FORMATS = (".pdf", ".svg", ".png")


def print_target(target: Target, path: Path, *, force: bool = False) -> None:
    """Write a target to a PDF, SVG or PNG file, to be printed at scale, with a bar to check it.

    Raises an `OutputError` for another format, and for a file that exists without ``force``.
    """
    if path.suffix.lower() not in _FORMATS:
        raise OutputError(f"{path} has an unknown format; end its name in {', '.join(_FORMATS)}")
    check_writable(path, force=force)
    rim = max(1e3 * target.square, 8.0)
    wide, high = 1e3 * target.size
    page_wide, page_high = max(wide, 2 * _BAR) + 2 * rim, high + 2 * rim
    figure = Figure(figsize=(page_wide / _INCH, page_high / _INCH))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(-rim, page_wide - rim), ylim=(page_high - rim, -rim))
    axes.set_axis_off()
    for left, top, width in _runs(target):
        # A small overlap downwards prevents gaps between rows in renderers.
        axes.add_patch(_rectangle(left, top, width, _cell(target) * 1.01))
    below = high + 0.35 * rim
    axes.add_patch(_rectangle(0.0, below, _BAR, 0.5))
    words = (
        f"{_BAR:g} mm; {target.kind} {target.columns}x{target.rows}, side "
        f"{1e3 * target.square:g} mm"
    )
    axes.text(0.0, below + 1.0, words, fontsize=5, va="top")
    write_atomically(path, _drawn(figure, path.suffix.lower()[1:]))


def _drawn(figure: Figure, kind: str) -> bytes:
    out = BytesIO()
    metadata = {"Software": None} if kind == "png" else {"Creator": None}
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "minorloop"}):
        figure.savefig(out, format=kind, dpi=600, metadata=metadata)
    return out.getvalue()


def _cell(target: Target) -> float:
    return 1e3 * target.square / CELLS


def _runs(target: Target) -> list[tuple[float, float, float]]:
    """Return left, top and width in mm of each run of black cells in a row."""
    size, runs = _cell(target), []
    for number, row in enumerate(target.cells()):
        edges = np.flatnonzero(np.diff(np.concatenate([[True], row, [True]])))
        for first, last in edges.reshape(-1, 2):
            runs.append((size * first, size * number, size * (last - first)))
    return runs


def _rectangle(left: float, top: float, width: float, height: float) -> Rectangle:
    return Rectangle((left, top), width, height, facecolor="black", linewidth=0)
