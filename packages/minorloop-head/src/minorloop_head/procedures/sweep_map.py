"""Figures of the map of a sweep and of the wall about a finding, and the table of a sweep."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy.ndimage import zoom

from minorloop.arrays import FloatArray, IntArray
from minorloop.drawing.layout import new_figure
from minorloop.identification.bands import PER_DEVIATION
from minorloop.report import Table
from minorloop_head.geometry import wrapped
from minorloop_head.reconstruction.depth_map import ECHOES, UNSEEN, DepthMap, Patch
from minorloop_head.reconstruction.findings import DIGITS, rounded
from minorloop_head.ultrasound.c_scan import CRACK, NO_ECHO, PIT, CScan

_NARROW = 0.55  # ratio of width to length below which a map has two ticks across
_EVEN = 1e-6  # mm; a map with a smaller range has one colour
_MOST_FACES = 160  # along a side of a surface
_WIDE = 7.0  # inches, the width of a map of the pipe
_FINEST = 4  # largest number of parts of a side of a texel, for smooth rims
SOURCES = ("unseen", "camera", "echoes", "both")
_SHADES = ("0.25", "0.72", "#6ea0c8", "#e8b04a")
CONTRAST = 0.6
"""Range of the logarithm of reflectance about its median that is drawn from black to white."""
_LOUD, _DEEP = (0.0, 1.1), (-0.1, 1.0)
"""Limits of the colour scales of amplitudes relative to a plain wall, and of depths in mm."""
_MARGIN = 1e-3
"""Margin of wall in metres that is drawn beyond a find outside the area."""
_MARKS = {PIT: "o", CRACK: "s", NO_ECHO: "^"}
_DIGITS = DIGITS | {"90 % band [mm]": 3}


@dataclass(frozen=True, eq=False)
class _Shown:
    """The columns of a map that are drawn, the angle of the first, and how images are drawn."""

    columns: IntArray
    start: float
    options: dict[str, Any]

    @classmethod
    def of(cls, patch: Patch, around: tuple[float, float] | None) -> _Shown:
        columns = columns_within(patch, around)
        turn = math.degrees(patch.step / patch.radius)
        start = math.degrees(patch.phi) + turn * float(columns[0])
        ends = start, start + turn * columns.size
        extent = (*ends, 1e3 * patch.z, 1e3 * (patch.z + patch.rows * patch.step))
        equal = math.degrees(1.0) / (1e3 * patch.radius)  # equal scales in both directions
        image = {"origin": "lower", "extent": extent, "aspect": equal}
        return cls(columns, start, {**image, "interpolation": "nearest"})


def columns_within(patch: Patch, around: tuple[float, float] | None) -> IntArray:
    """Return the columns of a ring between two angles in radians, in order; None means all."""
    if around is None:
        return np.arange(patch.columns)
    texels = patch.radius / patch.step
    first = round((around[0] - patch.phi) * texels)
    count = min(max(round((around[1] - around[0]) * texels), 1), patch.columns)
    return np.asarray((first + np.arange(count)) % patch.columns)


def mapped_share(scan: CScan, around: tuple[float, float]) -> float:
    """Return the share of the wall between two angles in radians that is mapped."""
    source = scan.wall.source[:, columns_within(scan.wall.patch, around)]
    return float(np.mean(source != UNSEEN))


def draw_pipe_map(
    scan: CScan,
    around: tuple[float, float] | None = None,
    *,
    picture: FloatArray | None = None,
    brief: bool = False,
) -> Any:
    """Draw picture and amplitude, depth, its 90 % band, and the source of each texel.

    ``around``: angles in radians between which it is drawn, and as far as there are finds; the
    whole pipe without them. ``picture`` (rows, columns): logarithm of the reflectance where a
    camera saw the wall; NaN elsewhere. ``brief``: whether to draw the first two only.
    """
    amplitude = partial(_draw_amplitude, picture)
    panels = (amplitude, _draw_depth, _draw_band, _draw_source)[: 2 if brief else 4]
    shown = _Shown.of(scan.wall.patch, around and _with_finds(around, scan))
    tall = _WIDE * scan.wall.patch.rows / shown.columns.size
    height = len(panels) * (0.9 + min(max(tall, 0.4), 3.0)) + 0.4
    figure, axes = new_figure(len(panels), 1, height, grid=False, sharex=True)
    for one, draw in zip(axes, panels, strict=True):
        draw(figure, one, scan, shown)
        one.set_ylabel("along [mm]")
        for phi in _water_lines(scan, shown):
            one.axvline(phi, color="C3", lw=1.2, ls="--")
    level = "the dashed line is the water" if scan.water.seen else "the level was not seen"
    axes[-1].set_xlabel(f"around the pipe [degrees], 90 at the bottom; {level}")
    return figure


def _draw_amplitude(
    picture: FloatArray | None, figure: Any, axes: Any, scan: CScan, shown: _Shown
) -> None:
    if picture is not None:
        grey = np.clip(0.5 + picture[:, shown.columns] / (2 * CONTRAST), 0.0, 1.0)
        axes.imshow(grey, cmap="gray", vmin=0.0, vmax=1.0, **shown.options)
    loud = scan.amplitude[:, shown.columns]
    drawn = axes.imshow(loud, cmap="viridis", vmin=_LOUD[0], vmax=_LOUD[1], **shown.options)
    figure.colorbar(drawn, ax=axes, label="of a plain wall")
    grey_too = "" if picture is None else "grey: the picture; in colours: "
    axes.set_title(f"{grey_too}amplitude of the echo of the wall")


def _draw_depth(figure: Any, axes: Any, scan: CScan, shown: _Shown) -> None:
    depth = 1e3 * _known(scan.wall.depth[:, shown.columns])
    drawn = axes.imshow(depth, cmap="viridis", vmin=_DEEP[0], vmax=_DEEP[1], **shown.options)
    figure.colorbar(drawn, ax=axes, label="[mm]")
    axes.set_title(
        "depth in mm; circles: pits, squares: cracks, triangles: no echo, diamonds: cut by the edge"
    )
    _mark_finds(axes, scan, shown.start)


def _draw_band(figure: Any, axes: Any, scan: CScan, shown: _Shown) -> None:
    band = 1e3 * PER_DEVIATION * _known(scan.wall.sd[:, shown.columns])
    drawn = axes.imshow(band, cmap="magma", vmin=0.0, vmax=0.2, **shown.options)
    figure.colorbar(drawn, ax=axes, label="[mm]", extend="max")
    axes.set_title("half the 90 % band of the depth")


def _draw_source(figure: Any, axes: Any, scan: CScan, shown: _Shown) -> None:
    from matplotlib.colors import ListedColormap

    source = scan.wall.source[:, shown.columns]
    drawn = axes.imshow(source, cmap=ListedColormap(_SHADES), vmin=-0.5, vmax=3.5, **shown.options)
    bar = figure.colorbar(drawn, ax=axes, ticks=range(4))
    bar.ax.set_yticklabels(SOURCES)
    axes.set_title(f"source; {np.mean(source == UNSEEN):.0%} without any")


def _known(values: FloatArray) -> FloatArray:
    return np.where(np.isfinite(values), values, np.nan)


def _water_lines(scan: CScan, shown: _Shown) -> list[float]:
    """Return the angles in degrees at which the drawn part has the water line."""
    if not scan.water.seen:
        return []
    found = _on_axis(water_angles(scan.water.height, scan.wall.patch.radius), shown.start)
    return [phi for phi in found.tolist() if phi <= shown.options["extent"][1]]


def water_angles(height: float, radius: float) -> FloatArray:
    """Return the angles in degrees at which the water meets the wall; none if all is flooded."""
    if not abs(height) < 0.995 * radius:
        return np.empty(0)
    up = float(np.degrees(np.arcsin(height / radius)))
    both = np.array([up, 180.0 - up])
    return (both + 180.0) % 360.0 - 180.0


def find_rows(scan: CScan) -> list[dict[str, str | float | None]]:
    """Return a row for each find of the echoes, in degrees and mm; None where not known."""
    rows: list[dict[str, str | float | None]] = []
    for find in scan.finds:
        lengths = find.z, find.diameter, find.length, find.depth, PER_DEVIATION * find.depth_sd
        values = np.array([np.degrees(find.phi), *np.multiply(1e3, lengths)])
        named = zip(_DIGITS.items(), values.tolist(), strict=True)
        known = {name: rounded(each, digits) for (name, digits), each in named}
        kind = f"{find.kind} of at least this length" if find.at_least else find.kind
        rows.append({"find": kind, **known})
    return rows


def finds_table(scan: CScan) -> Table:
    """Return `find_rows` as text."""
    rows = [
        (
            str(row["find"]),
            *("-" if row[name] is None else f"{row[name]:.{n}f}" for name, n in _DIGITS.items()),
        )
        for row in find_rows(scan)
    ]
    return Table(("find", *_DIGITS), rows)


def _mark_finds(axes: Any, scan: CScan, start: float) -> None:
    """Draw a mark about each find, with its depth."""
    for find in scan.finds:
        phi = float(_on_axis(np.degrees([find.phi]), start)[0])
        mark = _MARKS.get(find.kind, "D")
        axes.plot(phi, 1e3 * find.z, mark, ms=16, mec="C1", mfc="none", mew=1.4)
        if np.isfinite(find.depth):
            axes.annotate(
                f"{1e3 * find.depth:.2f}", (phi, 1e3 * find.z), (12, 0), va="center",
                textcoords="offset points", bbox={"fc": "w", "ec": "none", "pad": 1.0},
            )  # fmt: skip


def _with_finds(around: tuple[float, float], scan: CScan) -> tuple[float, float]:
    """Return angles widened to finds beyond them: a line is longer than its area at either end."""
    middle, margin = 0.5 * sum(around), _MARGIN / scan.wall.patch.radius
    finds = [middle + float(wrapped(find.phi - middle)) for find in scan.finds]
    return (
        min([around[0], *(phi - margin for phi in finds)]),
        max([around[1], *(phi + margin for phi in finds)]),
    )


def _on_axis(degrees: FloatArray, start: float) -> FloatArray:
    """Return angles as values from the start of an axis on, below one turn more."""
    return np.asarray((np.asarray(degrees) - start) % 360.0 + start)


def draw_finding(wall: DepthMap) -> Any:
    """Draw depth about a finding, its 90 % band, the sources, and the wall in three dimensions.

    Without an echo there is no depth, and the sources alone are drawn.
    """
    from matplotlib.figure import Figure

    wide, long = (5e2 * n * wall.patch.step for n in (wall.patch.columns, wall.patch.rows))
    if not (wall.source & ECHOES).any():
        figure = Figure(figsize=(4.6, 3.5), layout="constrained")
        axes = _plane(figure, (1, 1, 1), (wide, long), "source; no echo gives a depth")
        _draw_sources(axes, wall, (-wide, wide, -long, long))
        return figure
    figure = Figure(figsize=(9.2, 7.0), layout="constrained")
    depth = 1e3 * np.where(np.isfinite(wall.depth), wall.depth, np.nan)
    band = 1e3 * PER_DEVIATION * np.where(np.isfinite(wall.sd), wall.sd, np.nan)
    low, _ = _limits(wall)
    axes = _plane(figure, (2, 2, 1), (wide, long), "depth under the wall [mm]")
    _draw_values(axes, np.maximum(depth, 1e3 * low), (-wide, wide, -long, long))
    axes = _plane(figure, (2, 2, 2), (wide, long), "half the 90 % band of it [mm]")
    _draw_values(axes, band, (-wide, wide, -long, long))
    axes = _plane(figure, (2, 2, 3), (wide, long), "source")
    _draw_sources(axes, wall, (-wide, wide, -long, long))
    _solid(figure.add_subplot(2, 2, 4, projection="3d"), wall)
    return figure


def draw_c_scan(scan: CScan) -> Any:
    """Draw amplitude and depth of the echoes about a finding, in the same colours for all."""
    figure, axes = new_figure(1, 2, 3.4, grid=False)
    patch = scan.wall.patch
    wide, long = (5e2 * n * patch.step for n in (patch.columns, patch.rows))
    panels = (
        (scan.amplitude, _LOUD, "amplitude of the echo over that of plain wall"),
        (1e3 * scan.wall.depth, _DEEP, "depth of the strongest echo [mm]"),
    )
    for one, (values, (low, high), title) in zip(axes, panels, strict=True):
        one.set(title=title, xlabel="around the pipe [mm]", ylabel="along the pipe [mm]")
        extent = (-wide, wide, -long, long)
        one.imshow(values, origin="lower", extent=extent, cmap="viridis", vmin=low, vmax=high)
        figure.colorbar(one.images[0], ax=one, shrink=0.9, extend="both")
    return figure


def _draw_sources(axes: Any, wall: DepthMap, extent: tuple[float, float, float, float]) -> None:
    from matplotlib.colors import ListedColormap

    colours = {"cmap": ListedColormap(_SHADES), "vmin": -0.5, "vmax": 3.5}
    shown = axes.imshow(wall.source, origin="lower", extent=extent, **colours)
    bar = axes.figure.colorbar(shown, ax=axes, shrink=0.9, ticks=range(4))
    bar.ax.set_yticklabels(SOURCES)


def _plane(figure: Any, place: tuple[int, int, int], half: tuple[float, float], title: str) -> Any:
    """Return axes of an unrolled piece of wall; narrow ones have two ticks across."""
    axes = figure.add_subplot(*place)
    axes.set(title=title, xlabel="around the pipe [mm]", ylabel="along the pipe [mm]")
    if half[0] < _NARROW * half[1]:
        axes.set_xticks(_two_ticks(half[0]))
    return axes


def _two_ticks(half: float) -> tuple[float, float]:
    """Return a negative and a positive round number within a half width."""
    unit = 10.0 ** np.floor(np.log10(half))
    at = float(unit * np.floor(0.9 * half / unit) or 0.5 * unit)
    return -at, at


def _draw_values(axes: Any, values: FloatArray, extent: tuple[float, float, float, float]) -> None:
    """Draw a map of a quantity with its colours; describe a constant one in words."""
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    even = high - low < _EVEN
    # A constant map has the shade of wall that the camera has seen.
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
    fine = min(_FINEST, max(_MOST_FACES // max(wall.depth.shape), 1))
    depth = np.where(np.isfinite(wall.depth), 1e3 * wall.depth, np.nan)
    down = -zoom(depth, fine, order=1, grid_mode=False)
    x, y = (5e2 * n * wall.patch.step * np.linspace(-1.0, 1.0, fine * n) for n in depth.shape[::-1])
    radius = 1e3 * wall.patch.radius
    colours = _shades(wall, -1e-3 * down)
    down = down + (radius - np.sqrt(radius**2 - x**2))[None, :]
    _add_quads(axes, np.stack([*np.meshgrid(x, y), down], axis=-1), colours)
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
    """Draw a surface of (rows, columns, 3) corners; `plot_surface` draws garbage beside NaN."""
    from mpl_toolkits.mplot3d import art3d

    every = max(-(-max(shades.shape[:2]) // _MOST_FACES), 1)
    few, colours = corners[::every, ::every], shades[::every, ::every]
    quads = np.stack([few[:-1, :-1], few[:-1, 1:], few[1:, 1:], few[1:, :-1]], axis=2)
    known = np.isfinite(quads).all(axis=(2, 3))
    if known.any():
        polygons: Any = art3d.Poly3DCollection
        shown = colours[:-1, :-1][known]
        drawn = polygons(quads[known], facecolors=shown, shade=True, antialiased=False)
        axes.add_collection3d(drawn)


def _shades(wall: DepthMap, depth: FloatArray) -> FloatArray:
    """Return colours (rows, columns, 4) of depths in metres, as in the map beside."""
    from matplotlib import colormaps

    low, high = _limits(wall)
    share = (np.where(np.isfinite(depth), depth, low) - low) / max(high - low, 1e-6)
    return np.asarray(colormaps["viridis"](share))


def _limits(wall: DepthMap) -> tuple[float, float]:
    """Return the least and greatest depth of colours, in m; heights within a band count as 0."""
    known = np.isfinite(wall.depth)
    if not known.any():
        return 0.0, 0.0
    depth, band = wall.depth[known], PER_DEVIATION * wall.sd[known]
    sure = np.where(np.abs(depth) < band, np.maximum(depth, 0.0), depth)
    return float(sure.min()), float(depth.max())
