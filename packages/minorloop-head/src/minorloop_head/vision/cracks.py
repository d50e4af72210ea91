"""Trace cracks: thin lines on the wall, dark or bright, that no scratch or rim explains.

Heights of lines, averaged over all lights, mark the pieces. A threshold with hysteresis keeps
pieces that contain a strong part, and short gaps are bridged. The course of a piece is the cheapest
path between its ends, where the cost is low on a line; a part beside the path is a branch.
The profiles across a course decide whether it is a crack.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage, sparse
from scipy.sparse import csgraph
from scipy.spatial.distance import cdist

from minorloop.arrays import BoolArray, FloatArray, as_finite
from minorloop.errors import ParameterError, SignalError
from minorloop_head.vision.calibrated_camera import Image, Window
from minorloop_head.vision.crack_evidence import (
    FEATURES,
    LEAST_EVIDENCE,
    PLATE_WEIGHTS,
    CrackOdds,
    Profiles,
    crack_odds,
    features_of,
    likely_parts,
    profiles_of,
)
from minorloop_head.vision.crack_lines import line_heights
from minorloop_head.vision.crack_links import FEWEST, cut_at_crossings, followed, joined
from minorloop_head.vision.imaging import Image32, shrunk
from minorloop_head.vision.reflectance_map import STEP

_HIGH, _LOW, _LEAST = 3.5, 2.2, (0.02, 0.01)
"""Height that a piece reaches, and height above which it stays, in multiples of the median height
of the map; and its least values, for the maps of the lights and for their differences: walls differ
by a factor of five in their texture. By trial."""
_EDGE = 4
"""Width in texels of the edge of the known wall, where a line has no second side."""
_SHORTEST = 0.8e-3
"""Least length of a branch in metres: shorter ones are also corners of a wide crack."""
_BRANCHES = 3
"""Number of searches for branches."""
_APART = 5
"""Texels from a course within which lines belong to it."""
_SLENDER = 6.0
"""Least length over width."""
_GROUND, _TAKEN = 6e-6, 0.1
"""Standard deviations of a width: from the brightness of the wall beside the line, in metres, an
eighth of a texel; and as a share of the width, from light that a crack reflects, errors of the
pose, and blur beyond the profile. By trial on 160 scenes with a crack."""
_PART = 0.4e-3
"""Length in metres of parts of a course whose widths are independent."""


@dataclass(frozen=True, eq=False)
class TracedCrack:
    """The course of a crack."""

    places: FloatArray
    """Shape (N, 2). Phi and z along it."""
    widths: FloatArray
    """Shape (N,). In metres."""
    length: float
    """In metres, along the wall."""
    contrast: float
    """Median height of its line, in the logarithm of the image."""
    evidence: float = np.inf
    """Logarithm of the odds that it is a crack, among lines on the wall."""
    unsure: float = 0.0
    """Standard deviation in metres common to all widths, from the unknown light of its flanks."""
    breadth: float = np.nan
    """Area over depth of the profile across it, the median along it, in metres."""

    @property
    def middle(self) -> FloatArray:
        """Phi and z (2,) of the middle one of its places."""
        return np.asarray(self.places[len(self.places) // 2])

    @property
    def width(self) -> float:
        """Median width in metres."""
        return float(np.median(self.widths))

    @property
    def width_sd(self) -> float:
        """Standard deviation of the median width in metres."""
        spread = 1.4826 * float(np.median(np.abs(self.widths - self.width)))
        along = spread / math.sqrt(max(self.length / _PART, 1.0))
        return math.hypot(_GROUND, _TAKEN * self.width, along, self.unsure)


def trace_cracks(
    stack: Image32,
    window: Window,
    radius: float,
    *,
    least: float = LEAST_EVIDENCE,
    shortest: float = 1.5e-3,
    apart: Sequence[tuple[float, float, float]] = (),
    odds: CrackOdds | None = None,
) -> tuple[TracedCrack, ...]:
    """Trace the cracks on a map of the wall, longest first.

    Raises a `SignalError` if map and window differ in shape; a `ParameterError` if the radius is
    not positive.

    Parameters
    ----------
    stack : (rows, columns) or (K, rows, columns) array of float32
        Logarithm of the reflectance, under each of K lights, such as ``ReflectanceMap.stack``. NaN
        where the wall is not seen.
    window : Window
        The texels of the map.
    radius : float
        Of the pipe, in metres.
    least : float
        Least evidence.
    shortest : float
        Least length in metres.
    apart : sequence of (phi, z, diameter)
        Holes, whose rims are left out.
    odds : CrackOdds, optional
        Of lines; those of the wall of a pipe if not given.
    """
    levels = np.asarray(stack, dtype=np.float32)
    levels = levels[None] if levels.ndim == 2 else levels
    if levels.shape[1:] != (window.rows, window.columns):
        raise SignalError(
            f"a map of shape {np.shape(stack)} for a window of {window.rows} rows and "
            f"{window.columns} columns; give the map of that window"
        )
    if not as_finite("radius of the pipe", radius) > 0:
        raise ParameterError(f"a pipe of radius {radius} m; give a length > 0 in m")
    found = [
        crack
        for crack in traced_lines(lined_wall(levels, window, radius, apart), window, radius, odds)
        if crack.length >= shortest and crack.evidence >= least
    ]
    return tuple(sorted(found, key=lambda crack: -crack.length))


PLATE_RADIUS = 1.0
"""Radius of the pipe as which a plate is searched, in metres: a picture of 0.05 mm a pixel is flat
on it."""
_PLATE_LEAST, _PLATE_SHORTEST, _PLATE_FINEST = 1.5, 30, 300
"""Least evidence and length in pixels of a crack in a plate, and fewest pixels along the shorter
side of a picture of half the size that is searched too, for cracks too wide for the filter."""
_BREADTH = FEATURES.index("breadth")
_FLOOR = 4.0
"""Grey level added before the logarithm, so that noise in the dark stays small."""


def plate_levels(image: Image | Image32) -> tuple[Image32, Window]:
    """Return the logarithm (1, rows, columns) of a picture, and its window of 0.05 mm a pixel."""
    levels = np.log(np.asarray(image, dtype=np.float32) + np.float32(_FLOOR))
    return levels[None], Window(0.0, 0.0, STEP, *levels.shape)


@dataclass(frozen=True, eq=False)
class PlateCrack:
    """A crack in a picture of a plate."""

    course: FloatArray
    """Shape (N, 2). Columns and rows along it."""
    width: float
    """Median, in pixels."""
    evidence: float
    """Logarithm of the odds that it is a crack, among lines on the plate."""
    scale: int
    """Pixels to a side of a texel of the map on which it was found."""


def plate_cracks(image: Image) -> list[PlateCrack]:
    """Trace dark cracks in a picture of a plate in unknown light, those of most evidence first.

    ``image`` (height, width): grey levels.
    """
    found: list[PlateCrack] = []
    level, scale = np.asarray(image, dtype=np.float32), 1
    while scale == 1 or min(level.shape) >= _PLATE_FINEST:
        stack, window = plate_levels(level)
        for crack in trace_cracks(
            stack,
            window,
            PLATE_RADIUS,
            least=_PLATE_LEAST,
            shortest=_PLATE_SHORTEST * window.step,
            odds=crack_odds(PLATE_WEIGHTS),
        ):
            course = scale * (window.texels(crack.places, PLATE_RADIUS) + 0.5) - 0.5
            # The grey level of its ground is not known, which `width` assumes to be dark
            width = scale * crack.breadth / window.step
            found.append(PlateCrack(course, width, crack.evidence, scale))
        level, scale = shrunk(level), 2 * scale
    kept: list[PlateCrack] = []
    for one in sorted(found, key=lambda each: -each.evidence):
        near = [
            cdist(one.course, other.course).min(axis=1) < _APART * max(one.scale, other.scale)
            for other in kept
        ]
        if not near or np.mean(np.any(near, axis=0)) < 0.5:
            kept.append(one)
    return kept


def traced_lines(
    wall: LinedWall | None, window: Window, radius: float, odds: CrackOdds | None = None
) -> list[TracedCrack]:
    """Return all lines with parts that look like a crack."""
    if wall is None:
        return []
    odds = odds or crack_odds()
    parts = []
    for course in wall.courses:
        line = profiles_of(course, wall.levels)
        parts += likely_parts(line, odds.along(features_of(line, wall.texture)))
    lines = [profiles_of(course, wall.levels) for course in whole_courses(parts, wall)]
    found = [_measured(line, wall, window, radius, odds) for line in lines]
    return [crack for crack in found if crack is not None]


@dataclass(frozen=True, eq=False)
class LinedWall:
    """Lines of a wall before they are judged."""

    levels: Image32
    """Shape (K, rows, columns). Logarithm of the reflectance; an unknown texel has the value of the
    nearest known one."""
    heights: Image32
    """Shape (rows, columns). Heights of the lines."""
    seen: BoolArray
    """Shape (rows, columns). Texels that are seen."""
    margin: BoolArray
    """Shape (rows, columns). Texels that are seen but too near to the edge for a height."""
    courses: tuple[FloatArray, ...]
    """Rows and columns of the lines."""
    texture: float
    """Median of the heights."""


def lined_wall(
    levels: Image32, window: Window, radius: float, apart: Sequence[tuple[float, float, float]] = ()
) -> LinedWall | None:
    """Return the lines on maps (K, rows, columns); None if nearly nothing is seen."""
    seen = np.asarray(np.isfinite(levels).all(axis=0))
    if seen.sum() < 100:
        return None
    # A profile beyond the map continues with the last brightness of the wall.
    _, near = ndimage.distance_transform_edt(~seen, return_indices=True)
    each, middles = line_heights(levels, seen)
    margin = seen & ~ndimage.binary_erosion(seen, iterations=_EDGE)
    each[:, ~seen | margin] = 0
    medians = np.median(each[:, seen & ~margin], axis=1)
    textures = np.maximum(medians, _LEAST[: len(each)])
    # A line counts by the kind of map in which it stands out most from the texture.
    shares = each / textures[:, None, None]
    texture, heights = float(textures[0]), textures[0] * shares.max(axis=0)
    middle = np.take_along_axis(middles, shares.argmax(axis=0)[None], axis=0)[0]
    _mask_out(heights, window, radius, apart)
    heights = np.where(ndimage.binary_dilation(middle, np.ones((3, 3), dtype=bool)), heights, 0)
    least = _SHORTEST / window.step
    courses = [course.astype(float) for course in _courses(heights, texture, least)]
    return LinedWall(
        levels[:, near[0], near[1]], heights, seen, margin, tuple(cut_at_crossings(courses)),
        texture,
    )  # fmt: skip


def whole_courses(parts: Sequence[FloatArray], wall: LinedWall) -> list[FloatArray]:
    """Return courses (N, 2) of parts joined where they continue each other, to their tips."""
    whole = joined([part for part in parts if len(part) >= FEWEST])
    return joined(followed(whole, wall.heights, _LOW * wall.texture, wall.seen, wall.margin))


def _courses(heights: Image32, texture: float, least: float) -> list[npt.NDArray[np.int64]]:
    """Return the courses (N, 2) of all pieces and of their branches, in rows and columns."""
    courses = []
    left = heights.copy()
    for _ in range(_BRANCHES + 1):
        found = [_course(left, piece) for piece in _pieces(left, texture, least)]
        found = [course for course in found if len(course) >= FEWEST]
        if not found:
            break
        courses += found
        taken = np.zeros(heights.shape, dtype=bool)
        for course in found:
            taken[course[:, 0], course[:, 1]] = True
        left[ndimage.distance_transform_edt(~taken) <= _APART] = 0
    return courses


def _mask_out(
    heights: Image32, window: Window, radius: float, apart: Sequence[tuple[float, float, float]]
) -> None:
    rows, columns = np.indices(heights.shape)
    for phi, z, diameter in apart:
        x, y = window.texels((phi, z), radius)
        reach = 0.75 * diameter / window.step + 3
        heights[(columns - x) ** 2 + (rows - y) ** 2 < reach**2] = 0


def _pieces(
    heights: Image32, texture: float, least: float
) -> list[tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]]:
    """Return rows and columns of the texels of each piece, short gaps filled."""
    labels, _ = ndimage.label(heights > _LOW * texture, np.ones((3, 3)))
    pieces = []
    for n, box in enumerate(ndimage.find_objects(labels), start=1):
        inside = labels[box] == n
        reach = np.hypot(*inside.shape)
        if reach < least or (heights[box][inside] > _HIGH * texture).sum() < 0.5 * least:
            continue
        i, j = np.nonzero(inside)
        pieces.append((i + box[0].start, j + box[1].start))
    return pieces


def _course(
    heights: Image32, piece: tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]
) -> npt.NDArray[np.int64]:
    """Return rows and columns (N, 2) of the cheapest path between the ends farthest apart."""
    i, j = piece
    number = np.full((np.ptp(i) + 3, np.ptp(j) + 3), -1)
    y, x = i - i.min() + 1, j - j.min() + 1
    number[y, x] = np.arange(i.size)
    cost = 1.0 / (0.05 + np.maximum(heights[i, j], 0))
    starts, ends, prices, lengths = [], [], [], []
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        other = number[y + dy, x + dx]
        here = np.flatnonzero(other >= 0)
        starts.append(here)
        ends.append(other[here])
        prices.append(0.5 * (cost[here] + cost[other[here]]) * np.hypot(dy, dx))
        lengths.append(np.full(here.size, np.hypot(dy, dx)))
    pair = (np.concatenate(starts), np.concatenate(ends))
    size = (i.size, i.size)
    near: Any = sparse.csr_array((np.concatenate(lengths), pair), shape=size)
    cheap: Any = sparse.csr_array((np.concatenate(prices), pair), shape=size)
    first = int(np.argmax(_reached(near, int(np.argmax(heights[i, j])))))
    last = int(np.argmax(_reached(near, first)))
    _, ways = csgraph.dijkstra(cheap, directed=False, indices=[first], return_predecessors=True)
    before = ways[0]
    way = [last]
    while way[-1] != first and before[way[-1]] >= 0:
        way.append(int(before[way[-1]]))
    return np.stack([i[way], j[way]], axis=1)


def _reached(graph: Any, start: int) -> FloatArray:
    """Return the distance of each texel from the start; -1 where there is no path."""
    far: FloatArray = csgraph.dijkstra(graph, directed=False, indices=[start])[0]
    return np.where(np.isfinite(far), far, -1.0)


def _measured(
    line: Profiles, wall: LinedWall, window: Window, radius: float, odds: CrackOdds
) -> TracedCrack | None:
    """Measure length and widths of a line; None if it is not slender."""
    widths, deviations = (window.step * each for each in line.widths())
    length = line.length * window.step
    if length < max(_SLENDER * float(np.median(widths)), _SHORTEST):
        return None
    y, x = np.clip(np.rint(line.course).astype(int), 0, np.array(wall.heights.shape) - 1).T
    contrast = float(np.median(wall.heights[y, x]))
    places = window.place(line.course[:, 1], line.course[:, 0], radius)
    features = features_of(line, wall.texture)
    evidence = odds.of_line(line, odds.along(features))
    breadth = window.step * float(np.median(features[:, _BREADTH]))
    unsure = float(np.median(deviations))
    return TracedCrack(places, widths, length, contrast, evidence, unsure, breadth)
