"""Views of a piece of wall, and how far the head has turned since one of them was taken.

A view is cut into three by three tiles. When the head turns, all of them move as geometry predicts
from two angles. Each tile votes for the shifts at which it matches, so that a reflection that
moves with the lights, or one of several equal spots, is outvoted by the tiles around it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop_head.vision import _track_kernels as kernels
from minorloop_head.vision.calibrated_camera import CalibratedCamera, Image, Window, unroll
from minorloop_head.vision.imaging import Image32

SIDE = 3
"""Tiles along a side of a view."""
_NUDGE = 1e-3
"""Turn in radians by which the motion of a tile is predicted, a hundredth of a tile."""
_NEAR = 4
"""Cells about a peak that belong to it."""
_LEAST_SEEN = 0.8
"""Share of a tile that a view has to show; the rest is beyond the frame or saturated."""
_STEP = 2
"""Cells beside a peak at which it is told from a ridge."""
_LEAST_SHOWN = 1.0
"""Sum of the squares of what eight tiles repeat, from which they tell a wall: one good tile."""
_LEAST_WEIGHT = 0.02
"""Lead of the best match of a tile over its second best that is assumed at least: tiles that are
alike still vote together."""


@dataclass(frozen=True, eq=False)
class View:
    """The wall about a place, unrolled, as its details: see the kernel ``detail``."""

    lens_at: FloatArray
    """Shape (3,). Place of the lens in the pipe, in metres."""
    fine: Image32
    coarse: Image32
    """At full and at half resolution."""
    repeats: FloatArray
    """Shape (tiles,). Correlation of each tile with the same piece of wall in another picture, as
    far as noise leaves it: near 0 where the wall shows no detail."""


@dataclass(frozen=True, eq=False)
class Agreement:
    """The shift of the middle tile that most tiles agree on."""

    shift: FloatArray
    """Shape (2,). Around and along the wall, in metres."""
    score: float
    """Weighted mean of the correlations there, up to 1."""
    other: float
    """The same of the best other shift."""
    seen: float = 0.0
    """Share of the tiles that are seen there."""
    drop: float = 0.0
    """By how much of the score it falls at 0.2 mm, in the direction in which it falls least: little
    along brush marks, where nothing tells one place from the next."""
    around: float = math.nan
    """Correlation of the tiles around the middle one there, as a share of what they repeat; NaN if
    they show too little detail."""


def halves(image: Image) -> tuple[Image, Image]:
    """Return two pictures, each of every other pixel and the means of their neighbours between.

    Their noise is independent, and they show the same wall.
    """
    padded = np.pad(image, 1, mode="edge").astype(np.uint16)
    beside = padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:]
    between = ((beside + 2) // 4).astype(np.uint8)
    odd = np.add.outer(np.arange(image.shape[0]), np.arange(image.shape[1])) % 2 == 1
    return np.where(odd, between, image), np.where(odd, image, between)


def repeated(one: Image32, other: Image32) -> FloatArray:
    """Return the correlation (tiles,) that two pictures of a view have, from those of two halves.

    Parameters
    ----------
    one, other : arrays of float32
        The view in each of the `halves` of a picture, at half resolution.

    Notes
    -----
    Noise of the whole picture has half of the variance: Spearman, 1910; Brown, 1910.
    """
    found = np.zeros(SIDE * SIDE)
    for k, corner in enumerate(_corners(one)):
        a, b = (filled(part[corner]) for part in (one, other))
        if a is not None and b is not None and a.std() > 0 and b.std() > 0:
            alike = max(float(np.corrcoef(a.ravel(), b.ravel())[0, 1]), 0.0)
            found[k] = 2 * alike / (1 + alike)
    return found


def _corners(coarse: Image32) -> list[tuple[slice, slice]]:
    """Return rows and columns of each tile."""
    n = coarse.shape[0] // SIDE
    ends = [slice(n * k, n * (k + 1)) for k in range(SIDE)]
    return [(ends[k // SIDE], ends[k % SIDE]) for k in range(SIDE * SIDE)]


def unrolled(
    image: Image,
    camera: CalibratedCamera,
    place: FloatArray,
    angles: FloatArray,
    size: float,
    texel: float,
    smooth: float,
) -> Image32:
    """Return the details of the wall in a square about a place.

    Parameters
    ----------
    image : (height, width) array of uint8
    camera : CalibratedCamera
    place : (2,) array
        Phi and z.
    angles : (2,) array
        Pan and tilt in radians.
    size, texel : float
        Side of the square and of a texel, in metres; an even number of texels is returned.
    smooth : float
        Side of the box whose mean is subtracted, in metres.
    """
    count = 2 * max(round(size / texel / 2), 1)
    half = (count - 1) / 2 * texel
    phi, z = float(place[0]) - half / camera.radius, float(place[1]) - half
    window = Window(phi, z, texel, count, count)
    flat = unroll(image, camera, window, float(angles[0]), float(angles[1]))
    found = np.empty_like(flat)
    kernels.detail(flat, max(round(smooth / texel / 2), 1), found)
    return found


def filled(tile: Image32) -> Image32 | None:
    """Return a tile with unseen texels at the mean; None if too few are seen."""
    if np.isfinite(tile).mean() < _LEAST_SEEN:
        return None
    return np.ascontiguousarray(np.nan_to_num(tile, nan=0.0))


def scores_of(area: Image32, template: Image32) -> FloatArray:
    """Return the correlation of a template with each place of an area; -1 where it is unknown."""
    shape = np.maximum(np.array(area.shape) - template.shape + 1, 1)
    scores = np.full(tuple(shape), -1.0)
    if area.shape[0] >= template.shape[0] and area.shape[1] >= template.shape[1]:
        kernels.correlate(area, template, scores)
    return scores


def best_of(scores: FloatArray) -> FloatArray:
    """Return column, row and height (3,) of the highest score."""
    found = np.empty(3)
    kernels.peak(scores, found)
    return found


def agree(view: View, area: Image32, ways: FloatArray, cell: float) -> Agreement:
    """Return the shift at which the tiles of a view are found together in an area.

    Parameters
    ----------
    view : View
    area : array of float32
        At half resolution, about the expected place, larger than the view.
    ways : (tiles, 2, 2) array
        From `tile_motions`.
    cell : float
        Side of a texel of the area, in metres.
    """
    side = view.coarse.shape[0] // SIDE
    margin = area.shape[0] - view.coarse.shape[0]
    maps = np.full((SIDE * SIDE, margin + 1, margin + 1), -1.0)
    weights = np.zeros(len(maps))
    for k in range(len(maps)):
        i, j = side * (k // SIDE), side * (k % SIDE)
        tile = filled(view.coarse[i : i + side, j : j + side])
        if tile is not None:
            part = area[i : i + side + margin, j : j + side + margin]
            kernels.correlate(np.ascontiguousarray(part), tile, maps[k])
            weights[k] = _weight(maps[k])
    votes = np.empty(maps.shape[1:])
    if not weights.sum() > 0:
        return Agreement(np.zeros(2), -1.0, -1.0)
    kernels.vote(maps, ways, weights, votes)
    best = best_of(votes)
    shift = (best[:2] - margin / 2) * cell
    i, j = (np.clip(round(k), 0, margin) for k in (best[1], best[0]))
    seen = float(np.mean(maps[:, i, j] > -1.0))
    other = float(kernels.second(votes, best, _NEAR))
    drop = drop_of(votes, best, _STEP)
    return Agreement(shift, float(best[2]), other, seen, drop, _around(view, maps, ways, i, j))


def _around(view: View, maps: FloatArray, ways: FloatArray, i: int, j: int) -> float:
    """Return how the tiles around the middle one agree at a shift, see `Agreement`."""
    repeats = view.repeats.copy()
    repeats[SIDE * SIDE // 2] = 0.0
    shown = float(repeats @ repeats)
    if shown < _LEAST_SHOWN:
        return math.nan
    votes = np.empty(maps.shape[1:])
    kernels.vote(maps, ways, repeats, votes)
    return float(votes[i, j] * repeats.sum() / shown) if votes[i, j] > -1.0 else math.nan


def tile_motions(
    camera: CalibratedCamera, place: FloatArray, angles: FloatArray, tile: float
) -> FloatArray:
    """Return how each tile about a place shifts where the middle one shifts by 1, (tiles, 2, 2).

    Parameters
    ----------
    camera : CalibratedCamera
    place, angles : (2,) array
        Of the middle tile, and of the head.
    tile : float
        Side of a tile, in metres.
    """
    steps = (np.arange(SIDE * SIDE) % SIDE - SIDE // 2, np.arange(SIDE * SIDE) // SIDE - SIDE // 2)
    metres = np.array([camera.radius, 1.0])
    places = place + tile * np.stack(steps, axis=-1) / metres
    columns = []
    for turn in _NUDGE * np.eye(2):
        after = camera.shifted(places, angles, angles + turn)
        columns.append((after - places) * metres / _NUDGE)
    motions = np.stack(columns, axis=-1)
    middle = motions[SIDE * SIDE // 2]
    if not np.isfinite(middle).all() or abs(np.linalg.det(middle)) < 1e-12:
        return np.tile(np.eye(2), (SIDE * SIDE, 1, 1))
    ways = motions @ np.linalg.inv(middle)
    return np.where(np.isfinite(ways), ways, np.eye(2))


def drop_of(votes: FloatArray, best: FloatArray, step: int) -> float:
    """Return the least share by which votes fall on both sides of their peak, some cells away."""
    i, j, n = round(best[1]), round(best[0]), votes.shape[0]
    drops = []
    for di, dj in ((0, step), (step, 0), (step, step), (step, -step)):
        ends = [(i + s * di, j + s * dj) for s in (-1, 1)]
        beside = [votes[p, q] for p, q in ends if 0 <= p < n and 0 <= q < n]
        drops.append(1.0 - max(beside, default=best[2]) / best[2] if best[2] > 0 else 0.0)
    return float(min(drops))


def _weight(scores: FloatArray) -> float:
    """Return how much a tile says: the height of its best match and its lead over others."""
    best = best_of(scores)
    lead = best[2] - kernels.second(scores, best, _NEAR)
    return float(max(best[2], 0.0) * max(lead, _LEAST_WEIGHT))


def farness(one: npt.ArrayLike, other: npt.ArrayLike, wall: npt.ArrayLike) -> float:
    """Return how differently two places of the lens see a point of the wall, 0 if alike.

    It is the angle between the two lines of sight in radians and the logarithm of the ratio of
    their lengths, added as squares.
    """
    a, b = np.asarray(one) - np.asarray(wall), np.asarray(other) - np.asarray(wall)
    near, far = np.linalg.norm(a), np.linalg.norm(b)
    cosine = float(np.clip(a @ b / (near * far), -1.0, 1.0))
    return float(np.hypot(np.arccos(cosine), np.log(far / near)))
