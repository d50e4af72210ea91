"""Find round objects on a map of the wall, with the features that tell holes from others."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from minorloop.arrays import FloatArray
from minorloop_head.vision import _outline_kernels as kernels
from minorloop_head.vision.imaging import Image32, gaussian, shrunk
from minorloop_head.vision.reflectance_map import STEP, ReflectanceMap, median

_DARK, _BRIGHT, _EITHER, _LIT = "dark", "bright", "either", "lit"
KINDS = (_DARK, _BRIGHT, _EITHER, _LIT)
"""Kinds of candidates: with a dark inside, a bright inside, an edge of either sign under every
light, or light from behind."""

_SIGNS = {_DARK: 1.0, _BRIGHT: -1.0, _EITHER: 0.0, _LIT: -1.0}
DIAMETERS = (0.85, 1.15)
"""Diameters in millimetres of the holes on a map of scale 1; others are at another scale."""
# Sizes in texels, for such holes and some margin: widths of the blob filter, radii where an outline
# starts, radii that are kept, and radii of the rings of edges.
_SIGMAS = (4.5, 10.0)
_RADII = (7.0, 13.0)
_KEPT = (5.0, 16.0)
_RINGS = (8.5, 11.5)
# Most seeds of each kind, and least height of a seed.
_SEEDS, _RING_SEEDS, _LIT_SEEDS = 8, 10, 5
_LEAST_RISE = 0.02
_APART = 3.5  # texels between seeds
# Reflectances relative to the local median are clipped here, since glints and deep shadows would
# otherwise outweigh the edge of a hole.
_RING_CLIP = (-2.5, 0.8)
_CLIP = {_DARK: (-2.5, 1.2), _BRIGHT: (-1.5, 2.0), _EITHER: (-2.5, 1.5)}

_RIM_TURNS, _RIM_SEEN = 2, 0.5
"""Iterations of the search for a rim, each about the last outline, and least share of the rim with
an edge."""

FEATURES = (
    "size",
    "oval",
    "oval_squared",
    "scatter",
    "share",
    "contrast_10",
    "contrast_25",
    "contrast_50",
    "contrast_90",
    "faint_25",
    "rim_half",
    "rim_all",
    "ridge",
    "ridge_relative",
    "ridge_least",
    "ridge_middle",
    "rim_least",
    "share_least",
    "share_middle",
    "scatter_middle",
    "contrast_least",
    "contrast_most",
    "deepest",
    "spread",
    "spread_on_rim",
    "whole_share",
    "whole_contrast",
    "ring",
    "scale",
)
"""Names of the numbers in ``Candidate.features``, in order."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A round object on the map."""

    x: float
    y: float
    """Column and row of its centre on the map."""
    diameter: float
    """In metres."""
    kind: str
    """One of ``KINDS``."""
    features: FloatArray
    """Shape (F,). Numbers in the order of ``FEATURES``."""
    wave: tuple[float, float] = (0.0, 0.0)
    """Second harmonic of the radius of its outline: cosine and sine, in metres."""

    def outline(self, step: float, count: int = 48) -> FloatArray:
        """Return columns and rows (count, 2) on a map with texels of ``step`` metres."""
        angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
        radius = self.diameter / 2 + self.wave[0] * np.cos(2 * angle)
        radius = (radius + self.wave[1] * np.sin(2 * angle)) / step
        return np.stack([self.x + radius * np.cos(angle), self.y + radius * np.sin(angle)], axis=1)


def candidates(wall: ReflectanceMap) -> list[Candidate]:
    """Return round objects of about 14 to 26 texels on a map, most of which are not holes."""
    seen = np.isfinite(wall.ground) & np.isfinite(wall.whole)
    rings = _rings(wall)
    dark, bright = _seeds(wall, seen, _peaks(rings, _RING_SEEDS, 2))
    found: list[Candidate] = []
    for kind, seeds in ((_DARK, dark), (_BRIGHT, bright), (_EITHER, _merged(dark, bright))):
        low, high = _CLIP[kind]
        stack = np.clip(wall.stack, wall.ground + low, wall.ground + high)
        found += _outlined(wall, stack, rings, seeds, kind)
    if wall.glow is not None:
        seeds = _peaks(_blob(wall.glow, seen), _LIT_SEEDS, 2)
        found += _outlined(wall, wall.glow[None], rings, seeds, _LIT)
    return found


