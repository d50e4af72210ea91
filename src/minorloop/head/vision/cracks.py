"""Trace cracks: thin dark lines that stay dark whichever light is on.

A ridge filter on the unrolled wall marks thin dark lines. A threshold with hysteresis keeps lines
that contain a strong piece, and short gaps are bridged. The course of a piece is the cheapest path
between its ends, where the cost is low on a ridge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from minorloop.arrays import FloatArray, as_finite
from minorloop.errors import ParameterError, SignalError
from minorloop.head.geometry import wrapped
from minorloop.head.vision.calibrated_camera import Image32, Window

_SCALES = (1.5, 2.5)  # texels, half the width of a crack of 0.15 to 0.25 mm
_GAP = 4  # texels
_NORMAL = 14  # half texels to either side of a crack
_DARK = 0.93
"""Share of the light of the wall that a crack takes."""
_SLENDER = 6.0
"""Least length over width."""


@dataclass(frozen=True, eq=False)
class TracedCrack:
    """The course of a crack.

    Parameters
    ----------
    places : (N, 2) array
        Phi and z along it.
    widths : (N,) array
        In metres: the width of a black line that takes as much light.
    length : float
        In metres, along the wall.
    contrast : float
        Median height of its ridge, in the logarithm of the image.
    """

    places: FloatArray
    widths: FloatArray
    length: float
    contrast: float

    @property
    def width(self) -> float:
        """Median width in metres."""
        return float(np.median(self.widths))


def trace_cracks(
    brightest: Image32,
    window: Window,
    radius: float,
    *,
    high: float = 0.35,
    low: float = 0.15,
    least: float = 1.5e-3,
    apart: Sequence[tuple[float, float, float]] = (),
) -> tuple[TracedCrack, ...]:
    """Trace the cracks on a map of the wall, longest first.

    Parameters
    ----------
    brightest : (rows, columns) array of float32
        Logarithm of the reflectance under the light that makes it brightest, such as
        ``ReflectanceMap.brightest``; the flank of a scratch is bright under one light. NaN where
        the wall is not seen.
    window : Window
        The texels of the map.
    radius : float
        Of the pipe, in metres.
    high, low : float
        Thresholds of the height of a ridge: a piece reaches ``high`` and stays above ``low``.
    least : float
        Least length in metres.
    apart : sequence of (phi, z, diameter)
        Holes, whose rims are left out.

    Raises
    ------
    SignalError
        If map and window differ in shape.
    ParameterError
        If the radius is not positive.

    Notes
    -----
    The ridge is the larger eigenvalue of the second derivatives, normalised by scale (Lindeberg,
    Edge detection and ridge detection with automatic scale selection, 1998).
    """
    if np.shape(brightest) != (window.rows, window.columns):
        raise SignalError(
            f"a map of shape {np.shape(brightest)} for a window of {window.rows} rows and "
            f"{window.columns} columns; give the map of that window"
        )
    if not as_finite("radius of the pipe", radius) > 0:
        raise ParameterError(f"a pipe of radius {radius} m; give a length > 0 in m")
    seen = np.isfinite(brightest)
    if seen.sum() < 100:
        return ()
    level = np.where(seen, brightest, np.median(brightest[seen])).astype(np.float32)
    ridge = _ridge(level)
    ridge[~ndimage.binary_erosion(seen, iterations=6)] = 0
    _mask_out(ridge, window, radius, apart)
    found = []
    for piece in _pieces(ridge, high, low, least / window.step):
        course = _course(ridge, piece)
        crack = _measured(course, level, ridge, window, radius)
        if crack is not None and crack.length >= least:
            found.append(crack)
    return tuple(sorted(found, key=lambda crack: -crack.length))


def _ridge(level: Image32) -> Image32:
    """Return the height of thin dark lines."""
    best = np.zeros_like(level)
    for scale in _SCALES:
        xx, yy, xy = (
            scale**2 * ndimage.gaussian_filter(level, scale, order=order, truncate=3.0)
            for order in ((0, 2), (2, 0), (1, 1))
        )
        root = np.sqrt((0.5 * (xx - yy)) ** 2 + xy**2)
        strong, weak = 0.5 * (xx + yy) + root, 0.5 * (xx + yy) - root
        # A spot bends both ways, a line only across.
        best = np.maximum(best, strong - np.abs(weak))
    return best


def _mask_out(
    ridge: Image32, window: Window, radius: float, apart: Sequence[tuple[float, float, float]]
) -> None:
    rows, columns = np.indices(ridge.shape)
    for phi, z, diameter in apart:
        x = float(wrapped(phi - window.phi)) * radius / window.step
        y = (z - window.z) / window.step
        reach = 0.75 * diameter / window.step + 3
        ridge[(columns - x) ** 2 + (rows - y) ** 2 < reach**2] = 0


def _pieces(
    ridge: Image32, high: float, low: float, least: float
) -> list[tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]]:
    """Return rows and columns of the texels of each piece, short gaps filled."""
    weak = ridge > low
    bridged = ndimage.binary_closing(weak, _disc(_GAP // 2 + 1), iterations=1)
    labels, count = ndimage.label(bridged, np.ones((3, 3)))
    pieces = []
    for n, box in enumerate(ndimage.find_objects(labels), start=1):
        inside = labels[box] == n
        reach = np.hypot(*inside.shape)
        if count == 0 or reach < least or not (ridge[box][inside] > high).sum() >= 0.5 * least:
            continue
        i, j = np.nonzero(inside)
        pieces.append((i + box[0].start, j + box[1].start))
    return pieces


def _disc(radius: int) -> npt.NDArray[np.bool_]:
    i, j = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    return np.asarray(i * i + j * j <= radius * radius)


def _course(
    ridge: Image32, piece: tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]
) -> npt.NDArray[np.int64]:
    """Return rows and columns (N, 2) of the cheapest path between the ends farthest apart."""
    i, j = piece
    number = np.full((np.ptp(i) + 3, np.ptp(j) + 3), -1)
    y, x = i - i.min() + 1, j - j.min() + 1
    number[y, x] = np.arange(i.size)
    cost = 1.0 / (0.05 + np.maximum(ridge[i, j], 0))
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
    first = int(np.argmax(_reached(near, int(np.argmax(ridge[i, j])))))
    last = int(np.argmax(_reached(near, first)))
    _, ways = csgraph.dijkstra(cheap, directed=False, indices=[first], return_predecessors=True)
    before = ways[0]
    way = [last]
    while way[-1] != first and before[way[-1]] >= 0:
        way.append(int(before[way[-1]]))
    return np.stack([i[way], j[way]], axis=1)


def _reached(graph: Any, start: int) -> FloatArray:
    """Return the distance of each texel from one of them; -1 where there is no path."""
    far: FloatArray = csgraph.dijkstra(graph, directed=False, indices=[start])[0]
    return np.where(np.isfinite(far), far, -1.0)


def _measured(
    course: npt.NDArray[np.int64], level: Image32, ridge: Image32, window: Window, radius: float
) -> TracedCrack | None:
    """Measure length and widths along a course; None if it is not slender."""
    if len(course) < 8:
        return None
    smooth = ndimage.gaussian_filter1d(course.astype(np.float64), 2.5, axis=0, mode="nearest")
    steps = np.hypot(*np.diff(smooth, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    heading = np.gradient(smooth, axis=0)
    norm = np.maximum(np.hypot(heading[:, 0], heading[:, 1]), 1e-9)[:, None]
    normal = np.stack([-heading[:, 1], heading[:, 0]], axis=1) / norm
    off = np.arange(-_NORMAL, _NORMAL + 1) / 2
    lines = smooth[:, None, :] + off[None, :, None] * normal[:, None, :]
    across = ndimage.map_coordinates(level, np.moveaxis(lines, -1, 0), order=1, mode="nearest")
    ground = np.median(across[:, np.abs(off) > 5], axis=1)
    taken = 1 - np.exp(np.minimum(across - ground[:, None], 0))
    widths = ndimage.median_filter(taken.sum(axis=1) * 0.5 / _DARK, 5, mode="nearest")
    widths = widths * window.step
    contrast = float(np.median(ridge[course[:, 0], course[:, 1]]))
    length = float(along[-1] * window.step)
    if length < _SLENDER * float(np.median(widths)):
        return None
    places = window.place(smooth[:, 1], smooth[:, 0], radius)
    return TracedCrack(places, widths, length, contrast)
