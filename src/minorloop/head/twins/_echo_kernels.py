"""Compiled loops for echoes: arrays in, arrays out.

Positions are in metres in the pipe; a beam is a table (off, along, frequency) without its
carrier exp(i k along).
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def height_at(phi, z, radius, texture, cell, rough, dents):
    """Return the height of the wall towards the axis: roughness, dents and beads."""
    size = texture.shape[0]
    u, v = radius * phi / cell, z / cell
    i, j = int(np.floor(u)), int(np.floor(v))
    a, b = u - i, v - j
    i, j, i1, j1 = i % size, j % size, (i + 1) % size, (j + 1) % size
    h = rough * (
        (1 - a) * ((1 - b) * texture[i, j] + b * texture[i, j1])
        + a * ((1 - b) * texture[i1, j] + b * texture[i1, j1])
    )
    for n in range(dents.shape[0]):
        x = radius * ((phi - dents[n, 0] + np.pi) % (2 * np.pi) - np.pi)
        y = z - dents[n, 1]
        square = (x * x + y * y) / dents[n, 2] ** 2
        if square < 30.0:
            h += dents[n, 3] * np.exp(-0.5 * square)
    return h


@njit(cache=True, nogil=True)
def echo_of_wall(
    table, grid, k0, dk, origin, axis, radius, half, step, water,
    bores, dents, texture, grains, cell, rough, reference,
    out, grain_out,
):  # fmt: skip
    """Add 2 p dp/dn over the facets of the wall about the spot, for each frequency.

    ``bores`` are (N, 5): phi, z, radius of the mouth, width and slope of the chamfer. ``out`` and
    ``grain_out`` are (F,) complex; the second takes the echoes of grains under the wall.
    """
    count = out.shape[0]
    across = axis[0] * axis[0] + axis[1] * axis[1]
    b = origin[0] * axis[0] + origin[1] * axis[1]
    c = origin[0] ** 2 + origin[1] ** 2 - radius * radius
    length = (-b + np.sqrt(b * b - across * c)) / across
    spot_phi = np.arctan2(origin[1] + length * axis[1], origin[0] + length * axis[0])
    spot_z = origin[2] + length * axis[2]
    cells = int(np.ceil(half / step))
    area = step * step
    size = grains.shape[0]
    for i in range(-cells, cells + 1):
        phi = spot_phi + i * step / radius
        nx, ny = np.cos(phi), np.sin(phi)
        for j in range(-cells, cells + 1):
            if (i * i + j * j) * area > half * half:
                continue
            z = spot_z + j * step
            height = height_at(phi, z, radius, texture, cell, rough, dents)
            gone = False
            for n in range(bores.shape[0]):
                x = radius * ((phi - bores[n, 0] + np.pi) % (2 * np.pi) - np.pi)
                inside = bores[n, 2] - np.hypot(x, z - bores[n, 1])
                if inside > 0:
                    gone = True
                elif inside > -bores[n, 3]:
                    height -= bores[n, 4] * (bores[n, 3] + inside)
            if gone:
                continue
            r = radius - height
            if r * ny < water:
                continue
            dx, dy, dz = r * nx - origin[0], r * ny - origin[1], z - origin[2]
            along = dx * axis[0] + dy * axis[1] + dz * axis[2]
            ox, oy, oz = dx - along * axis[0], dy - along * axis[1], dz - along * axis[2]
            off = np.sqrt(ox * ox + oy * oy + oz * oz)
            u, v = off / grid[0], (along - grid[1]) / grid[2]
            m, n0 = int(u), int(np.floor(v))
            if m >= table.shape[0] - 1 or n0 < 0 or n0 >= table.shape[1] - 1:
                continue
            e, g = np.float32(u - m), np.float32(v - n0)
            facing = np.float32(axis[0] * nx + axis[1] * ny)
            side = np.float32((ox * nx + oy * ny) / max(off, 1e-9))
            way = 2.0 * (along - reference)
            phase, turn = np.exp(1j * k0 * way), np.exp(1j * dk * way)
            gi, gj = int(np.floor(radius * phi / step)) % size, int(np.floor(z / step)) % size
            grain, lag = grains[gi, gj, 0], grains[gi, gj, 1]
            late, later = np.exp(1j * k0 * lag), np.exp(1j * dk * lag)
            for f in range(count):
                p00, p01 = table[m, n0, f], table[m, n0 + 1, f]
                p10, p11 = table[m + 1, n0, f], table[m + 1, n0 + 1, f]
                low, high = p00 + g * (p01 - p00), p10 + g * (p11 - p10)
                p = low + e * (high - low)
                slow = ((p01 - p00) + e * ((p11 - p10) - (p01 - p00))) / np.float32(grid[2])
                down = 1j * (k0 + f * dk) * p + slow
                outward = (high - low) / np.float32(grid[0])
                term = 2.0 * area * p * (down * facing + outward * side) * phase
                out[f] += term
                grain_out[f] += grain * term * late
                phase *= turn
                late *= later


@njit(cache=True, nogil=True)
def pressure_at(table, grid, k0, dk, origin, axis, reference, points, out):
    """Fill out (F, N) with the pressure at points (N, 3), with the carrier from ``reference``."""
    for q in range(points.shape[0]):
        dx, dy, dz = points[q, 0] - origin[0], points[q, 1] - origin[1], points[q, 2] - origin[2]
        along = dx * axis[0] + dy * axis[1] + dz * axis[2]
        off = np.sqrt(max(dx * dx + dy * dy + dz * dz - along * along, 0.0))
        u, v = off / grid[0], (along - grid[1]) / grid[2]
        m, n0 = int(u), int(np.floor(v))
        inside = m < table.shape[0] - 1 and 0 <= n0 < table.shape[1] - 1
        e, g = np.float32(u - m), np.float32(v - n0)
        phase = np.exp(1j * k0 * (along - reference))
        turn = np.exp(1j * dk * (along - reference))
        for f in range(out.shape[0]):
            if inside:
                low = table[m, n0, f] + g * (table[m, n0 + 1, f] - table[m, n0, f])
                high = table[m + 1, n0, f] + g * (table[m + 1, n0 + 1, f] - table[m + 1, n0, f])
                out[f, q] = (low + e * (high - low)) * phase
            else:
                out[f, q] = 0.0
            phase *= turn
