"""Shading of the wall, against the same equations pixel by pixel in double precision."""

import numpy as np
import pytest

from minorloop_head.twins._camera_kernels import CELL, COMMON, PER_LED
from minorloop_head.twins._shade_kernels import shade

SIZE = np.array([4.9e-5, 5e-5, 2 * np.pi / 1280], np.float32)
METAL = np.array([0.6, 0.3, 0.2, 0.35, 0.15], np.float32)


def texture(rng):
    """Texels of two levels, with the repeated row and column, and their shapes."""
    levels = []
    for rows, columns in ((64, 1280), (32, 640)):
        level = rng.uniform(0.1, 0.4, (rows, columns, 4)).astype(np.float32)
        levels.append(np.pad(level, ((0, 1), (0, 0), (0, 0)), mode="edge"))
        levels[-1] = np.concatenate([levels[-1], levels[-1][:, :1]], axis=1)
    shapes = np.array([[0, 64, 1280], [65 * 1281, 32, 640]])
    return levels, np.concatenate([level.reshape(-1, 4) for level in levels]), shapes


def plain(fields, levels, v, u):
    """Radiance of one pixel."""
    i, j, down, right = v // CELL, u // CELL, v % CELL / CELL, u % CELL / CELL
    corner = fields[:, i : i + 2, j : j + 2].astype(np.float64)
    corner[0] = corner[0, 0, 0] + (corner[0] - corner[0, 0, 0] + np.pi) % (2 * np.pi) - np.pi
    upper, lower = ((1 - right) * corner[:, n, 0] + right * corner[:, n, 1] for n in (0, 1))
    now = (1 - down) * upper + down * lower
    middle = 0.5 * ((1 - down) * corner[2, 0].sum() + down * corner[2, 1].sum())
    n = int(middle / SIZE[0] > 1.5)
    level, scale = levels[n].astype(np.float64), 0.5**n
    x = (now[0] % (2 * np.pi)) * scale / SIZE[2] - 0.5 + 0.5 * scale
    x %= level.shape[1] - 1
    y = np.clip(now[1] * scale / SIZE[1] - 0.5 + 0.5 * scale, 0, len(level) - 2)
    p, q, s, t = int(x), int(y), x % 1, y % 1
    above = (1 - s) * level[q, p] + s * level[q, p + 1]
    below = (1 - s) * level[q + 1, p] + s * level[q + 1, p + 1]
    albedo, a, b, gloss = (1 - t) * above + t * below
    diffuse, specular, around, along, ambient = METAL.astype(np.float64)
    out = ambient * diffuse * albedo * now[4]
    for first in range(COMMON, len(fields), PER_LED):
        normal, eastward, northward, east, north, weight = now[first : first + PER_LED]
        face = max(normal - a * eastward - b * northward, 0.0)
        out += diffuse * albedo * face / np.sqrt(1 + a * a + b * b)
        wide = 1 + ((east + a) / around) ** 2 + ((north + b) / along) ** 2
        out += specular * gloss * weight / (np.pi * around * along * wide**2)
    return out


@pytest.mark.parametrize(("seed", "lights", "width"), [(1, 1, 4e-5), (2, 3, 1.1e-4), (3, 2, 7e-5)])
def test_a_row_of_pixels_is_shaded_as_each_by_itself(seed, lights, width):
    rng = np.random.default_rng(seed)
    levels, texels, shapes = texture(rng)
    shape = (4, 6)
    fields = rng.uniform(0.2, 1.0, (COMMON + PER_LED * lights, *shape)).astype(np.float32)
    # Phi passes pi, and z leaves the wall on both sides.
    turn = np.linspace(3.0, 3.4, shape[1])[None] + 0.01 * rng.normal(size=shape)
    fields[0] = (turn + np.pi) % (2 * np.pi) - np.pi
    fields[1] = np.linspace(-2e-4, 3.4e-3, shape[0])[:, None] + 1e-5 * rng.normal(size=shape)
    fields[2] = width * rng.uniform(0.9, 1.1, shape)
    image = np.empty((CELL * (shape[0] - 1), CELL * (shape[1] - 1)), np.float32)
    shade(fields, texels, shapes, SIZE, METAL, image)
    each = [[plain(fields, levels, v, u) for u in range(image.shape[1])] for v in range(len(image))]
    np.testing.assert_allclose(image, each, rtol=2e-3)
