"""Round things on a map of the wall, and what speaks for and against each being a hole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from minorloop.arrays import FloatArray
from minorloop.vision import _outline_kernels as kernels
from minorloop.vision.eye import Image32
from minorloop.vision.wallmap import WallMap, median

DARK, BRIGHT, EITHER, LIT = "dark", "bright", "either", "lit"
KINDS = (DARK, BRIGHT, EITHER, LIT)
"""How a candidate was found: by a dark inside, a bright one, an edge of either sign that is there
under every light, or light from behind."""

_SIGNS = {DARK: 1.0, BRIGHT: -1.0, EITHER: 0.0, LIT: -1.0}
_SIGMAS = (0.225e-3, 0.5e-3)
_RADII = (0.35e-3, 0.65e-3)
_SEEDS, _LIT_SEEDS = 14, 5
_LEAST_RISE = 0.02
_APART = 3.5
_CLIP = {DARK: (-2.5, 1.2), BRIGHT: (-1.5, 2.0), EITHER: (-2.5, 1.5)}

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
)
"""Names of the numbers in ``Candidate.features``, in their order."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """Something round.

    Parameters
    ----------
    x, y : float
        Column and row of its middle on the map.
    diameter : float
        In metres.
    kind : str
        One of ``KINDS``.
    features : (F,) array
        Numbers named by ``FEATURES``.
    """

    x: float
    y: float
    diameter: float
    kind: str
    features: FloatArray


def candidates(wall: WallMap) -> list[Candidate]:
    """Round things of 0.7 to 1.3 mm on a map, most of which are not holes."""
    step = wall.window.step
    seen = np.isfinite(wall.ground) & np.isfinite(wall.whole)
    dark, bright = _seeds(wall, seen)
    found: list[Candidate] = []
    for kind, seeds in ((DARK, dark), (BRIGHT, bright), (EITHER, _merged(dark, bright))):
        low, high = _CLIP[kind]
        stack = np.clip(wall.stack, wall.ground + low, wall.ground + high)
        found += _outlined(wall, stack, seeds, kind, step)
    if wall.glow is not None:
        seeds = _peaks(_blob(wall.glow, seen, step), _LIT_SEEDS, 2)
        found += _outlined(wall, wall.glow[None], seeds, LIT, step)
    return found


def _seeds(
    wall: WallMap, seen: np.ndarray
) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
    """Where it is dark and where it is bright, in map columns and rows."""
    step, low, high = wall.window.step, wall.ground - 0.8, wall.ground + 0.6
    dark: list[tuple[float, float]] = []
    for level in (median(wall.stack), wall.darkest, wall.brightest):
        blob = -_blob(np.clip(level, low, high).astype(np.float32), seen, step)
        dark = _merged(dark, _peaks(blob, _SEEDS, 2))
    return dark, _peaks(_blob(wall.darkest, seen, step), _SEEDS, 2)


def _blob(level: Image32, seen: np.ndarray, step: float) -> Image32:
    """Difference of two Gaussians at half the size; 0 near what is not seen."""
    weight = _halved(seen.astype(np.float32))
    value = _halved(np.where(seen, level, np.float32(0)))
    means = []
    for sigma in _SIGMAS:
        width = sigma / step / 2
        share = ndimage.gaussian_filter(weight, width, truncate=3.0, mode="constant")
        total = ndimage.gaussian_filter(value, width, truncate=3.0, mode="constant")
        means.append((total / np.maximum(share, 0.05), share))
    blob: Image32 = np.where(means[0][1] < 0.6, np.float32(0), means[0][0] - means[1][0])
    return blob


def _halved(level: Image32) -> Image32:
    """Means of 2 by 2."""
    rows, columns = (n // 2 * 2 for n in level.shape)
    four: Image32 = level[:rows, :columns].reshape(rows // 2, 2, columns // 2, 2)
    return np.asarray(four.mean(axis=(1, 3), dtype=np.float32))


def _peaks(blob: Image32, most: int, scale: int) -> list[tuple[float, float]]:
    """Columns and rows of the highest peaks, ``scale`` times as large."""
    top = (blob == ndimage.maximum_filter(blob, size=5)) & (blob > _LEAST_RISE)
    i, j = np.nonzero(top)
    order = np.argsort(-blob[i, j], kind="stable")[:most]
    middle = (scale - 1) / 2
    return [(float(scale * j[n] + middle), float(scale * i[n] + middle)) for n in order]


def _merged(
    first: list[tuple[float, float]], second: list[tuple[float, float]]
) -> list[tuple[float, float]]:
    """Both, without those that are close to one that is there."""
    merged = list(first)
    for x, y in second:
        if all(np.hypot(x - a, y - b) > _APART for a, b in merged):
            merged.append((x, y))
    return merged


def _outlined(
    wall: WallMap, stack: Image32, seeds: list[tuple[float, float]], kind: str, step: float
) -> list[Candidate]:
    """Candidates about seeds."""
    sign, lights = _SIGNS[kind], [*wall.stack, wall.whole]
    least, most = (radius / step for radius in _RADII)
    fit, each = np.empty(kernels.OUT), np.empty((len(lights), kernels.OUT))
    found = []
    for x, y in seeds:
        kernels.outline(stack, x, y, sign, least, most, fit)
        if not np.isfinite(fit).all():
            continue
        for level, out in zip(lights, each, strict=True):
            kernels.describe(level[None], fit[0], fit[1], sign, fit[2], fit[3], fit[4], out)
        features = _features(fit, np.nan_to_num(each, nan=0.3), step)
        found.append(Candidate(float(fit[0]), float(fit[1]), 2 * step * fit[2], kind, features))
    return found


def _features(fit: FloatArray, each: FloatArray, step: float) -> FloatArray:
    """What ``FEATURES`` names: of the outline, and of how it looks under each light."""
    diameter, lights = 2e3 * step * fit[2], each[:-1]
    oval = float(np.hypot(fit[3], fit[4]) / fit[2])
    contrast = np.clip(fit[7:11], -1.0, 1.5)
    ridges, rims = np.sort(lights[:, 15]), np.sort(lights[:, 12])
    shares, scatters = np.sort(lights[:, 6]), np.sort(lights[:, 5])
    spread = float(lights[:, 11].std())
    half = len(lights) // 2
    return np.array(
        [
            max(0.85 - diameter, 0.0) + max(diameter - 1.15, 0.0),
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