def _rings(wall: ReflectanceMap) -> Image32:
    """Return the strength of edges on a circle as large as a hole about each place, at half size.

    Edges of either sign count, under each light and under all (Loy and Zelinsky, IEEE PAMI 25,
    2003). A hole is darker than a lit wall and brighter than a wall in the shadow of a dent; if a
    shadow ends in it, its edge has both signs.
    """
    images = [*wall.stack, wall.whole]
    low, high = _RING_CLIP
    near, far = (radius / 2 for radius in _RINGS)
    rings = np.zeros(tuple(n // 2 for n in wall.ground.shape), np.float32)
    for image in images:
        level = shrunk(np.clip(image - wall.ground, low, high))
        kernels.vote(gaussian(level, 0.7, 2.5), near, far, rings)
    shared = gaussian(rings, 1.0, 2.5) / len(images)
    return np.asarray(shared, dtype=np.float32)


def _seeds(
    wall: ReflectanceMap, seen: np.ndarray, round_edges: list[tuple[float, float]]
) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
    """Return columns and rows of dark and of bright places; round edges belong to both."""
    low, high = wall.ground - 0.8, wall.ground + 0.6
    dark = round_edges
    for level in (median(wall.stack), wall.darkest, wall.brightest):
        blob = -_blob(np.clip(level, low, high).astype(np.float32), seen)
        dark = _merged(dark, _peaks(blob, _SEEDS, 2))
    return dark, _merged(round_edges, _peaks(_blob(wall.darkest, seen), _SEEDS, 2))


def _blob(level: Image32, seen: np.ndarray) -> Image32:
    """Return a difference of two Gaussians at half size; 0 near unseen texels."""
    weight = shrunk(seen.astype(np.float32))
    value = shrunk(np.where(seen, level, np.float32(0)))
    means = []
    for sigma in _SIGMAS:
        width = sigma / 2
        share = gaussian(weight, width, 3.0, zero=True)
        total = gaussian(value, width, 3.0, zero=True)
        means.append((total / np.maximum(share, 0.05), share))
    blob: Image32 = np.where(means[0][1] < 0.6, np.float32(0), means[0][0] - means[1][0])
    return blob


def _peaks(blob: Image32, most: int, scale: int) -> list[tuple[float, float]]:
    """Return columns and rows of the highest peaks, times ``scale``."""
    top = (blob == ndimage.maximum_filter(blob, size=5)) & (blob > _LEAST_RISE)
    i, j = np.nonzero(top)
    order = np.argsort(-blob[i, j], kind="stable")[:most]
    middle = (scale - 1) / 2
    return [(float(scale * j[n] + middle), float(scale * i[n] + middle)) for n in order]


def _merged(
    first: list[tuple[float, float]], second: list[tuple[float, float]]
) -> list[tuple[float, float]]:
    """Return both lists, without places close to an earlier one."""
    merged = list(first)
    for x, y in second:
        if all(np.hypot(x - a, y - b) > _APART for a, b in merged):
            merged.append((x, y))
    return merged


def _outlined(
    wall: ReflectanceMap,
    stack: Image32,
    rings: Image32,
    seeds: list[tuple[float, float]],
    kind: str,
) -> list[Candidate]:
    """Return candidates with outlines about seeds."""
    sign, lights, step = _SIGNS[kind], [*wall.stack, wall.whole], wall.window.step
    scale = math.log(step / STEP)
    fit, each = np.empty(kernels.OUT), np.empty((len(lights), kernels.OUT))
    found = []
    for x, y in seeds:
        kernels.outline(stack, x, y, sign, *_RADII, fit)
        if not (np.isfinite(fit).all() and _KEPT[0] < fit[2] < _KEPT[1]):
            continue
        for level, out in zip(lights, each, strict=True):
            kernels.describe(level[None], fit[0], fit[1], sign, fit[2], fit[3], fit[4], out)
        ring = _highest(rings, fit[0], fit[1])
        features = np.array([*_features(fit, np.nan_to_num(each, nan=0.3)), ring, scale])
        wave = (step * float(fit[3]), step * float(fit[4]))
        found.append(
            Candidate(float(fit[0]), float(fit[1]), 2 * step * fit[2], kind, features, wave)
        )
    return found


def at_rim(candidate: Candidate, wall: ReflectanceMap) -> Candidate:
    """Return a candidate with place and size of its rim.

    Within the rim of a hole are its far lining, shadows, its floor or its filling, which are
    brighter or darker than the wall and have edges. The rim encloses all texels that depart from
    the wall under some light. If there is no such rim, the candidate is returned unchanged.
    """
    x, y, radius = candidate.x, candidate.y, 0.5 * candidate.diameter / wall.window.step
    away, fit = np.empty(wall.ground.shape, np.float32), np.empty(kernels.OUT)
    for _ in range(_RIM_TURNS):
        if not kernels.depart(wall.stack, x, y, radius, away):
            return candidate
        kernels.outline(away[None], x, y, _SIGNS[_BRIGHT], *_RADII, fit)
        if not np.isfinite(fit).all() or math.hypot(fit[0] - x, fit[1] - y) > radius:
            return candidate
        x, y, radius = fit[:3].tolist()
    if not (_KEPT[0] < radius < _KEPT[1] and fit[12] > _RIM_SEEN):
        return candidate
    step = wall.window.step
    wave = (step * float(fit[3]), step * float(fit[4]))
    return replace(candidate, x=x, y=y, diameter=2 * step * radius, wave=wave)


def compile_outlines() -> None:
    """Compile the fit of outlines, which a picture without a candidate does not use."""
    blank = np.zeros((1, 8, 8), dtype=np.float32)
    kernels.outline(blank, 4.0, 4.0, 1.0, 2.0, 3.0, np.empty(kernels.OUT))
    kernels.depart(blank, 4.0, 4.0, 2.0, np.empty_like(blank[0]))


def _highest(rings: Image32, x: float, y: float) -> float:
    """Return the largest value within a pixel of a place of the map."""
    i, j = round((y - 0.5) / 2), round((x - 0.5) / 2)
    near = rings[max(i - 1, 0) : max(i + 2, 0), max(j - 1, 0) : max(j + 2, 0)]
    return float(near.max(initial=0.0))


def _features(fit: FloatArray, each: FloatArray) -> FloatArray:
    """Return all ``FEATURES`` but the last two: of the outline, and of it under each light."""
    diameter, lights = 2e3 * STEP * fit[2], each[:-1]
    oval = float(np.hypot(fit[3], fit[4]) / fit[2])
    contrast = np.clip(fit[7:11], -1.0, 1.5)
    ridges, rims = np.sort(lights[:, 15]), np.sort(lights[:, 12])
    shares, scatters = np.sort(lights[:, 6]), np.sort(lights[:, 5])
    spread = float(lights[:, 11].std())
    half = len(lights) // 2
    return np.array(
        [
            max(DIAMETERS[0] - diameter, 0.0) + max(diameter - DIAMETERS[1], 0.0),
            oval,
            oval**2,
            fit[5],
            fit[6],
            contrast[0],
            contrast[1],
            contrast[2],
            np.clip(fit[16], -1.0, 2.0),
            np.clip(fit[8], -1.0, 0.35),
            fit[12],
            fit[13],
            fit[15],
            fit[15] / max(contrast[2], 0.2),
            ridges[0],
            ridges[half],
            rims[0],
            shares[0],
            shares[half],
            scatters[half],
            np.clip(lights[:, 10].min(), -1.0, 1.5),
            np.clip(lights[:, 10].max(), -1.0, 2.0),
            np.clip(lights[:, 16].max(), -1.0, 2.0),
            spread,
            spread * rims[0],
            each[-1, 6],
            np.clip(each[-1, 10], -1.0, 1.5),
        ]
    )
