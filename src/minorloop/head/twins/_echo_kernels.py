"""Compiled loops for echoes: arrays in, arrays out.

Positions are in metres in the pipe; a beam is a table (off, along, frequency) without its
carrier exp(i k along). Complex arrays are read as floats, a real and an imaginary part in turn, in
short loops that the compiler vectorises.
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
def carriers(first, step, out):
    """Fill out (2 F,) with exp(i (first + f step)) for each f."""
    out[0], out[1] = np.cos(first), np.sin(first)
    c, s, n = np.cos(step), np.sin(step), 1
    while 2 * n < out.size:
        done, rest = out[: 2 * n], out[2 * n :]
        for f in range(min(n, out.size // 2 - n)):
            rest[2 * f] = done[2 * f] * c - done[2 * f + 1] * s
            rest[2 * f + 1] = done[2 * f] * s + done[2 * f + 1] * c
        c, s, n = c * c - s * s, 2.0 * c * s, 2 * n


@njit(cache=True, nogil=True)
def facet_echo(table, m, n, weights, slopes, k0, dk, term):
    """Fill term (2 F,) with 2 p dp/dn of one facet, interpolated in the table.

    ``weights`` are the position in the cell off and along the axis; ``slopes`` the shares of the
    differences across the cell, off and along the axis, and of the carrier, in dp/dn.
    """
    e, g = weights
    outward, slow, facing = slopes
    a, b = table[m, n].view(np.float32), table[m, n + 1].view(np.float32)
    c, d = table[m + 1, n].view(np.float32), table[m + 1, n + 1].view(np.float32)
    for f in range(term.size // 2):
        ar, ai, br, bi = a[2 * f], a[2 * f + 1], b[2 * f], b[2 * f + 1]
        cr, ci, dr, di = c[2 * f], c[2 * f + 1], d[2 * f], d[2 * f + 1]
        br, bi, dr, di = br - ar, bi - ai, dr - cr, di - ci
        ar, ai, cr, ci = ar + g * br, ai + g * bi, cr + g * dr, ci + g * di
        cr, ci, br, bi = cr - ar, ci - ai, br + e * (dr - br), bi + e * (di - bi)
        pr, pi, k = ar + e * cr, ai + e * ci, k0 + f * dk
        nr = slow * br - facing * k * pi + outward * cr
        ni = slow * bi + facing * k * pr + outward * ci
        term[2 * f] = pr * nr - pi * ni
        term[2 * f + 1] = pr * ni + pi * nr


@njit(cache=True, nogil=True)
def add_product(scale, a, b, out):
    """Add scale times a (2 F,) times b (2 F,) to out (2 F,)."""
    for f in range(out.size // 2):
        out[2 * f] += scale * (a[2 * f] * b[2 * f] - a[2 * f + 1] * b[2 * f + 1])
        out[2 * f + 1] += scale * (a[2 * f] * b[2 * f + 1] + a[2 * f + 1] * b[2 * f])


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
    count = 2 * out.shape[0]
    carrier, term = np.empty(count), np.empty(count)
    total, grainy = out.view(np.float64), grain_out.view(np.float64)
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
            facing = axis[0] * nx + axis[1] * ny
            side = (ox * nx + oy * ny) / max(off, 1e-9)
            slopes = np.float32(side / grid[0]), np.float32(facing / grid[2]), facing
            facet_echo(table, m, n0, (e, g), slopes, k0, dk, term)
            way = 2.0 * (along - reference)
            carriers(k0 * way, dk * way, carrier)
            add_product(2.0 * area, term, carrier, total)
            gi, gj = int(np.floor(radius * phi / step)) % size, int(np.floor(z / step)) % size
            grain, lag = grains[gi, gj, 0], grains[gi, gj, 1]
            if grain != 0.0:
                carriers(k0 * (way + lag), dk * (way + lag), carrier)
                add_product(2.0 * area * grain, term, carrier, grainy)


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


@njit(cache=True, nogil=True)
def crack_echo(waves, back, along, across, wavenumbers, depth):
    """Return the sum (F,) of products of waves (F, N, M) carried down to a depth and up again.

    ``along`` (N,) and ``across`` (M,) are squares of wavenumbers, ``along`` in the order of a
    Fourier transform; steep waves decay with the depth.
    """
    out = np.zeros(wavenumbers.size, dtype=np.complex128)
    count = along.size
    for f in range(wavenumbers.size):
        for n in range(count // 2 + 1):
            mirrored = (count - n) % count
            for m in range(across.size):
                square = wavenumbers[f] * wavenumbers[f] - along[n] - across[m]
                down = np.sqrt(abs(square))
                way = 2.0 * depth * down
                if square > 0.0:
                    carried = 2.0 * down * complex(-np.sin(way), np.cos(way))
                elif way < 40.0:
                    carried = complex(-2.0 * down * np.exp(-way), 0.0)
                else:
                    continue
                product = waves[f, n, m] * back[f, n, m]
                if mirrored != n:
                    product += waves[f, mirrored, m] * back[f, mirrored, m]
                out[f] += carried * product
    return out
