"""Compiled loops for the sound field in front of a disc: arrays in, arrays out."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, fastmath=True)
def _turned_sums(phases, turns, out):
    """Add sums over phases (2, Q) to out (F, 2), the phases turned once for each f."""
    a, b, c, s = phases[0], phases[1], turns[0], turns[1]
    for f in range(out.shape[0]):
        real = imaginary = 0.0
        for q in range(a.size):
            x, y = a[q], b[q]
            real += x
            imaginary += y
            a[q], b[q] = x * c[q] - y * s[q], x * s[q] + y * c[q]
        out[f, 0] += real
        out[f, 1] += imaginary


@njit(cache=True, nogil=True)
def rayleigh(off, along, rings, areas, lags, cosines, k0, dk, count):
    """Sum exp(i k (r - lag)) / r over the rings of a disc, without exp(i k along): (N, M, F).

    ``cosines`` are of angles spread evenly over half a turn; ``areas`` are of a whole ring.
    """
    table = np.zeros((off.size, along.size, count), dtype=np.complex128)
    parts = table.view(np.float64).reshape(off.size, along.size, count, 2)
    phases, turns = np.empty((2, cosines.size)), np.empty((2, cosines.size))
    for i in range(off.size):
        for j in range(along.size):
            for n in range(rings.size):
                fixed = along[j] ** 2 + off[i] ** 2 + rings[n] ** 2
                share = areas[n] / (2 * np.pi * cosines.size)
                for q in range(cosines.size):
                    r = np.sqrt(fixed - 2 * off[i] * rings[n] * cosines[q])
                    way = r - lags[n] - along[j]
                    phases[0, q] = share / r * np.cos(k0 * way)
                    phases[1, q] = share / r * np.sin(k0 * way)
                    turns[0, q], turns[1, q] = np.cos(dk * way), np.sin(dk * way)
                _turned_sums(phases, turns, parts[i, j])
    return table


@njit(cache=True, nogil=True)
def field_at(table, steps, origins, axes, starts, points, k0, dk, out):
    """Interpolate the field (K, F, N) of K beams at points (N, 3); phases from ``starts`` (K,)."""
    for b in range(origins.shape[0]):
        for q in range(points.shape[0]):
            x, y, z = (
                points[q, 0] - origins[b, 0],
                points[q, 1] - origins[b, 1],
                points[q, 2] - origins[b, 2],
            )
            along = x * axes[b, 0] + y * axes[b, 1] + z * axes[b, 2]
            off = np.sqrt(max(x * x + y * y + z * z - along * along, 0.0))
            u, v = off / steps[0], (along - steps[1]) / steps[2]
            i, j = int(u), int(np.floor(v))
            if i >= table.shape[0] - 1 or j < 0 or j >= table.shape[1] - 1:
                out[b, :, q] = 0.0
                continue
            s, t = u - i, v - j
            w00, w01, w10, w11 = (1 - s) * (1 - t), (1 - s) * t, s * (1 - t), s * t
            way = along - starts[b]
            phase, turn = np.exp(1j * k0 * way), np.exp(1j * dk * way)
            for f in range(out.shape[1]):
                field = (
                    w00 * table[i, j, f]
                    + w01 * table[i, j + 1, f]
                    + w10 * table[i + 1, j, f]
                    + w11 * table[i + 1, j + 1, f]
                )
                out[b, f, q] = field * phase
                phase *= turn


@njit(cache=True, nogil=True)
def wall_sum(table, steps, origins, axes, starts, spots, radius, half, step, k0, dk, out):
    """Sum of p^2 dS (K, F) over facets of a plain wall about the spots (K, 2) phi, z."""
    reach = int(np.ceil(half / step))
    for b in range(origins.shape[0]):
        for m in range(-reach, reach + 1):
            phi = spots[b, 0] + m * step / radius
            x, y = radius * np.cos(phi) - origins[b, 0], radius * np.sin(phi) - origins[b, 1]
            for n in range(-reach, reach + 1):
                if (m * m + n * n) * step * step > half * half:
                    continue
                z = spots[b, 1] + n * step - origins[b, 2]
                along = x * axes[b, 0] + y * axes[b, 1] + z * axes[b, 2]
                off = np.sqrt(max(x * x + y * y + z * z - along * along, 0.0))
                u, v = off / steps[0], (along - steps[1]) / steps[2]
                i, j = int(u), int(np.floor(v))
                if i >= table.shape[0] - 1 or j < 0 or j >= table.shape[1] - 1:
                    continue
                s, t = u - i, v - j
                w00, w01, w10, w11 = (1 - s) * (1 - t), (1 - s) * t, s * (1 - t), s * t
                way = 2.0 * (along - starts[b])
                phase, turn = np.exp(1j * k0 * way), np.exp(1j * dk * way)
                for f in range(out.shape[1]):
                    field = (
                        w00 * table[i, j, f]
                        + w01 * table[i, j + 1, f]
                        + w10 * table[i + 1, j, f]
                        + w11 * table[i + 1, j + 1, f]
                    )
                    out[b, f] += step * step * field * field * phase
                    phase *= turn


@njit(cache=True, nogil=True)
def floors(squares, first, turns, out):
    """Add sums over modes (D, K, F) of squares (K, F, M) times ``first`` (F, M) turned D times."""
    modes = squares.shape[2]
    term = np.empty(modes, dtype=np.complex128)
    for b in range(squares.shape[0]):
        for f in range(squares.shape[1]):
            for m in range(modes):
                term[m] = squares[b, f, m] * first[f, m]
            for d in range(out.shape[0]):
                total = 0j
                for m in range(modes):
                    total += term[m]
                    term[m] *= turns[f, m]
                out[d, b, f] += total


@njit(cache=True, nogil=True, fastmath=True)
def square_sum(pressure, area, out):
    """Sum over points of pressure squared (K, F, Q) times an area (Q,), into (K, F)."""
    for b in range(pressure.shape[0]):
        for f in range(pressure.shape[1]):
            row = pressure[b, f].view(np.float64)
            real = imaginary = 0.0
            for q in range(area.size):
                x, y = row[2 * q], row[2 * q + 1]
                real += area[q] * (x * x - y * y)
                imaginary += area[q] * 2.0 * x * y
            out[b, f] = complex(real, imaginary)


@njit(cache=True, nogil=True)
def turned(pressure, turn, out):
    """Pressure (K, F, Q) times turn (F, Q), its parts in single precision (2, K, F, Q)."""
    for b in range(pressure.shape[0]):
        for f in range(pressure.shape[1]):
            for q in range(pressure.shape[2]):
                value = pressure[b, f, q] * turn[f, q]
                out[0, b, f, q] = value.real
                out[1, b, f, q] = value.imag


@njit(cache=True, nogil=True)
def mode_squares(around, radial, wave, out):
    """Squares (K, F, M) of amplitudes from waves around rings (2, K, F, R, W)."""
    for b in range(out.shape[0]):
        for f in range(out.shape[1]):
            for m in range(out.shape[2]):
                w, real, imaginary = wave[m], 0.0, 0.0
                for r in range(radial.shape[1]):
                    real += radial[m, r] * around[0, b, f, r, w]
                    imaginary += radial[m, r] * around[1, b, f, r, w]
                out[b, f, m] = complex(real * real - imaginary * imaginary, 2 * real * imaginary)
