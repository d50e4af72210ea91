"""The figure of a sweep: picture and echoes of a partly flooded pipe on one map."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.head.reconstruction.pipe_map import PipeMap
from minorloop.head.studies.mission_report import SHADES, SOURCES, water_angles
from minorloop.head.ultrasound.c_scan import CRACK, PIT
from minorloop.identification.bands import PER_DEVIATION
from minorloop.report import Table
from minorloop.studies.drawing import new_figure

_CONTRAST = 0.5
"""Range of the logarithm of reflectance about its median that is drawn from black to white."""
_DEEPEST = 1.0  # mm, of the colours of depths
_MARKS = {PIT: "o", CRACK: "s"}


def draw_pipe_map(fused: PipeMap) -> Any:
    """Draw picture and amplitude, depth, its 90 % band, and the source of each texel."""
    from matplotlib.colors import ListedColormap

    figure, axes = new_figure(4, 1, height=7.6, sharex=True)
    patch, wall = fused.wall.patch, fused.wall
    start = np.degrees(patch.phi)
    end = start + np.degrees(patch.columns * patch.step / patch.radius)
    extent = (start, end, 1e3 * patch.z, 1e3 * (patch.z + patch.rows * patch.step))
    shown = {"origin": "lower", "extent": extent, "aspect": "auto", "interpolation": "nearest"}
    grey = np.clip(0.5 + fused.picture / (2 * _CONTRAST), 0.0, 1.0)
    axes[0].imshow(grey, cmap="gray", vmin=0.0, vmax=1.0, **shown)
    loud = axes[0].imshow(fused.amplitude, cmap="viridis", vmin=0.0, vmax=1.1, **shown)
    figure.colorbar(loud, ax=axes[0], label="of a plain wall")
    axes[0].set_title("grey: the picture; in colours: amplitude of the echo of the wall")
    depth = 1e3 * np.where(np.isfinite(wall.depth), wall.depth, np.nan)
    drawn = axes[1].imshow(depth, cmap="viridis", vmin=-0.1, vmax=_DEEPEST, **shown)
    figure.colorbar(drawn, ax=axes[1], label="[mm]")
    axes[1].set_title(
        "depth; circles: pits, squares: cracks, diamonds: cut by the edge; with depths in mm"
    )
    band = 1e3 * PER_DEVIATION * np.where(np.isfinite(wall.sd), wall.sd, np.nan)
    drawn = axes[2].imshow(band, cmap="magma", vmin=0.0, vmax=0.2, **shown)
    figure.colorbar(drawn, ax=axes[2], label="[mm]", extend="max")
    axes[2].set_title("half the 90 % band of the depth")
    drawn = axes[3].imshow(wall.source, cmap=ListedColormap(SHADES), vmin=-0.5, vmax=3.5, **shown)
    bar = figure.colorbar(drawn, ax=axes[3], ticks=range(4))
    bar.ax.set_yticklabels(SOURCES)
    axes[3].set_title(f"source; {wall.unseen:.0%} without any")
    level = "the dashed line is the water" if fused.water.seen else "the level was not seen"
    axes[3].set_xlabel(f"around the pipe [degrees], 90 at the bottom; {level}")
    height = fused.water.height if fused.water.seen else math.nan
    lines = _on_axis(water_angles(height, patch.radius), start)
    for one in axes:
        one.grid(False)
        one.set_ylabel("along [mm]")
        for phi in lines:
            one.axvline(phi, color="C3", lw=1.2, ls="--")
    _mark_finds(axes[1], fused, start)
    return figure


def finds_table(fused: PipeMap) -> Table:
    """Return a row for each find of the echoes."""
    rows = [
        (
            find.kind,
            f"{np.degrees(find.phi):.1f}",
            f"{1e3 * find.z:.2f}",
            f"{1e3 * find.diameter:.2f}",
            f"{1e3 * find.length:.2f}",
            f"{1e3 * find.depth:.3f}" if np.isfinite(find.depth) else "-",
            f"{1e3 * PER_DEVIATION * find.depth_sd:.3f}" if np.isfinite(find.depth) else "-",
        )
        for find in fused.finds
    ]
    columns = (
        "find",
        "phi, degrees",
        "z, mm",
        "width, mm",
        "length, mm",
        "depth, mm",
        "90 % band, mm",
    )
    return Table(columns, rows)


def _mark_finds(axes: Any, fused: PipeMap, start: float) -> None:
    """Draw a mark about each find, with its depth."""
    for find in fused.finds:
        phi = float(_on_axis(np.degrees([find.phi]), start)[0])
        mark = _MARKS.get(find.kind, "D")
        axes.plot(phi, 1e3 * find.z, mark, ms=16, mec="C1", mfc="none", mew=1.4)
        if np.isfinite(find.depth):
            axes.annotate(
                f"{1e3 * find.depth:.2f}", (phi, 1e3 * find.z), (12, 0), va="center",
                textcoords="offset points", bbox={"fc": "w", "ec": "none", "pad": 1.0},
            )  # fmt: skip


def _on_axis(degrees: FloatArray, start: float) -> FloatArray:
    """Return angles from the start of an axis on."""
    return np.asarray((np.asarray(degrees) - start) % 360.0 + start)
