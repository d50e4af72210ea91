"""Figures and tables of a mission: images, and the finding unrolled and in 3-D."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import MissingExtraError
from minorloop.head.geometry import wall_distance, wrapped
from minorloop.head.procedures.sweep_map import SHADES, SOURCES, water_angles
from minorloop.head.reconstruction.depth_map import ECHOES, DepthMap
from minorloop.head.reconstruction.findings import PLACE_SD, Finding, save_findings
from minorloop.head.reconstruction.mesh import save_mesh
from minorloop.head.studies.mission import Mission
from minorloop.head.studies.mission_cracks import SeenCrack
from minorloop.head.studies.mission_scene import RADIUS
from minorloop.identification.bands import PER_DEVIATION
from minorloop.report import Table
from minorloop.studies.drawing import new_figure

_CROP = 60
"""Half the side of a drawn close-up in pixels, by trial."""
_AROUND = 25.0  # pixels
_NARROW = 0.55  # of its length is the width of a map that has two ticks across
_EVEN = 1e-6  # mm, between the least and the most of a map of one colour
_MOST_FACES = 160  # along a side of a surface
_FINE = 60  # texels a side, from which on their edges are not drawn


def save_mission(mission: Mission, folder: Path) -> list[Path]:
    """Write findings as a table and, with trimesh, the wall about each as PLY and glTF.

    Parameters
    ----------
    mission : Mission
        Nothing is written if it has no findings.
    folder : path
        Existing folder.
    """
    if not mission.findings:
        return []
    written = [save_findings(mission.findings, folder / "findings.csv")]
    walls = {} if mission.wall is None else {"finding": mission.wall}
    many = len(mission.cracks) > 1
    for number, crack in enumerate(mission.cracks, start=1):
        walls[f"crack{number}" if many else "crack"] = crack.wall
    with suppress(MissingExtraError):
        for name, wall in walls.items():
            written += [save_mesh(wall, folder / f"{name}.{kind}") for kind in ("ply", "glb")]
    return written


def draw_images(mission: Mission) -> Any:
    """Draw the picked point as first seen, close up, and with the axis sent to it."""
    figure, axes = new_figure(1, 3, height=3.0)
    pictures = (
        (mission.first, mission.pixel, "picked", None),
        (mission.first, mission.pixel, "picked, close up", _CROP),
        (mission.centred, None, "the axis sent to it", _CROP),
    )
    for one, (image, pixel, title, crop) in zip(axes, pictures, strict=True):
        one.grid(False)
        one.set(xticks=[], yticks=[], title=title)
        if image is None:
            continue
        one.imshow(image, cmap="gray", vmin=0, vmax=255)
        x, y = np.array(image.shape[::-1]) / 2 if pixel is None else pixel
        one.plot(x, y, "s", ms=18 if crop is None else 60, mec="C1", mfc="none", mew=1.4)
        if crop is not None:
            one.set(xlim=(x - crop, x + crop), ylim=(y + crop, y - crop))
            one.set_xlabel(f"{2 * crop} px of {image.shape[1]} across")
    return figure


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


def draw_ring(mission: Mission) -> Any:
    """Draw the unrolled pipe: the source of each part, the water line, and the profile."""
    from matplotlib.colors import ListedColormap

    figure, (top, low) = new_figure(2, 1, height=4.6)
    ring, water = mission.ring, mission.water
    if ring is None or water is None:
        return figure
    patch = ring.patch
    extent = (-180.0, 180.0, 1e3 * patch.z, 1e3 * (patch.z + patch.rows * patch.step))
    top.grid(False)
    shown = top.imshow(
        ring.source, origin="lower", extent=extent, aspect="auto", cmap=ListedColormap(SHADES),
        vmin=-0.5, vmax=3.5, interpolation="nearest",
    )  # fmt: skip
    bar = figure.colorbar(shown, ax=top, ticks=range(4))
    bar.ax.set_yticklabels(SOURCES)
    top.set(title=f"seen by; {ring.unseen:.1%} unseen", ylabel="along the pipe [mm]")
    low.grid(False)
    measured = np.isfinite(ring.depth) & (ring.source & ECHOES > 0)
    depth = 1e3 * np.where(measured, ring.depth, np.nan)
    shown = low.imshow(depth, origin="lower", extent=extent, aspect="auto", cmap="viridis")
    figure.colorbar(shown, ax=low, label="depth [mm]")
    low.set(
        title="depth under the wall by echoes; blank without an echo",
        xlabel="around the pipe [degrees]",
        ylabel="along the pipe [mm]",
    )
    for axes in (top, low):
        for phi in water_angles(water.height, patch.radius):
            axes.axvline(phi, color="C3", lw=1.2, ls="--")
        if mission.pit is not None:
            place = np.degrees(wrapped(mission.pit.phi)), 1e3 * mission.pit.z
            axes.plot(*place, "o", ms=11, mec="C1", mfc="none", mew=1.4)
        for crack in mission.cracks:
            phi, z = crack.course.places.T
            _course(axes, np.degrees(wrapped(phi)), 1e3 * z)
    return figure


def draw_crack(crack: SeenCrack) -> Any:
    """Draw the near view of a crack, its course over it, and its width along it."""
    figure, (bare, traced, wide) = new_figure(1, 3, height=3.0)
    image, course = crack.photo.image, crack.photo.pixels(crack.traced.places)
    widest = crack.photo.pixels(crack.widest)
    middle = 0.5 * (course.min(axis=0) + course.max(axis=0))
    half = 0.5 * float(np.ptp(course, axis=0).max()) + _AROUND
    for axes, title in ((bare, "seen from nearer"), (traced, "as it was traced")):
        axes.grid(False)
        axes.imshow(image, cmap="gray", vmin=0, vmax=255)
        axes.set(xticks=[], yticks=[], title=title)
        axes.set(xlim=(middle[0] - half, middle[0] + half))
        axes.set(ylim=(middle[1] + half, middle[1] - half))
        axes.set_xlabel(f"{2 * half:.0f} px of {image.shape[1]} across")
    traced.plot(*course.T, color="C1", lw=0.9)
    traced.plot(*widest, "o", ms=11, mec="C0", mfc="none", mew=1.4)
    along = np.linspace(0.0, 1e3 * crack.traced.length, len(crack.traced.widths))
    wide.plot(along, 1e3 * crack.traced.widths, color="C1")
    near = int(np.argmin(np.linalg.norm(course - widest, axis=1)))
    wide.plot(along[near], 1e3 * crack.width, "o", ms=11, mec="C0", mfc="none", mew=1.4)
    wide.set(xlabel="along the crack [mm]", ylabel="width [mm]", title="scanned at the circle")
    wide.set_ylim(0.0, 1.3e3 * float(crack.traced.widths.max()))
    return figure


def _course(axes: Any, phi: FloatArray, z: FloatArray) -> None:
    """Draw a course on the unrolled wall, broken where it crosses the edge."""
    broken = np.flatnonzero(np.abs(np.diff(phi)) > 180.0) + 1
    axes.plot(np.insert(phi, broken, np.nan), np.insert(z, broken, np.nan), color="C1", lw=1.0)


def draw_depths(runs: Sequence[Mapping[str, Any]]) -> Any:
    """Draw measured minus true depth of every pit, with its 90 % band."""
    figure, (left, right) = new_figure(1, 2, height=3.4)
    for axes, kinds, title in (
        (left, ("pit", "fused"), "through the lens"),
        (right, ("unfocused",), "unfocused disc"),
    ):
        each = [one for run in runs for kind in kinds for one in run["scored"][kind]]
        known = [one for one in each if one.found.measured]
        depth = [1e3 * one.site.depth for one in known]
        error = [1e6 * (one.found.depth - one.site.depth) for one in known]
        band = [1e6 * PER_DEVIATION * one.found.depth_sd for one in known]
        if known:
            axes.errorbar(depth, error, yerr=band, fmt="o", ms=3, lw=0.8, capsize=1.5)
        axes.axhline(0.0, color="0.3", lw=0.8)
        axes.set(
            title=f"{title}: {len(known)} of {len(each)} measured",
            xlabel="true depth [mm]",
            ylabel="measured less true [um], 90 % band",
        )
    return figure


def place_words(mission: Mission) -> str:
    """Return a sentence on how far the picked place is from that of the pit, and why."""
    if mission.picked is None or mission.pit is None:
        return ""
    off = wall_distance(mission.picked, (mission.pit.phi, mission.pit.z), RADIUS)
    return (
        f"The step pick gives a place that is {1e3 * float(off):.2f} mm from this one: it is the "
        "outline in the first view, from afar and oblique, by the angles of the joints alone, with "
        f"a standard deviation of {1e3 * PLACE_SD:.3f} mm around and along the pipe, and this one "
        "is the joint fit to the echoes, about the outline in the near view; both count from the "
        "same zero."
    )


def finding_rows(finding: Finding) -> Table:
    """Return a table of a finding with the 90 % band of each value."""
    rows = []
    for name, what, scale, unit in (
        ("phi", "angle", 180 / np.pi, "deg"),
        ("z", "axial position", 1e3, "mm"),
        ("width", "width", 1e3, "mm"),
        ("length", "length", 1e3, "mm"),
        ("depth", "depth", 1e3, "mm"),
    ):
        value, sd = getattr(finding, name), getattr(finding, f"{name}_sd")
        known = np.isfinite(value)
        rows.append(
            (
                what,
                f"{scale * value:.3f} {unit}" if known else "not known",
                f"+- {scale * PER_DEVIATION * sd:.3f} {unit}" if known and np.isfinite(sd) else "-",
            )
        )
    return Table((f"{finding.kind}: {finding.verdict}", "found", "90 % band"), rows)
