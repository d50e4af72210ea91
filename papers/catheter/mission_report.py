"""Figures and tables of a mission: images, and the finding unrolled and in 3-D."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.identification.bands import PER_DEVIATION
from minorloop.report import Table
from minorloop_head.geometry import wall_distance, wrapped
from minorloop_head.procedures.sweep_map import SHADES, SOURCES, water_angles
from minorloop_head.reconstruction.depth_map import ECHOES
from minorloop_head.reconstruction.findings import PLACE_SD, Finding, save_findings
from minorloop_head.reconstruction.mesh import save_mesh
from papers.catheter.mission import Mission
from papers.catheter.mission_cracks import SeenCrack
from papers.catheter.mission_scene import RADIUS
from papers.drawing import new_figure

_CROP = 60
"""Half the side of a drawn close-up in pixels, by trial."""
_AROUND = 25.0  # pixels


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
    for name, wall in walls.items():
        written += [save_mesh(wall, folder / f"{name}.{kind}") for kind in ("ply", "glb")]
    return written


def draw_images(mission: Mission) -> Any:
    """Draw the picked point as first seen, close up, and with the axis sent to it; None of none."""
    if mission.first is None:
        return None
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
