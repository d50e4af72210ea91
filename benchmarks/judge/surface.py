"""Triangles and textures of a scene, as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft
from scipy.spatial import Delaunay, cKDTree

from benchmarks.judge.scenes import (
    END,
    RADIUS,
    START,
    STEP,
    TEXEL,
    THICKNESS,
    Deposit,
    Groove,
    Hole,
    Scene,
    around_hole,
)

_RINGS = 0.5 * (1 - np.cos(np.linspace(0, np.pi / 2, 12))) * 2
"""Rings of triangles between a mouth and the grid, denser at the mouth."""
LENGTH = 28.0
"""Of the textures along the pipe, about the place, in mm; they are mirrored beyond."""
_HALF = 12
"""Half of the square of the grid that a mouth replaces, in steps."""


@dataclass(frozen=True, eq=False)
class Triangles:
    """Points (N, 3), normals (N, 3) into the pipe, u and v (N, 2), and corners (M, 3)."""

    points: np.ndarray
    normals: np.ndarray
    uv: np.ndarray
    corners: np.ndarray


@dataclass(frozen=True, eq=False)
class Textures:
    """Maps (rows along z, columns around) of the wall.

    ``height`` is in millimetres into the pipe, ``cover`` the share of a dull layer of reflectance
    ``layer`` on the metal, ``shine`` the reflectance of the metal relative to clean, ``rough`` a
    factor of its roughness.
    """

    height: np.ndarray
    cover: np.ndarray
    layer: np.ndarray
    shine: np.ndarray
    rough: np.ndarray


def wall_triangles(scene: Scene) -> Triangles:
    """Return the wall; the seam of its texture is opposite of the place."""
    columns = round(2 * np.pi * RADIUS / STEP)
    rows = round((END - START) / STEP)
    phi0 = scene.place[0] - np.pi
    phi = phi0 + 2 * np.pi * np.arange(columns + 1) / columns
    z = START + STEP * np.arange(rows + 1)
    grid = np.stack(np.meshgrid(phi, z), axis=-1).reshape(-1, 2)
    j, i = np.meshgrid(np.arange(columns), np.arange(rows))
    first = (i * (columns + 1) + j).ravel()
    corners = _halves(first, first + 1, first + columns + 2, first + columns + 1)
    places = grid
    if scene.groove is not None:
        box = _window_about(scene.groove, grid)
        places, more = _beside(scene.groove, grid, box)
        corners = np.concatenate([corners[~box[corners].all(axis=1)], more])
    if scene.hole is not None:
        middle_j = round((scene.hole.phi - phi0) / (phi[1] - phi[0]))
        middle_i = round((scene.hole.z - START) / STEP)
        inside = (abs(j - middle_j + 0.5) < _HALF) & (abs(i - middle_i + 0.5) < _HALF)
        corners = corners[~np.tile(inside.ravel(), 2)]
        loop = _loop(middle_i, middle_j, columns + 1)
        extra, more = _mouth(scene.hole, grid[loop], len(grid), loop)
        places = np.concatenate([grid, extra])
        corners = np.concatenate([corners, more])
    points, normals = _raised(scene, places)
    return Triangles(points, normals, _uv(scene, places), _facing(points, normals, corners))


_BESIDE = 0.9
"""Distance of a row of points beside a groove from its rim, in half widths."""


def _window_about(groove: Groove, grid: np.ndarray) -> np.ndarray:
    """Return which points of the grid are in a rectangle with a groove in it."""
    margin = 4 * STEP * np.array([1 / RADIUS, 1.0])
    low, high = groove.course.min(axis=0) - margin, groove.course.max(axis=0) + margin
    inside: np.ndarray = ((grid > low) & (grid < high)).all(axis=1)
    return inside


def _rows(groove: Groove) -> tuple[np.ndarray, np.ndarray]:
    """Return the middle of a groove (N, 2), and its rims and rows beside them (M, 2)."""
    flat, half = groove.course * [RADIUS, 1.0], groove.widths / 2
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(flat, axis=0).T))])
    # Triangles end at a rim where its points are nearer to each other than to the next row.
    number = np.concatenate([[0.0], np.cumsum(np.diff(along) / (0.7 * half[1:]))])
    at = np.interp(np.arange(int(number[-1]) + 1), number, along)
    way = np.gradient(flat, along, axis=0)
    normal = np.stack([-way[:, 1], way[:, 0]], axis=1) / np.hypot(*way.T)[:, None]
    middle, side, wide = (
        np.stack([np.interp(at, along, part) for part in np.atleast_2d(each.T)], axis=1)
        for each in (flat, normal, half)
    )
    rims = [middle + off * wide * side for off in (-1 - _BESIDE, -1.0, 1.0, 1 + _BESIDE)]
    tips = [middle[:1] + (middle[:1] - middle[1:2]), middle[-1:] + (middle[-1:] - middle[-2:-1])]
    return middle / [RADIUS, 1.0], np.concatenate([*rims, *tips]) / [RADIUS, 1.0]


def _beside(groove: Groove, grid: np.ndarray, box: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the points of the grid with those of rims, and the triangles beside a groove."""
    middle, rims = _rows(groove)
    scale = [RADIUS, 1.0]
    off, nearest = cKDTree(groove.course * scale).query(grid[box] * scale)
    free = np.flatnonzero(box)[off > (1 + 1.5 * _BESIDE) * groove.widths[nearest] / 2 + 0.01]
    places = np.concatenate([grid, rims])
    number = np.concatenate([free, len(grid) + np.arange(len(rims))])
    points = np.concatenate([places[number], middle]) * scale
    corners = Delaunay(points).simplices
    return places, number[corners[(corners < len(number)).all(axis=1)]]


