"""Maps of walls on which the odds of cracks are fitted: as seen, and with marks painted on them.

A map is what an acquisition of a drawn scene gives, with the true course of its crack. Painted
grooves have two flanks, each of its own brightness under each light; painted blobs are flat or
domed, with rims that answer to the light, as beads, deposits and soil have. They make many maps of
a few, and give the walls of one renderer what those of another have. No head uses this.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from minorloop.arrays import BoolArray, FloatArray
from minorloop_head.procedures.trace import between
from minorloop_head.vision.calibrated_camera import Window
from minorloop_head.vision.imaging import Image32
from papers.harness import Results

LIGHTS = 3
_FINE = 3
"""Subdivision of a texel where flanks are painted."""


@dataclass(frozen=True, eq=False)
class CrackMap:
    """A map of the wall with what is known of it."""

    kind: str
    """Who drew it."""
    seed: int
    stack: Image32
    """Shape (K, rows, columns). Logarithm of the reflectance; NaN where nothing is seen."""
    window: Window
    radius: float
    """Of the pipe, in metres."""
    holes: tuple[tuple[float, float, float], ...]
    """Phi, z and diameter of those that were found."""
    course: FloatArray
    """Shape (N, 2). Phi and z of all cracks."""
    search: Results
    """The acquisition, for scoring."""

    def off(self, course: FloatArray) -> FloatArray:
        """Return the distance (N,) in metres of a course (N, 2) in texels from the cracks."""
        if not len(self.course):
            return np.full(len(course), np.inf)
        places = self.window.place(course[:, 1], course[:, 0], self.radius)
        return between(places, self.course, self.radius).min(axis=1)

    def under_one_light(self) -> CrackMap:
        """Return the map under its first light alone, as other people's pictures are."""
        return replace(self, stack=self.stack[:1])


def seen_map(search: Results, kind: str, seed: int) -> CrackMap | None:
    """Return the map of an acquisition; None if there is none."""
    wall = search.findings.wall
    if wall is None:
        return None
    holes = tuple((*map(float, hole.place), hole.diameter) for hole in search.findings.holes)
    course = np.asarray(search.course).reshape(-1, 2)
    return CrackMap(
        kind, seed, wall.stack, wall.window, search.camera.radius, holes, course, search
    )


def rendered_maps(folder: Path, seeds: range) -> list[CrackMap]:
    """Return the maps of the judge's scenes with a crack that are in the folder."""
    from benchmarks.judge import scenes
    from benchmarks.judge.__main__ import rendered
    from benchmarks.judge.score import crack_searched

    found = (
        seen_map(crack_searched(scene, radiance), "path traced", scene.seed)
        for scene, radiance in rendered(seeds, folder, (scenes.CRACK,))
    )
    return [one for one in found if one is not None]


def painted(plain: CrackMap, grooves: int, blobs: int, key: int = 0) -> CrackMap:
    """Return a map with blobs and then grooves painted on it, drawn by the seed of the map."""
    rng = np.random.default_rng((plain.seed, key))
    seen = np.isfinite(plain.stack).all(axis=0)
    stack, courses = plain.stack.copy(), [plain.course]
    for _ in range(blobs):
        stack += _blob(rng, seen)
    for _ in range(grooves):
        course = _course(rng, seen)
        if course is not None:
            _paint_groove(stack, rng, course)
            courses.append(plain.window.place(course[:, 1], course[:, 0], plain.radius))
    return replace(plain, stack=stack, course=np.concatenate(courses))


def _course(rng: np.random.Generator, seen: BoolArray) -> FloatArray | None:
    """Return a wandering course (N, 2) of 40 to 300 texels, in rows and columns."""
    rows, columns = np.nonzero(ndimage.binary_erosion(seen, iterations=8))
    for _ in range(60 if len(rows) else 0):
        start = rng.integers(len(rows))
        place, bend = np.array([rows[start], columns[start]], dtype=float), 0.0
        heading, rough = rng.uniform(0, 2 * np.pi), rng.uniform(0.2, 1.0)
        course = [place]
        for _ in range(round(rng.uniform(80, 600))):
            bend += -0.05 * bend + rng.normal(0, 0.012 * rough)
            heading += 0.5 * bend + rng.normal(0, 0.06 * rough)
            if rng.random() < 0.006:
                heading += rng.normal(0, 0.6)
            place = place + 0.5 * np.array([np.sin(heading), np.cos(heading)])
            row, column = place.astype(int)
            if not (0 <= row < seen.shape[0] and 0 <= column < seen.shape[1] and seen[row, column]):
                break
            course.append(place)
        if len(course) > 80:
            return np.array(course)
    return None


