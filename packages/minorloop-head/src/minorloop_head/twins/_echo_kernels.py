"""Compiled loops for echoes: arrays in, arrays out.

Positions are in metres in the pipe; a beam is a table (off, along, frequency) without its
carrier exp(i k along). The echo of a wall has real and imaginary parts apart, (2, F), in single
precision and in short loops that the compiler vectorises; its sum errs by 1e-6.
"""

from __future__ import annotations

import numpy as np
from numba import njit

_F = np.float32


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


@njit(cache=True, nogil=True, fastmath=True)
def _carriers(first, step, out):
    """Fill out (2, F) with the parts of exp(i (first + f step)) for each f."""
    real, imaginary = out[0], out[1]
    real[0], imaginary[0] = np.cos(first), np.sin(first)
    c, s, done = np.cos(step), np.sin(step), 1
    while done < real.size:  # those that are there give as many again
        a, b, turn, side = real[done:], imaginary[done:], _F(c), _F(s)
        for f in range(min(done, a.size)):
            a[f] = real[f] * turn - imaginary[f] * side
            b[f] = real[f] * side + imaginary[f] * turn
        c, s, done = c * c - s * s, 2.0 * c * s, 2 * done


@njit(cache=True, nogil=True, fastmath=True)
def _facet_echo(corners, weights, slopes, k, term):
    """Fill term (2, F) with 2 p dp/dn of one facet, interpolated between four ``corners`` (2, F).

    ``weights`` are the position in the cell off and along the axis; ``slopes`` the shares of the
    differences across the cell, off and along the axis, and of the carrier, in dp/dn; ``k`` (F,)
    the wavenumbers.
    """
    (e, g), (outward, slow, facing) = weights, slopes
    near, near_on, far, far_on = corners
    a_real, a_imaginary, b_real, b_imaginary = near[0], near[1], near_on[0], near_on[1]
    c_real, c_imaginary, d_real, d_imaginary = far[0], far[1], far_on[0], far_on[1]
    real, imaginary = term[0], term[1]
    for f in range(k.size):
        ar, ai, cr, ci = a_real[f], a_imaginary[f], c_real[f], c_imaginary[f]
        br, bi, dr, di = b_real[f] - ar, b_imaginary[f] - ai, d_real[f] - cr, d_imaginary[f] - ci
        ar, ai, cr, ci = ar + g * br, ai + g * bi, cr + g * dr, ci + g * di
        cr, ci, br, bi = cr - ar, ci - ai, br + e * (dr - br), bi + e * (di - bi)
        pr, pi = ar + e * cr, ai + e * ci
        nr = slow * br - facing * k[f] * pi + outward * cr
        ni = slow * bi + facing * k[f] * pr + outward * ci
        real[f], imaginary[f] = pr * nr - pi * ni, pr * ni + pi * nr


@njit(cache=True, nogil=True, fastmath=True)
def _add_product(scale, a, b, out):
    """Add scale times a (2, F) times b (2, F) to out (2, F)."""
    ar, ai, br, bi, real, imaginary = a[0], a[1], b[0], b[1], out[0], out[1]
    for f in range(ar.size):
        real[f] += scale * (ar[f] * br[f] - ai[f] * bi[f])
        imaginary[f] += scale * (ar[f] * bi[f] + ai[f] * br[f])


@njit(cache=True, nogil=True)
def echo_of_wall(
    table, grid, k0, dk, origin, axis, radius, half, step, water,
    bores, dents, texture, grains, cell, rough, reference,
    out, grain_out,
):  # fmt: skip
    """Add 2 p dp/dn over the facets of the wall about the spot, for each frequency.

    ``table`` is (off, along, 2, F). ``bores`` are (N, 5): phi, z, radius of the mouth, width and
    slope of the chamfer. ``out`` and ``grain_out`` are (F,) complex; the second takes the echoes of
    grains under the wall.
    """
    k = (k0 + dk * np.arange(out.size)).astype(np.float32)
    carrier, term = np.empty((2, k.size), np.float32), np.empty((2, k.size), np.float32)
    total, grainy = np.empty((2, k.size), np.float32), np.empty((2, k.size), np.float32)
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
        total[:], grainy[:] = 0.0, 0.0
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
            facing = axis[0] * nx + axis[1] * ny
            side = (ox * nx + oy * ny) / max(off, 1e-9)
            corners = table[m, n0], table[m, n0 + 1], table[m + 1, n0], table[m + 1, n0 + 1]
            slopes = _F(side / grid[0]), _F(facing / grid[2]), _F(facing)
            _facet_echo(corners, (_F(u - m), _F(v - n0)), slopes, k, term)
            way = 2.0 * (along - reference)
            _carriers(k0 * way, dk * way, carrier)
            _add_product(_F(2.0 * area), term, carrier, total)
            gi, gj = int(np.floor(radius * phi / step)) % size, int(np.floor(z / step)) % size
            grain, lag = grains[gi, gj, 0], grains[gi, gj, 1]
            if grain != 0.0:
                _carriers(k0 * (way + lag), dk * (way + lag), carrier)
                _add_product(_F(2.0 * area * grain), term, carrier, grainy)
        for f in range(k.size):
            out[f] += complex(total[0, f], total[1, f])
            grain_out[f] += complex(grainy[0, f], grainy[1, f])


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
    Fourier transform; steep waves decay with depth.
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
