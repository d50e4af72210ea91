"""The echo of a wall, against the same sum of facets in double precision."""

import numpy as np

from minorloop_head.twins import _echo_kernels as kernels

RADIUS, HALF, STEP, REFERENCE = 10e-3, 0.35e-3, 1e-4, 8e-3
GRID = np.array([1e-4, 7e-3, 5e-5])
K = 40e3 + 150.0 * np.arange(37)


def plain(table, origin, axis, grains):
    """Sums over the facets of the wall and over its grains."""
    wall, grainy = np.zeros((2, K.size), dtype=complex)
    length = (RADIUS - origin[0]) / axis[0]  # the beam starts on the x axis and stays at y = 0
    spot_z, cells = origin[2] + length * axis[2], int(np.ceil(HALF / STEP))
    for i, j in np.ndindex(2 * cells + 1, 2 * cells + 1):
        x, y = (i - cells) * STEP, (j - cells) * STEP
        if x * x + y * y > HALF * HALF:
            continue
        phi, z = x / RADIUS, spot_z + y
        normal = np.array([np.cos(phi), np.sin(phi), 0.0])
        way = RADIUS * normal + [0.0, 0.0, z] - origin
        along = way @ axis
        aside = way - along * axis
        off = np.linalg.norm(aside)
        u, v = off / GRID[0], (along - GRID[1]) / GRID[2]
        m, n, e, g = int(u), int(v), u % 1, v % 1
        (a, b), (c, d) = table[m, n : n + 2], table[m + 1, n : n + 2]
        near, far = a + g * (b - a), c + g * (d - c)
        pressure, outward = near + e * (far - near), (far - near) / GRID[0]
        slow = (b - a + e * (d - c - b + a)) / GRID[2]
        facing, side = axis @ normal, aside @ normal / max(off, 1e-9)
        slope = facing * (slow + 1j * K * pressure) + side * outward
        term = 2 * STEP**2 * pressure * slope
        back = 2 * (along - REFERENCE)
        wall += term * np.exp(1j * K * back)
        size = len(grains)
        grain, lag = grains[int(np.floor(x / STEP)) % size, int(np.floor(z / STEP)) % size]
        grainy += grain * term * np.exp(1j * K * (back + lag))
    return wall, grainy


def test_the_echo_is_the_sum_over_the_facets():
    rng = np.random.default_rng(4)
    table = (rng.normal(size=(12, 60, 37, 2)) @ [1, 1j]).astype(np.complex64)
    grains = np.stack([rng.normal(size=(16, 16)), rng.uniform(0, 1e-3, (16, 16))], axis=-1)
    grains[rng.random((16, 16)) < 0.5] = 0.0
    turn = 0.05
    origin, axis = np.array([1.9e-3, 0.0, 1.3e-4]), np.array([np.cos(turn), 0.0, np.sin(turn)])
    parts = np.ascontiguousarray(np.stack([table.real, table.imag], axis=2))
    none, wall, grainy = np.zeros((0, 5)), np.zeros(37, complex), np.zeros(37, complex)
    kernels.echo_of_wall(
        parts, GRID, K[0], K[1] - K[0], origin, axis, RADIUS, HALF, STEP, -np.inf, none,
        none[:, :4], np.zeros((1, 1)), grains, 1.0, 0.0, REFERENCE, wall, grainy,
    )  # fmt: skip
    for found, known in zip((wall, grainy), plain(table, origin, axis, grains), strict=True):
        np.testing.assert_allclose(found, known, atol=1e-5 * np.abs(known).max())