def _paint_groove(stack: Image32, rng: np.random.Generator, course: FloatArray) -> None:
    """Paint a groove of 30 to 300 um: a third of them black, the others with flanks that shine."""
    share = np.arange(len(course)) / len(course)
    widths = np.exp(rng.uniform(np.log(0.6), np.log(6.0)) + 0.5 * _slow(rng, len(course), 20))
    widths *= np.minimum(1.0, 4 * np.minimum(share, 1 - share) + 0.25)
    low = np.maximum(np.floor(course.min(axis=0)).astype(int) - 12, 0)
    high = np.minimum(np.ceil(course.max(axis=0)).astype(int) + 12, stack.shape[1:])
    size = high - low
    rows, columns = (
        (np.arange(n * _FINE) + 0.5) / _FINE - 0.5 + start
        for n, start in zip(size, low, strict=True)
    )
    places = np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1)
    far, near = cKDTree(course).query(places, distance_upper_bound=8)
    near = np.where(np.isfinite(far), near, 0)
    way = np.gradient(ndimage.gaussian_filter1d(course, 4, axis=0), axis=0)
    way /= np.hypot(*way.T)[:, None] + 1e-9
    normal = np.stack([-way[:, 1], way[:, 0]], axis=1)
    left = ((places - course[near]) * normal[near]).sum(axis=-1) <= 0
    inside = far < widths[near] / 2
    black = rng.random() < 0.35
    base = rng.uniform(0.03, 0.3) if black else np.exp(rng.normal(-0.1, 0.6))
    turned = 0.0 if black else abs(rng.normal(0, 0.7))
    first, blur = rng.uniform(0, 2 * np.pi), rng.uniform(0.45, 1.0)
    along = base * np.exp(0.9 * _slow(rng, len(course), 25))
    heading = np.arctan2(normal[:, 0], normal[:, 1])
    for k in range(len(stack)):
        level = 0.0 if black else rng.normal(0, 0.25)
        lit = turned * np.cos(first + 2 * np.pi * k / LIGHTS - heading)
        flank = (along * np.exp(lit + level))[near], (along * np.exp(level - lit))[near]
        bright = np.where(inside, np.where(left, *flank), 1.0)
        bright = ndimage.gaussian_filter(bright, blur * _FINE)
        bright = bright.reshape(size[0], _FINE, size[1], _FINE).mean(axis=(1, 3))
        stack[k, low[0] : high[0], low[1] : high[1]] += np.log(np.maximum(bright, 0.02))


def _slow(rng: np.random.Generator, count: int, size: float) -> FloatArray:
    """Return noise (N,) with a standard deviation of about 1/2 that changes slowly."""
    return np.asarray(ndimage.gaussian_filter1d(rng.normal(0, np.sqrt(size), count), size))


def _blob(rng: np.random.Generator, seen: BoolArray) -> Image32:
    """Return what a bead, a deposit or a stain adds to the logarithms (K, rows, columns)."""
    rows, columns = np.nonzero(seen)
    middle = rng.integers(len(rows))
    size = np.exp(rng.uniform(np.log(4), np.log(28)))
    i, j = np.indices(seen.shape)
    i, j = i - rows[middle], j - columns[middle]
    heading, turn, flat = np.arctan2(i, j), rng.uniform(0, np.pi), rng.uniform(0.5, 1)
    along, across = j * np.cos(turn) + i * np.sin(turn), i * np.cos(turn) - j * np.sin(turn)
    edge = size * np.ones(seen.shape)
    for wave in range(2, 6):
        if rng.random() < 0.6:
            edge += size * rng.normal(0, 0.12) * np.cos(wave * heading + rng.uniform(0, 6.3))
    out = np.hypot(along, across / flat) / np.maximum(edge, 1)
    soft = rng.uniform(0.3, 1.5) / size
    inside = 1 / (1 + np.exp(np.clip((out - 1) / soft, -30, 30)))
    rim = np.exp(-0.5 * ((out - 1) * size / rng.uniform(0.8, 2.5)) ** 2)
    shaded = inside * np.minimum(out, 1.2) if rng.random() < 0.5 else rim
    level, turned, halo = rng.normal(0.3, 0.7), abs(rng.normal(0, 0.8)), rng.uniform(0, 0.35)
    first = rng.uniform(0, 2 * np.pi)
    return np.stack(
        [
            level * inside
            + turned * shaded * np.cos(heading - first - 2 * np.pi * k / LIGHTS)
            - halo * rim
            for k in range(LIGHTS)
        ]
    ).astype(np.float32)
