"""Map of the inspected wall, merged from all pictures, and its searched and scanned shares."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import ndimage

from minorloop.arrays import BoolArray, FloatArray
from minorloop.drawing.layout import new_figure
from minorloop_head.geometry import wrapped
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.inspected_view import InspectedView, Unconfirmed
from minorloop_head.procedures.pictures import LEAST_GREY
from minorloop_head.procedures.probe_steps import fused_wall, resampled
from minorloop_head.procedures.scan import ScannedRaster
from minorloop_head.procedures.sweep_map import CONTRAST, water_angles
from minorloop_head.procedures.trace import patch_about, widest
from minorloop_head.reconstruction.depth_map import (
    ECHOES,
    STEP,
    DepthMap,
    Patch,
    WaterLine,
    paste,
    unseen_map,
)
from minorloop_head.reconstruction.fusion import PATCH
from minorloop_head.ultrasound.c_scan import CScan, c_scan
from minorloop_head.ultrasound.crack_depth import CrackDepth, crack_map
from minorloop_head.ultrasound.pits import PitDepth
from minorloop_head.ultrasound.spectra import usable_bursts
from minorloop_head.ultrasound.wall_echoes import SweptBurst
from minorloop_head.vision.calibrated_camera import unroll
from minorloop_head.vision.cracks import TracedCrack
from minorloop_head.vision.defects import SIZES, Hole
from minorloop_head.vision.frame_checks import GOOD
from minorloop_head.vision.imaging import Image32
from minorloop_head.vision.reflectance_map import LitFrame, ReflectanceMap, lay_flat

_EDGE = 0.6e-3
"""Width in metres of the border of a picture, in which a hole is cut off and not found."""
_AROUND = 3e-3
"""Side in metres of the square of wall whose mean grey level is the brightness of a place."""
_ACROSS = 9.0 / 320.0
"""Least minor axis of the smallest hole that is found, over the width of the picture."""
_SIDES = {180: "left", -90: "top", 0: "right", 90: "bottom"}
_MOST = 0.5
"""Least searched share of a column in the searched range; and of a row, over that of the row with
the largest searched share."""


@dataclass(frozen=True, eq=False)
class SeenWall:
    """Picture of the pipe, unrolled."""

    patch: Patch
    """Once round the pipe, from the nearest to the farthest place that a view shows."""
    picture: FloatArray
    """Shape (rows, columns). Logarithm of the reflectance; NaN where no view shows the wall."""
    searched: BoolArray
    """Shape (rows, columns). Where a view on the way round shows the smallest hole that the search
    finds whole, large and bright enough."""
    probed: BoolArray
    """Shape (rows, columns). Where echoes gave the depth."""

    @property
    def along(self) -> tuple[float, float]:
        """First and last place along the pipe that was searched, in metres.

        A row does not count if its searched share is less than half of the largest one.
        """
        shares = self.searched.mean(axis=1)
        rows = np.flatnonzero(shares >= _MOST * shares.max())
        return tuple((self.patch.z + self.patch.step * rows[[0, -1]]).tolist())

    @property
    def around(self) -> tuple[float, float]:
        """First and last angle in radians of the sector searched; a whole turn if all was."""
        columns = np.flatnonzero(self._part(self.searched).mean(axis=0) >= _MOST)
        turn = self.patch.step / self.patch.radius
        if not columns.size:
            return 0.0, 0.0
        phi = self.patch.phi + turn * columns
        gaps = np.diff(np.append(phi, phi[0] + 2 * np.pi))
        widest_gap = int(np.argmax(gaps))
        if gaps[widest_gap] < 2.5 * turn:
            return -np.pi, np.pi
        first = float(wrapped(np.append(phi, phi[0])[widest_gap + 1]))
        return first, first + 2 * np.pi - float(gaps[widest_gap])

    @property
    def searched_share(self) -> float:
        """Share of the wall in the range along the pipe that was searched."""
        return float(self._part(self.searched).mean())

    @property
    def probed_share(self) -> float:
        """Share of it of which echoes gave the depth."""
        return float(self._part(self.probed).mean())

    def _part(self, values: BoolArray) -> BoolArray:
        """Return the rows of the range along the pipe."""
        first, last = (round((z - self.patch.z) / self.patch.step) for z in self.along)
        return values[first : last + 1]


def seen_wall(
    views: Iterable[InspectedView], calibration: HeadCalibration, walls: Sequence[DepthMap] = ()
) -> SeenWall | None:
    """Return the merged pictures of an inspection; None if no picture can be used.

    ``calibration``: of the head; ``walls``: about the findings that were scanned.

    Notes
    -----
    Views under other lights differ by a constant, which is that of their medians.
    """
    known = [(view, _flat(view, calibration)) for view in views]
    flat = [(view, one) for view, one in known if one is not None]
    if not flat:
        return None
    ends = [(one.window.z, one.window.z + one.whole.shape[0] * one.window.step) for _, one in flat]
    low, high = (
        STEP * round(end / STEP)
        for end in (min(low for low, _ in ends), max(high for _, high in ends))
    )
    patch = Patch.ring(low, high + 0.5 * STEP, radius=calibration.radius)
    total, count = (np.zeros((patch.rows, patch.columns)) for _ in range(2))
    searched = count > 0
    for view, one in flat:
        whole = resampled(one, patch)
        seen = np.isfinite(whole)
        if seen.any():
            total[seen] += whole[seen] - np.median(whole[seen])
            count[seen] += 1
        if view.looks_round:
            searched |= resampled(replace(one, whole=_clear(view, one, calibration)), patch) > 0.5
    picture = np.divide(total, count, out=np.full_like(total, np.nan), where=count > 0)
    ring = unseen_map(patch)
    for wall in walls:
        ring = paste(ring, wall)
    return SeenWall(patch, picture, searched, (ring.source & ECHOES) > 0)


def _clear(view: InspectedView, flat: ReflectanceMap, calibration: HeadCalibration) -> Image32:
    """Return 1 where a view shows the smallest hole whole, large and bright enough, 0 elsewhere."""
    camera, step = calibration.camera_at(view.place), flat.window.step
    least = _ACROSS * camera.lens.width / SIZES[0]
    grey = unroll(view.image, camera, flat.window, *view.angles, least=least)
    large = np.isfinite(grey)
    light = ndimage.uniform_filter(np.where(large, grey, LEAST_GREY), size=round(_AROUND / step))
    edge = 2 * round(_EDGE / step) + 1
    whole = ndimage.minimum_filter(large, size=edge, mode="constant", cval=0)
    return np.asarray(whole & (light >= LEAST_GREY), dtype=np.float32)


def _flat(view: InspectedView, calibration: HeadCalibration) -> ReflectanceMap | None:
    """Return the picture of a view unrolled; None if it cannot be used."""
    if view.picture.verdict != GOOD:
        return None
    frame = LitFrame(view.image, *view.angles, (True,) * len(calibration.leds))
    return lay_flat([frame], calibration.camera_at(view.place))


def wall_of(
    view: InspectedView, scanned: ScannedRaster | None, calibration: HeadCalibration
) -> DepthMap | None:
    """Return the map of the wall about a finding; None if echoes gave no depth.

    ``view``: of its visit; ``scanned``: the scan that gave the depth.
    """
    probed = view.probed
    if scanned is None or probed is None or not np.isfinite(probed.depth):
        return None
    (shown,) = view.seen
    if isinstance(shown, Hole) and isinstance(probed, PitDepth):
        probe = calibration.probe_at(scanned.reference)
        return fused_wall(scanned, probe, probed, shown, _flat(view, calibration))
    if isinstance(shown, TracedCrack) and isinstance(probed, CrackDepth):
        where, width = widest(shown)
        patch = patch_about(shown.places, calibration.radius)
        return crack_map(shown.places, width, probed, tuple(where.tolist()), patch)
    return None


def c_scan_of(scanned: ScannedRaster, calibration: HeadCalibration) -> CScan | None:
    """Return the map of amplitude and depth of a scan; None if there is no usable echo."""
    bursts = usable_bursts(scanned.bursts)
    if not bursts:
        return None
    probe = calibration.probe_at(scanned.reference)
    spots = probe.spots(np.array([burst.angles for burst in bursts]))
    each = zip(spots, bursts, strict=True)
    swept = [SweptBurst(0.0, scanned.reference, spot, burst) for spot, burst in each]
    middle = spots[len(spots) // 2]
    phi = float(middle[0] + np.mean(wrapped(spots[:, 0] - middle[0])))
    z = float(spots[:, 1].mean())
    patch = Patch.around(phi, z, size=PATCH, radius=calibration.radius, step=0.5 * STEP)
    return c_scan(swept, probe, patch)


def draw_wall(
    seen: SeenWall,
    found: Sequence[InspectedView],
    lost: Sequence[Unconfirmed] = (),
    water: WaterLine | None = None,
) -> Any:
    """Draw the unrolled pipe with numbered findings, unconfirmed candidates, and the water line.

    ``found``: each with a finding, in the order of their numbers.
    """
    patch = seen.patch
    figure, axes = new_figure(1, 1, 4.4, grid=False)
    start = float(np.degrees(patch.phi))

    def drawn_at(phi: float) -> float:
        return float((phi - start) % 360.0 + start)

    extent = (start, start + 360.0, 1e3 * patch.z, 1e3 * (patch.z + patch.rows * patch.step))
    grey = np.clip(0.5 + seen.picture / (2 * CONTRAST), 0.0, 1.0)
    image = {"origin": "lower", "extent": extent, "aspect": "auto", "interpolation": "nearest"}
    axes.set_facecolor("#dfe6ee")
    axes.imshow(grey, cmap="gray", vmin=0.0, vmax=1.0, **image)
    blue = np.zeros((*seen.probed.shape, 4))
    blue[seen.probed] = (0.12, 0.47, 0.71, 0.45)
    axes.imshow(blue, **image)
    for number, view in enumerate(found, 1):
        assert view.finding is not None
        phi = drawn_at(np.degrees(view.finding.phi))
        z = 1e3 * view.finding.z
        if view.course is not None:
            course = np.degrees(view.course[:, 0])
            around = (course - np.degrees(view.finding.phi) + 180.0) % 360.0 - 180.0 + phi
            axes.plot(around, 1e3 * view.course[:, 1], color="C1", lw=1.2)
        axes.annotate(
            str(number), (phi, z), (10, 10), textcoords="offset points", fontsize=10, color="k",
            bbox={"fc": "w", "ec": "C1", "boxstyle": "circle,pad=0.2"},
        )  # fmt: skip
    for one in lost:
        axes.plot(drawn_at(np.degrees(one.phi)), 1e3 * one.z, "x", color="C3", ms=8, mew=1.6)
    if water is not None and water.seen:
        for phi in water_angles(water.height, patch.radius):
            axes.axvline(drawn_at(phi), color="C0", lw=1.2, ls="--")
    axes.set(xlabel="around the pipe [degrees]", ylabel="along the pipe [mm]")
    ticks = np.arange(-90.0, 271.0, 45.0)
    axes.set_xticks(ticks, [_angle_words(phi) for phi in ticks], fontsize=9)
    return figure


def _angle_words(phi: float) -> str:
    """Return an angle from -180 to 180 degrees, and the side of the pipe in words."""
    angle = round(180.0 - (180.0 - phi) % 360.0)
    return f"{angle}\n{_SIDES.get(angle, '')}"
