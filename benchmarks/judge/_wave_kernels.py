"""Compiled loops of the wave equation and of the field of a disc: arrays in, numbers out."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def step(pr, pz, vr, vz, vt, order, share, block, wall, mouth, floor, damp_r, damp_z):
    """Advance pressures and velocities by one step.

    Columns are r, rows z; row ``wall`` is the first below the wall and ``floor`` the first below
    the floor. Columns below ``mouth`` are in the pit. The pressure is pr + pz (Berenger's split for
    the absorbing layers), in units of rho c^2; velocities are in units of c. ``share`` is c dt/dx.
    ``block`` (mouth,) is the pressure of the incident and the reflected wave on the mouth.
    """
    columns = pr.shape[1]
    least = order // 2  # nearer to the axis a wave of this order is too small to matter
    for j in range(floor):
        last = columns if j < wall else mouth
        for i in range(least, last):
            here = pr[j, i] + pz[j, i]
            if i + 1 < last:
                slope = pr[j, i + 1] + pz[j, i + 1] - here
                vr[j, i + 1] = damp_r[2 * i + 2] * (vr[j, i + 1] - share * slope)
            if j + 1 < floor and (j + 1 < wall or i < mouth):
                slope = pr[j + 1, i] + pz[j + 1, i] - here
                if j + 1 == wall:
                    slope -= block[i]
                vz[j + 1, i] = damp_z[2 * j + 2] * (vz[j + 1, i] - share * slope)
            if order > 0:
                vt[j, i] = damp_r[2 * i + 1] * (vt[j, i] + share * order / (i + 0.5) * here)
    for j in range(floor):
        last = columns if j < wall else mouth
        for i in range(least, last):
            out = ((i + 1.0) * vr[j, i + 1] - i * vr[j, i] + order * vt[j, i]) / (i + 0.5)
            pr[j, i] = damp_r[2 * i + 1] * (pr[j, i] - share * out)
            pz[j, i] = damp_z[2 * j + 1] * (pz[j, i] - share * (vz[j + 1, i] - vz[j, i]))


@njit(cache=True, nogil=True)
def march(order, share, source, shape, shapes, wall, mouth, floor, damp_r, damp_z, out):
    """Drive a mouth with ``source`` (T,) times ``shape`` (mouth,); fill out (T, N).

    ``out`` is the velocity into the mouth, weighted by each of ``shapes`` (N, mouth).
    """
    rows, columns = damp_z.size // 2, damp_r.size // 2
    pr, pz, vt = np.zeros((rows, columns)), np.zeros((rows, columns)), np.zeros((rows, columns))
    vr, vz = np.zeros((rows, columns + 1)), np.zeros((rows + 1, columns))
    for t in range(source.size):
        block = source[t] * shape
        step(pr, pz, vr, vz, vt, order, share, block, wall, mouth, floor, damp_r, damp_z)
        for n in range(shapes.shape[0]):
            total = 0.0
            for i in range(mouth):
                total += shapes[n, i] * vz[wall, i]
            out[t, n] = total


@njit(cache=True, nogil=True)
def disc_field(off, along, rings, weights, lags, cosines, first, step_k, count, out):
    """Fill out (N, M, 3, F) with pressure and velocities of a disc, without exp(-i k along).

    Velocities are along the axis and away from it, in units of pressure over rho c. ``rings`` are
    radii of the disc with their ``weights`` and ``lags``; ``cosines`` are of angles round it.
    """
    for n in range(off.size):
        for m in range(along.size):
            for a in range(rings.size):
                for b in range(cosines.size):
                    side = off[n] - rings[a] * cosines[b]
                    lift = rings[a] * np.sqrt(max(1.0 - cosines[b] ** 2, 0.0))
                    far = np.sqrt(along[m] ** 2 + side * side + lift * lift)
                    path = far + lags[a] - along[m]
                    turn = np.exp(-1j * first * path)
                    turned = np.exp(-1j * step_k * path)
                    size = weights[a] / (2.0 * np.pi * far * cosines.size)
                    ahead, aside = along[m] / far, side / far
                    for f in range(count):
                        k = first + f * step_k
                        p = 1j * k * size * turn
                        v = p * (1.0 + 1.0 / (1j * k * far))
                        out[n, m, 0, f] += p
                        out[n, m, 1, f] += v * ahead
                        out[n, m, 2, f] += v * aside
                        turn *= turned


@njit(cache=True, nogil=True)
def field_at(table, grid, first, step_k, origin, axis, points, normals, pressure, velocity):
    """Fill pressure and normal velocity (N, F) at points (N, 3) of a beam, without its carrier.

    ``grid`` is the step off the axis, the first distance along it and its step. The carrier that is
    left out is exp(-i k d) with d the distance ``grid[1]`` along the axis.
    """
    for n in range(points.shape[0]):
        along = 0.0
        for c in range(3):
            along += (points[n, c] - origin[c]) * axis[c]
        side = np.empty(3)
        off = 0.0
        for c in range(3):
            side[c] = points[n, c] - origin[c] - along * axis[c]
            off += side[c] ** 2
        off = np.sqrt(off)
        ahead, aside = 0.0, 0.0
        for c in range(3):
            ahead += normals[n, c] * axis[c]
            if off > 0:
                aside += normals[n, c] * side[c] / off
        x, y = off / grid[0], (along - grid[1]) / grid[2]
        i, j = int(x), int(y)
        if i + 1 >= table.shape[0] or j < 0 or j + 1 >= table.shape[1]:
            pressure[n, :] = 0.0
            velocity[n, :] = 0.0
            continue
        s, t = x - i, y - j
        turn = np.exp(-1j * first * (along - grid[1]))
        turned = np.exp(-1j * step_k * (along - grid[1]))
        for f in range(table.shape[3]):
            p, v, w = 0j, 0j, 0j
            for q in range(4):
                u = (s if q % 2 else 1.0 - s) * (t if q > 1 else 1.0 - t)
                p += u * table[i + q % 2, j + q // 2, 0, f]
                v += u * table[i + q % 2, j + q // 2, 1, f]
                w += u * table[i + q % 2, j + q // 2, 2, f]
            pressure[n, f] = p * turn
            velocity[n, f] = (v * ahead + w * aside) * turn
            turn *= turned
