"""The unrolled surface of a pipe: albedo, slopes and gloss, fine to coarse."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from minorloop_head.twins import _shade_kernels as kernels
from minorloop_head.twins.pipe import Dirt, Pipe

TEXEL = 0.05e-3  # m
COLUMNS = 1280
"""Texels around the pipe: the circumference of 62.8 mm over `TEXEL`, rounded up to a number that
can be halved for each of the `LEVELS`."""
LEVELS = 4
"""Resolutions of the surface, each half of the one before, by trial: the last texels are 0.4 mm
wide."""
_KEPT = 2
"""Number of cached surfaces: that of a pipe, and with a mark on it. Each has some 50 megabytes."""
_STREAK = 1.2e-3  # m, length of brush marks
_STAIN = 2.5e-3  # m, size of stains

_Map32 = npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Surface:
    """The wall at several resolutions, each half as fine as the one before."""

    texels: _Map32
    """Shape (N, 4). Albedo, slope around, slope along, share of the specular reflection; all levels
    one after the other, row by row. Each level has one more row and column than its shape, which
    repeat the last row and the first column."""
    shapes: npt.NDArray[np.int64]
    """Shape (L, 3). First texel, rows and columns of each level."""
    size: tuple[float, float]
    """Size of a texel of the finest level, around and along, in metres."""


def lay_out(pipe: Pipe) -> Surface:
    """Return the surface of a pipe, without its bores and cracks; callers may not change it.

    Drawing it takes a third of a second, so that the last surfaces are cached.
    """
    dents, scratches, dirt = tuple(pipe.dents), tuple(pipe.scratches), tuple(pipe.dirt)
    bare = replace(pipe, bores=(), cracks=(), water=None)
    return _laid_out(replace(bare, dents=dents, scratches=scratches, dirt=dirt))


def with_dirt(surface: Surface, pipe: Pipe, patch: Dirt) -> Surface:
    """Return the surface of a pipe with one more patch of dirt, drawn only where it changes.

    This takes hundredths of a second, and `lay_out` a second for a long pipe. The texels are those
    of `lay_out` up to rounding.
    """
    texels, texel, step = surface.texels.copy(), np.array(surface.size), 2 ** (LEVELS - 1)
    lobes = _lobes(patch)
    reach = patch.size * (1.0 + np.abs(lobes[:, 0]).sum()) + 3.0 * patch.softness + step * texel[1]
    ends = np.array([patch.z - reach, patch.z + reach]) / (step * texel[1])
    rows = surface.shapes[0][1] // step
    low, high = np.clip([math.floor(ends[0]), math.ceil(ends[1])], 0, rows).tolist()
    if low == high:
        return surface
    part = np.ascontiguousarray(_level(texels, surface, 0)[low * step : high * step, :-1])
    z = patch.z - low * step * texel[1]
    kernels.add_dirt(
        part, texel, pipe.radius * patch.phi, z, patch.size, patch.albedo, patch.softness, lobes
    )
    for n, finer in enumerate(_halved(part)):
        level, first = _level(texels, surface, n), low * step >> n
        level[first : first + len(finer), :-1] = finer
        level[first : first + len(finer), -1] = finer[:, 0]
        level[-1] = level[-2]
    return replace(surface, texels=texels)


def _level(texels: _Map32, surface: Surface, n: int) -> _Map32:
    """Return a view of a level with its repeated row and column."""
    first, rows, columns = surface.shapes[n].tolist()
    whole = texels[first : first + (rows + 1) * (columns + 1)]
    return whole.reshape(rows + 1, columns + 1, 4)


@lru_cache(_KEPT)
def _laid_out(pipe: Pipe) -> Surface:
    """Return the surface of a pipe without bores and cracks."""
    step = 2 ** (LEVELS - 1)
    rows = max(step * round(pipe.length / TEXEL / step), step)
    size = (2 * np.pi * pipe.radius / COLUMNS, pipe.length / rows)
    surface = _metal(pipe, rows, size)
    texel = np.array(size)
    for dent in pipe.dents:
        kernels.add_dent(surface, texel, pipe.radius * dent.phi, dent.z, dent.size, dent.height)
    for bead in pipe.welds:
        form = (bead.length, bead.width, bead.height, bead.pitch, bead.ripple)
        kernels.add_weld(surface, texel, pipe.radius * bead.phi, bead.z, bead.angle, *form)
    for mark in pipe.scratches:
        look = (mark.length, mark.width, mark.slope, mark.albedo, mark.bend)
        kernels.add_scratch(surface, texel, pipe.radius * mark.phi, mark.z, mark.angle, *look)
    for patch in pipe.dirt:
        x, lobes = pipe.radius * patch.phi, _lobes(patch)
        kernels.add_dirt(
            surface, texel, x, patch.z, patch.size, patch.albedo, patch.softness, lobes
        )
    return _with_coarser(surface, size)


def _metal(pipe: Pipe, rows: int, size: tuple[float, float]) -> _Map32:
    """Return the surface of the finish alone."""
    finish = pipe.finish
    rng = np.random.default_rng(finish.seed)
    marks = _streaks(rng, rows, size[1])
    tone = finish.streak * _streaks(rng, rows, size[1]) + finish.stain * _stains(rng, rows, size)
    surface = np.empty((rows, COLUMNS, 4), dtype=np.float32)
    surface[..., 0] = np.exp(tone)
    surface[..., 1] = finish.brush * marks
    surface[..., 2] = 0.3 * finish.brush * np.roll(marks, COLUMNS // 3, axis=1)
    surface[..., 3] = 1.0
    return surface


def _streaks(rng: np.random.Generator, rows: int, along: float) -> _Map32:
    """Return noise of unit variance, white around the pipe and correlated along it."""
    noise = rng.standard_normal((rows, COLUMNS), dtype=np.float32)
    length = max(int(_STREAK / along), 1)
    for _ in range(2):
        noise = ndimage.uniform_filter1d(noise, length, axis=0, mode="wrap")
    scaled: _Map32 = noise / noise.std()
    return scaled


def _stains(rng: np.random.Generator, rows: int, size: tuple[float, float]) -> _Map32:
    """Return smooth noise of unit variance."""
    coarse_rows = max(round(rows * size[1] / _STAIN), 2)
    coarse_columns = round(COLUMNS * size[0] / _STAIN)
    coarse = rng.standard_normal((coarse_rows, coarse_columns)).astype(np.float32)
    zoom = (rows / coarse_rows, COLUMNS / coarse_columns)
    smooth: _Map32 = ndimage.zoom(coarse, zoom, order=3, mode="grid-wrap", grid_mode=True)
    return smooth[:rows, :COLUMNS]


def _lobes(patch: Dirt) -> npt.NDArray[np.float64]:
    """Return (4, 2) amplitudes and phases of the outline of dirt."""
    rng = np.random.default_rng(patch.seed)
    sizes = patch.raggedness * rng.uniform(0.2, 1.0, 4) / np.arange(2, 6)
    return np.stack([sizes, rng.uniform(0, 2 * np.pi, 4)], axis=1)


def _halved(finest: _Map32) -> list[_Map32]:
    """Return a map at each of the resolutions."""
    levels = [finest]
    for _ in range(LEVELS - 1):
        even, odd = levels[-1][::2], levels[-1][1::2]
        four = even[:, ::2] + even[:, 1::2] + odd[:, ::2] + odd[:, 1::2]
        levels.append(np.float32(0.25) * four)
    return levels


def _with_coarser(finest: _Map32, size: tuple[float, float]) -> Surface:
    levels = _halved(finest)
    padded = [np.pad(level, ((0, 1), (0, 0), (0, 0)), mode="edge") for level in levels]
    padded = [np.concatenate([level, level[:, :1]], axis=1) for level in padded]
    shapes, first = [], 0
    for level, kept in zip(levels, padded, strict=True):
        shapes.append((first, level.shape[0], level.shape[1]))
        first += kept.shape[0] * kept.shape[1]
    texels = np.concatenate([kept.reshape(-1, 4) for kept in padded])
    return Surface(texels, np.array(shapes, dtype=np.int64), size)
