"""Figure of the wall about a finding: depth, its band, the sources, and the surface in 3-D."""

from __future__ import annotations

from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.drawing.layout import new_figure
from minorloop.identification.bands import PER_DEVIATION
from minorloop_head.procedures.sweep_map import DEEP, LOUD, SHADES, SOURCES
from minorloop_head.reconstruction.depth_map import DepthMap
from minorloop_head.ultrasound.c_scan import CScan

_NARROW = 0.55  # of its length is the width of a map that has two ticks across
_EVEN = 1e-6  # mm, between the least and the most of a map of one colour
_MOST_FACES = 160  # along a side of a surface
_FINE = 60  # texels a side, from which on their edges are not drawn


def draw_finding(wall: DepthMap) -> Any:
    """Draw depth about a finding, its 90 % band, the sources, and the wall in three dimensions."""
    from matplotlib.colors import ListedColormap
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.2, 7.0), layout="constrained")
    depth = 1e3 * np.where(np.isfinite(wall.depth), wall.depth, np.nan)
    band = 1e3 * PER_DEVIATION * np.where(np.isfinite(wall.sd), wall.sd, np.nan)
    wide, long = (5e2 * n * wall.patch.step for n in (wall.patch.columns, wall.patch.rows))
    low, _ = _limits(wall)
    axes = _plane(figure, 1, (wide, long), "depth under the wall [mm]")
    _draw_values(axes, np.maximum(depth, 1e3 * low), (-wide, wide, -long, long))
    axes = _plane(figure, 2, (wide, long), "half the 90 % band of it [mm]")
    _draw_values(axes, band, (-wide, wide, -long, long))
    axes = _plane(figure, 3, (wide, long), "source")
    shown = axes.imshow(
        wall.source,
        origin="lower",
        extent=(-wide, wide, -long, long),
        cmap=ListedColormap(SHADES),
        vmin=-0.5,
        vmax=3.5,
    )
    bar = figure.colorbar(shown, ax=axes, shrink=0.9, ticks=range(4))
    bar.ax.set_yticklabels(SOURCES)
    _solid(figure.add_subplot(2, 2, 4, projection="3d"), wall)
    return figure


def draw_c_scan(scan: CScan) -> Any:
    """Draw amplitude and depth of the echoes about a finding, in the same colours for all."""
    figure, axes = new_figure(1, 2, 3.4, grid=False)
    patch = scan.wall.patch
    wide, long = (5e2 * n * patch.step for n in (patch.columns, patch.rows))
    panels = (
        (scan.amplitude, LOUD, "amplitude of the echo over that of plain wall"),
        (1e3 * scan.wall.depth, DEEP, "depth of the strongest echo [mm]"),
    )
    for one, (values, (low, high), title) in zip(axes, panels, strict=True):
        one.set(title=title, xlabel="around the pipe [mm]", ylabel="along the pipe [mm]")
        extent = (-wide, wide, -long, long)
        one.imshow(values, origin="lower", extent=extent, cmap="viridis", vmin=low, vmax=high)
        figure.colorbar(one.images[0], ax=one, shrink=0.9, extend="both")
    return figure


def _plane(figure: Any, place: int, half: tuple[float, float], title: str) -> Any:
    """Return axes of an unrolled piece of wall, with as many ticks as fit."""
    axes = figure.add_subplot(2, 2, place)
    axes.set(title=title, xlabel="around the pipe [mm]", ylabel="along the pipe [mm]")
    if half[0] < _NARROW * half[1]:
        axes.set_xticks(_two_ticks(half[0]))
    return axes


def _two_ticks(half: float) -> tuple[float, float]:
    """Return a round number of each sign within a half width."""
    unit = 10.0 ** np.floor(np.log10(half))
    at = float(unit * np.floor(0.9 * half / unit) or 0.5 * unit)
    return -at, at