def groove_triangles(scene: Scene) -> Triangles:
    """Return the flanks of a groove, each triangle with a normal of its own."""
    groove = scene.groove
    middle, rims = _rows(groove)
    places = np.concatenate([rims, middle])
    corners = Delaunay(places * [RADIUS, 1.0]).simplices
    deep = corners >= len(rims)
    flank = corners[deep.any(axis=1) & ~deep.all(axis=1)]
    points, normals = _raised(scene, places)
    _, nearest = cKDTree(groove.course).query(middle)
    points[len(rims) :] -= (groove.slope * groove.widths[nearest] / 2)[:, None] * normals[
        len(rims) :
    ]
    flank = _facing(points, normals, flank)
    a, b, c = (points[flank[:, n]] for n in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    order = flank.ravel()
    return Triangles(
        points[order],
        np.repeat(normal, 3, axis=0),
        _uv(scene, places)[order],
        np.arange(len(order)).reshape(-1, 3),
    )


def _uv(scene: Scene, places: np.ndarray) -> np.ndarray:
    """Return u and v (N, 2) of places on the textures."""
    u = (places[:, 0] - scene.place[0] + np.pi) / (2 * np.pi)
    return np.stack([u, 0.5 + (places[:, 1] - scene.place[1]) / LENGTH], axis=1)


def _halves(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def _loop(i: int, j: int, columns: int) -> np.ndarray:
    """Return the points of the grid on the edge of the square about a mouth, in a circle."""
    side = np.arange(-_HALF, _HALF)
    rows = np.concatenate([side * 0 - _HALF, side, side * 0 + _HALF, -side])
    cols = np.concatenate([side, side * 0 + _HALF, -side, side * 0 - _HALF])
    return (i + rows) * columns + j + cols


def _mouth(
    hole: Hole, edge: np.ndarray, count: int, loop: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return places (N, 2) between a mouth and the edge (L, 2) of its square, and corners."""
    angle = np.arctan2(edge[:, 1] - hole.z, RADIUS * (edge[:, 0] - hole.phi))
    rim = np.stack(around_hole(hole, hole.diameter / 2 + hole.chamfer, angle), axis=1)
    rings = rim + _RINGS[:-1, None, None] * (edge - rim)
    size = len(loop)
    number = np.concatenate([count + np.arange(rings.shape[0] * size), loop]).reshape(-1, size)
    ahead = np.roll(number, -1, axis=1)
    corners = _halves(
        number[:-1].ravel(), ahead[:-1].ravel(), ahead[1:].ravel(), number[1:].ravel()
    )
    return rings.reshape(-1, 2), corners


def _raised(scene: Scene, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points and normals of places on the wall with its dimples."""
    phi, z = places.T
    height, around, along = np.zeros((3, len(places)))
    mounds = [(each.phi, each.z, each.radius / 2, each.height) for each in scene.deposits]
    for p, q, size, top in (*scene.dimples, *mounds):
        x, y = RADIUS * (phi - p), z - q
        near = np.flatnonzero(np.abs(x) + np.abs(y) < 8 * size)
        bump = top * np.exp(-(x[near] ** 2 + y[near] ** 2) / (2 * size**2))
        height[near] += bump
        around[near] -= bump * x[near] / size**2
        along[near] -= bump * y[near] / size**2
    c, s = np.cos(phi), np.sin(phi)
    points = np.stack([(RADIUS - height) * c, (RADIUS - height) * s, z], axis=1)
    normals = np.stack([-c + around * s, -s - around * c, -along], axis=1)
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _facing(points: np.ndarray, normals: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return corners in the order in which triangles face the side of their normals."""
    a, b, c = (points[corners[:, n]] for n in range(3))
    flip = (np.cross(b - a, c - a) * normals[corners[:, 0]]).sum(axis=1) < 0
    turned = corners.copy()
    turned[flip] = turned[flip][:, ::-1]
    return turned


def bore_triangles(hole: Hole) -> list[Triangles]:
    """Return chamfer and lining of a hole."""
    angle = np.linspace(0, 2 * np.pi, 96, endpoint=False)
    axis = np.array([np.cos(hole.phi), np.sin(hole.phi), 0.0])
    around = np.array([-axis[1], axis[0], 0.0])
    out = np.cos(angle)[:, None] * around + np.sin(angle)[:, None] * np.array([0.0, 0.0, 1.0])

    def ring(radius: float, depth: float) -> np.ndarray:
        height = np.sqrt(RADIUS**2 - (radius * np.cos(angle)) ** 2)[:, None]
        return height * axis + radius * out + depth * axis

    radius, parts = hole.diameter / 2, []
    outer = radius + hole.chamfer
    if hole.chamfer > 0:
        slope = hole.chamfer_depth / hole.chamfer
        normal = -out * slope - axis
        rings = [ring(outer, 0.0), ring(radius, hole.chamfer_depth)]
        parts.append(_tube(rings, normal / np.linalg.norm(normal, axis=1, keepdims=True)))
    deep = [ring(radius, d) for d in np.linspace(hole.chamfer_depth, THICKNESS, 6)]
    parts.append(_tube(deep, -out))
    return parts


def _tube(rings: list[np.ndarray], normal: np.ndarray) -> Triangles:
    points, size = np.concatenate(rings), len(normal)
    number = np.arange(len(points)).reshape(-1, size)
    ahead = np.roll(number, -1, axis=1)
    corners = _halves(
        number[:-1].ravel(), ahead[:-1].ravel(), ahead[1:].ravel(), number[1:].ravel()
    )
    normals = np.tile(normal, (len(rings), 1))
    return Triangles(points, normals, np.zeros((len(points), 2)), _facing(points, normals, corners))


def soil_triangles(hole: Hole, rng: np.random.Generator) -> Triangles:
    """Return the uneven surface of what fills a mouth."""
    angle = np.linspace(0, 2 * np.pi, 96, endpoint=False)
    shares = np.linspace(0.0, 1.0, 16)
    r, a = (g.ravel() for g in np.meshgrid(shares * hole.diameter / 2, angle, indexing="ij"))
    x, y = r * np.cos(a), r * np.sin(a)
    uneven = np.zeros_like(x)
    for _ in range(8):
        k = rng.normal(0, 5.0, 2)
        uneven += np.sin(k[0] * x + k[1] * y + rng.uniform(0, 2 * np.pi)) / 2
    depth = np.maximum(hole.recess + hole.unevenness * uneven, 0.02)
    axis = np.array([np.cos(hole.phi), np.sin(hole.phi), 0.0])
    around = np.array([-axis[1], axis[0], 0.0])
    base = np.sqrt(RADIUS**2 - x**2) + depth
    points = base[:, None] * axis + x[:, None] * around
    points[:, 2] += hole.z + y
    number = np.arange(len(points)).reshape(-1, len(angle))
    ahead = np.roll(number, -1, axis=1)
    corners = _halves(
        number[:-1].ravel(), ahead[:-1].ravel(), ahead[1:].ravel(), number[1:].ravel()
    )
    normals = np.tile(-axis, (len(points), 1))
    corners = _facing(points, normals, corners)
    return Triangles(points, normals, np.zeros((len(points), 2)), corners)


def textures(scene: Scene) -> Textures:
    """Draw the maps of the wall by the kind of the scene."""
    rng = np.random.default_rng([scene.texture_seed, 5])
    shape = (round(LENGTH / TEXEL), round(2 * np.pi * RADIUS / TEXEL))
    fine = _noise(rng, shape, (1.5, 0.06), 1.0)
    rust = _noise(rng, shape, (1.2, 1.2), 2.2)
    kind = scene.kind
    slope = {"bare": (0.01, 0.05), "worn": (0.02, 0.08), "corroded": (0.02, 0.06)}[kind]
    height = _with_slope(fine, float(rng.uniform(*slope)))
    cover, layer = np.zeros(shape), np.full(shape, 0.15)
    shine, rough = np.ones(shape), np.ones(shape)
    if kind != "bare":
        rough *= np.exp(0.25 * _noise(rng, shape, (0.8, 0.8), 2.0))
        _scratch(rng, scene, height, int(rng.integers(5, 40 if kind == "worn" else 15)))
    if kind == "corroded":
        height += _with_slope(_noise(rng, shape, (0.25, 0.25), 1.6), float(rng.uniform(0.06, 0.25)))
        share = float(rng.uniform(-0.8, 0.8))
        cover = 0.9 / (1 + np.exp(-(rust - share) / 0.25))
        layer = 0.16 * np.exp(0.35 * _noise(rng, shape, (0.4, 0.4), 1.8))
        rough *= 1 + 0.4 * cover
    shine *= np.exp(0.06 * _noise(rng, shape, (3.0, 0.1), 1.0))
    for _ in range(int(rng.integers(2, 9))):
        _stain(rng, scene, shine, rough)
    for _ in range(int(rng.integers(1, 7))):
        _soil(rng, scene, cover, layer, height)
    for deposit in scene.deposits:
        _deposit(rng, scene, deposit, cover, layer, height)
    for _ in range(scene.blotches):
        _blotch(rng, scene, shine, cover, layer)
    if scene.weld is not None:
        _weld(rng, scene, height)
    return Textures(height, np.clip(cover, 0, 1), np.clip(layer, 0.02, 0.9), shine, rough)


def _noise(
    rng: np.random.Generator, shape: tuple[int, int], scale: tuple[float, float], fall: float
) -> np.ndarray:
    """Return noise of standard deviation 1 with correlation lengths along and around, in mm."""
    white = fft.rfft2(rng.standard_normal(shape, dtype=np.float32))
    v = np.float32(2 * np.pi * scale[0]) * fft.fftfreq(shape[0], TEXEL).astype(np.float32)
    u = np.float32(2 * np.pi * scale[1]) * fft.rfftfreq(shape[1], TEXEL).astype(np.float32)
    spectrum = white * (1 + u[None] ** 2 + v[:, None] ** 2) ** np.float32(-0.5 * fall)
    shaped = fft.irfft2(spectrum, shape)
    return shaped / shaped.std()


def _with_slope(height: np.ndarray, slope: float) -> np.ndarray:
    """Return heights scaled to a standard deviation of their slopes."""
    steep = np.sqrt((np.diff(height, axis=0) ** 2).mean() + (np.diff(height, axis=1) ** 2).mean())
    return height * slope * TEXEL / steep


def _window(
    scene: Scene, shape: tuple[int, int], x: float, y: float, reach: float
) -> tuple[slice, slice, np.ndarray, np.ndarray]:
    """Return the texels within reach of a place beside that of the scene, and their offsets."""
    column = shape[1] / 2 + x / TEXEL
    row = shape[0] / 2 + y / TEXEL
    half = int(reach / TEXEL) + 1
    rows = slice(max(int(row) - half, 0), min(int(row) + half, shape[0]))
    cols = slice(max(int(column) - half, 0), min(int(column) + half, shape[1]))
    p, q = np.mgrid[rows, cols]
    return rows, cols, TEXEL * (q + 0.5 - column), TEXEL * (p + 0.5 - row)


def _scratch(rng: np.random.Generator, scene: Scene, height: np.ndarray, count: int) -> None:
    for _ in range(count):
        x, y, length = rng.uniform(-9, 9), rng.uniform(-9, 9), rng.uniform(1, 9)
        turn, width = rng.uniform(0, np.pi), rng.uniform(0.03, 0.1)
        deep = width * rng.uniform(0.05, 0.3)
        rows, cols, u, v = _window(scene, height.shape, x, y, length / 2 + 0.5)
        along = u * np.cos(turn) + v * np.sin(turn)
        across = -u * np.sin(turn) + v * np.cos(turn) + 0.03 * along**2 / length
        fade = np.clip((length / 2 - np.abs(along)) / 0.3, 0, 1)
        height[rows, cols] -= deep * fade * np.exp(-((across / width) ** 2))


def _lobes(rng: np.random.Generator, u: np.ndarray, v: np.ndarray, size: float) -> np.ndarray:
    """Return the distance inside a ragged outline, in mm; negative outside."""
    angle, ragged = np.arctan2(v, u), rng.uniform(0.05, 0.5)
    edge = np.full(u.shape, size)
    for n in range(2, 9):
        edge += size * ragged / n * rng.standard_normal() * np.cos(n * angle + rng.uniform(0, 7))
    return edge - np.hypot(u, v * rng.uniform(0.6, 1.0))


def _stain(rng: np.random.Generator, scene: Scene, shine: np.ndarray, rough: np.ndarray) -> None:
    size = float(np.exp(rng.uniform(np.log(0.25), np.log(2.5))))
    rows, cols, u, v = _window(scene, shine.shape, *rng.uniform(-8, 8, 2), 2.5 * size + 0.5)
    inside = 1 / (1 + np.exp(-_lobes(rng, u, v, size) / rng.uniform(0.03, 0.3)))
    shine[rows, cols] *= 1 - rng.uniform(0.1, 0.6) * inside
    rough[rows, cols] *= 1 + rng.uniform(0, 0.6) * inside


def _soil(
    rng: np.random.Generator,
    scene: Scene,
    cover: np.ndarray,
    layer: np.ndarray,
    height: np.ndarray,
) -> None:
    """Add a heap of soil beside the place."""
    size, (x, y) = float(np.exp(rng.uniform(np.log(0.25), np.log(1.5)))), rng.uniform(-8, 8, 2)
    if np.hypot(x, y) < 2 * size + 0.8:  # what covers the place hides it
        return
    rows, cols, u, v = _window(scene, cover.shape, x, y, 2.5 * size + 0.5)
    inside = 1 / (1 + np.exp(-_lobes(rng, u, v, size) / rng.uniform(0.03, 0.2)))
    albedo, grain = rng.uniform(0.04, 0.3), rng.standard_normal(u.shape)
    cover[rows, cols] = np.maximum(cover[rows, cols], 0.97 * inside)
    layer[rows, cols] += inside * (albedo * (1 + 0.15 * grain) - layer[rows, cols])
    height[rows, cols] += inside * (0.1 * size + 0.004 * grain)


def _deposit(
    rng: np.random.Generator,
    scene: Scene,
    deposit: Deposit,
    cover: np.ndarray,
    layer: np.ndarray,
    height: np.ndarray,
) -> None:
    """Cover a mound of the wall with what it is made of."""
    size = deposit.radius
    x, y = RADIUS * (deposit.phi - scene.place[0]), deposit.z - scene.place[1]
    rows, cols, u, v = _window(scene, cover.shape, x, y, 2 * size + 0.3)
    angle, edge = np.arctan2(v, u), np.full(u.shape, size)
    for n in range(2, 6):
        edge += size * deposit.ragged / n * np.cos(n * angle + rng.uniform(0, 7))
    inside = 1 / (1 + np.exp(-(edge - np.hypot(u, v)) / 0.04))
    grain = rng.standard_normal(u.shape)
    cover[rows, cols] = np.maximum(cover[rows, cols], 0.97 * inside)
    layer[rows, cols] += inside * (deposit.albedo * (1 + 0.08 * grain) - layer[rows, cols])
    height[rows, cols] += 0.002 * inside * grain


def _blotch(
    rng: np.random.Generator, scene: Scene, shine: np.ndarray, cover: np.ndarray, layer: np.ndarray
) -> None:
    """Add a flat round spot, of the metal or of a layer on it."""
    size, (x, y) = float(rng.uniform(0.25, 1.0)), rng.uniform(-8, 8, 2)
    if np.hypot(x, y) < size + 0.9:
        return
    rows, cols, u, v = _window(scene, shine.shape, x, y, 2 * size + 0.5)
    edge = size - np.hypot(u, v * rng.uniform(0.75, 1.0))
    edge += 0.2 * size * rng.uniform(0, 1) * np.cos(3 * np.arctan2(v, u) + rng.uniform(0, 7))
    inside = 1 / (1 + np.exp(-edge / rng.uniform(0.02, 0.15)))
    if rng.random() < 0.5:
        shine[rows, cols] *= 1 - rng.uniform(0.3, 0.8) * inside
        return
    cover[rows, cols] = np.maximum(cover[rows, cols], rng.uniform(0.5, 0.97) * inside)
    layer[rows, cols] += inside * (rng.uniform(0.04, 0.6) - layer[rows, cols])


def _weld(rng: np.random.Generator, scene: Scene, height: np.ndarray) -> None:
    """Add a weld round the pipe, with ripples that have sharp valleys."""
    off, width, pitch = scene.weld
    rows, cols, u, v = _window(scene, height.shape, 0.0, off, np.pi * RADIUS)
    across = 2 * v / width
    arch = np.clip(1 - across**2, 0, None)
    phase = (u + 0.5 * width * across**2 + 0.1 * pitch * np.sin(3 * u)) / pitch
    steep = float(rng.uniform(0.05, 0.3))
    ripple = 0.5 * steep * pitch * np.abs(np.cos(np.pi * phase))
    height[rows, cols] += np.minimum(arch, 1) * (float(rng.uniform(0.05, 0.2)) + ripple)