def _draw_values(axes: Any, values: FloatArray, extent: tuple[float, float, float, float]) -> None:
    """Draw a map of a number with its colours; write an even one in words."""
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    even = high - low < _EVEN
    # An even map has the shade of wall that the camera has seen.
    axes.imshow(
        np.where(np.isfinite(values), 0.0, np.nan) if even else values,
        origin="lower", extent=extent, cmap="Greys_r" if even else "viridis",
        vmin=-0.6 if even else low, vmax=0.25 if even else high,
    )  # fmt: skip
    if not even:
        axes.figure.colorbar(axes.images[0], ax=axes, shrink=0.9)
        return
    words = f"{low:.3g} mm\nwherever known" if known.size else "nowhere known"
    place = {"x": 1.06, "y": 0.5, "va": "center", "fontsize": 9, "transform": axes.transAxes}
    axes.text(s=f"{words}\n(blank: unknown)" if known.size else words, **place)


def _solid(axes: Any, wall: DepthMap) -> None:
    """Draw the curved wall from inside, the depth down, with holes where it is not known."""
    x, y = (5e2 * n * wall.patch.step * np.linspace(-1.0, 1.0, n) for n in wall.depth.shape[::-1])
    radius = 1e3 * wall.patch.radius
    bow = radius - np.sqrt(radius**2 - x**2)
    down = np.where(np.isfinite(wall.depth), -1e3 * wall.depth, np.nan) + bow[None, :]
    _add_quads(axes, np.stack([*np.meshgrid(x, y), down], axis=-1), _shades(wall))
    axes.auto_scale_xyz(x, y, down[np.isfinite(down)] if np.isfinite(down).any() else [0.0])
    axes.set_aspect("equalxy")
    axes.locator_params(axis="z", nbins=3)
    axes.set_xticks(_two_ticks(float(x[-1])))
    axes.set_yticks(_two_ticks(float(y[-1])))
    axes.set_title("in 3-D from the axis; open where unknown")
    axes.set_xlabel("around [mm]", labelpad=-2)
    axes.set_ylabel("along [mm]", labelpad=-2)
    axes.set_zlabel("height [mm]", labelpad=-4)
    axes.tick_params(labelsize=7, pad=-2)
    # Steep enough to see a floor behind the rim of its pit.
    axes.view_init(elev=72, azim=-55)


def _add_quads(axes: Any, corners: FloatArray, shades: FloatArray) -> None:
    """Draw a surface of (rows, columns, 3) corners; that of matplotlib draws garbage beside NaN."""
    from mpl_toolkits.mplot3d import art3d

    every = max(-(-max(shades.shape[:2]) // _MOST_FACES), 1)
    few, colours = corners[::every, ::every], shades[::every, ::every]
    quads = np.stack([few[:-1, :-1], few[:-1, 1:], few[1:, 1:], few[1:, :-1]], axis=2)
    known = np.isfinite(quads).all(axis=(2, 3))
    if known.any():
        fine = max(shades.shape) >= _FINE
        polygons: Any = art3d.Poly3DCollection
        lines = {"antialiased": False} if fine else {"linewidth": 0.15, "edgecolors": "0.4"}
        shown = colours[:-1, :-1][known]
        axes.add_collection3d(polygons(quads[known], facecolors=shown, shade=True, **lines))


def _shades(wall: DepthMap) -> FloatArray:
    """Return colours (rows, columns, 4) of depths, those of the map beside."""
    from matplotlib import colormaps

    low, high = _limits(wall)
    share = (np.where(np.isfinite(wall.depth), wall.depth, low) - low) / max(high - low, 1e-6)
    return np.asarray(colormaps["viridis"](share))


def _limits(wall: DepthMap) -> tuple[float, float]:
    """Return the least and greatest depth of colours, in m; heights within a band count as 0."""
    known = np.isfinite(wall.depth)
    if not known.any():
        return 0.0, 0.0
    depth, band = wall.depth[known], PER_DEVIATION * wall.sd[known]
    sure = np.where(np.abs(depth) < band, np.maximum(depth, 0.0), depth)
    return float(sure.min()), float(depth.max())
