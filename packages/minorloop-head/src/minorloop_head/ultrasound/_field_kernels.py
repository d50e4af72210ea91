"""Compiled loops for the sound field in front of a disc, and for the fit of a pit to traces.

Arrays in, arrays out.

Spectra (..., 2, F) have their real parts before their imaginary ones, so that the loops over the
frequencies become loops of vectors.
"""

from __future__ import annotations

import numpy as np
from numba import njit

_STEPS = 4
"""Newton steps from the best trial: three reach the rounding error, and one is spare."""
_F = np.float32
_FARTHEST = 1.0  # m, beyond every table


@njit(cache=True, nogil=True, fastmath=True)
def _turned_sums(phases, turns, out):
    """Add sums over phases (2, Q) to out (2, F), the phases turned once for each f."""
    a, b, c, s = phases[0], phases[1], turns[0], turns[1]
    for f in range(out.shape[1]):
        real = imaginary = 0.0
        for q in range(a.size):
            x, y = a[q], b[q]
            real += x
            imaginary += y
            a[q], b[q] = x * c[q] - y * s[q], x * s[q] + y * c[q]
        out[0, f] += real
        out[1, f] += imaginary


@njit(cache=True, nogil=True)
def rayleigh(off, along, rings, areas, lags, cosines, k0, dk, count):
    """Sum exp(i k (r - lag)) / r over the rings of a disc, without exp(i k along): (N, M, 2, F).

    ``cosines`` are of angles spread evenly over half a turn; ``areas`` are of a whole ring.
    """
    table = np.zeros((off.size, along.size, 2, count))
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
                _turned_sums(phases, turns, table[i, j])
    return table


@njit(cache=True, nogil=True, fastmath=True)
def phases(first, step, out):
    """Fill out (2, F) with cosines and sines of ``first``, ``first + step``, and so on."""
    x, y, c, s = np.cos(first), np.sin(first), np.cos(step), np.sin(step)
    a, b = out[0], out[1]
    count, done = a.size, 1
    a[0], b[0] = x, y
    while done < count:  # those that are there give as many again
        for f in range(min(done, count - done)):
            x, y = a[f], b[f]
            a[done + f], b[done + f] = x * c - y * s, x * s + y * c
        c, s = c * c - s * s, 2.0 * c * s
        done *= 2


@njit(cache=True, nogil=True, fastmath=True)
def _look_up(table, steps, point, origin, axis, out):
    """Fill out (2, F) with the field of a beam at a point, and return the distance along the beam.

    The field lacks the phase along the beam. Beyond the table the distance exceeds ``_FARTHEST``.
    """
    x, y, z = point[0] - origin[0], point[1] - origin[1], point[2] - origin[2]
    along = x * axis[0] + y * axis[1] + z * axis[2]
    off = np.sqrt(max(x * x + y * y + z * z - along * along, 0.0))
    u, v = off / steps[0], (along - steps[1]) / steps[2]
    i, j = int(u), int(np.floor(v))
    if i >= table.shape[0] - 1 or j < 0 or j >= table.shape[1] - 1:
        return 2.0 * _FARTHEST
    s, t = u - i, v - j
    w00, w01, w10, w11 = (1 - s) * (1 - t), (1 - s) * t, s * (1 - t), s * t
    for part in range(2):
        a, b = table[i, j, part], table[i, j + 1, part]
        c, d, line = table[i + 1, j, part], table[i + 1, j + 1, part], out[part]
        for f in range(line.size):
            line[f] = w00 * a[f] + w01 * b[f] + w10 * c[f] + w11 * d[f]
    return along


@njit(cache=True, nogil=True, fastmath=True)
def _multiply(a, b, out):
    """Fill out (2, F) with the complex products of a and b (2, F)."""
    ax, ay, bx, by, x, y = a[0], a[1], b[0], b[1], out[0], out[1]
    for f in range(x.size):
        x[f], y[f] = ax[f] * bx[f] - ay[f] * by[f], ax[f] * by[f] + ay[f] * bx[f]


@njit(cache=True, nogil=True, fastmath=True)
def field_at(table, steps, origins, axes, starts, points, k0, dk, out):
    """Interpolate the field (K, N, 2, F) of K beams at points (N, 3); phases from ``starts`` (K,).

    It is zero where the table ends.
    """
    count = out.shape[3]
    field, turn = np.empty((2, count)), np.empty((2, count))
    for b in range(origins.shape[0]):
        for q in range(points.shape[0]):
            along, here = _look_up(table, steps, points[q], origins[b], axes[b], field), out[b, q]
            if along > _FARTHEST:
                for f in range(count):
                    here[0, f] = here[1, f] = 0.0
                continue
            way = along - starts[b]
            phases(k0 * way, dk * way, turn)
            _multiply(field, turn, here)


@njit(cache=True, nogil=True, fastmath=True)
def wall_sum(table, steps, origins, axes, starts, spots, radii, radius, half, step, k0, dk, out):
    """Add p^2 dS over facets of a wall about the spots (K, 2) phi, z to out (K, 2, F).

    ``radii`` (K, n, n) are the distances of the facets from the axis of a pipe of a ``radius``,
    n of them around and along it, the spot in their middle.
    """
    reach, count = int(np.ceil(half / step)), out.shape[2]
    field, turn, point = np.empty((2, count)), np.empty((2, count)), np.empty(3)
    for b in range(origins.shape[0]):
        for m in range(-reach, reach + 1):
            phi = spots[b, 0] + m * step / radius
            x_normal, y_normal = np.cos(phi), np.sin(phi)
            for n in range(-reach, reach + 1):
                if (m * m + n * n) * step * step > half * half:
                    continue
                r = radii[b, m + reach, n + reach]
                point[0], point[1] = r * x_normal, r * y_normal
                point[2] = spots[b, 1] + n * step
                along = _look_up(table, steps, point, origins[b], axes[b], field)
                if along > _FARTHEST:
                    continue
                way = 2.0 * (along - starts[b])
                phases(k0 * way, dk * way, turn)
                for f in range(count):
                    x, y = field[0, f], field[1, f]
                    real, imaginary = x * x - y * y, 2.0 * x * y
                    c, s = turn[0, f] * step * step, turn[1, f] * step * step
                    out[b, 0, f] += real * c - imaginary * s
                    out[b, 1, f] += real * s + imaginary * c


@njit(cache=True, nogil=True, fastmath=True)
def square_sum(pressure, area, out):
    """Add pressure squared (K, Q, 2, F) times an area (Q,) to out (K, 2, F)."""
    for b in range(pressure.shape[0]):
        for q in range(area.size):
            here = pressure[b, q]
            for f in range(out.shape[2]):
                x, y = here[0, f], here[1, f]
                out[b, 0, f] += area[q] * (x * x - y * y)
                out[b, 1, f] += area[q] * 2.0 * x * y


@njit(cache=True, nogil=True, fastmath=True)
def mode_squares(pressure, shape, scale, waves, odd, radial, wave, k0, dk, out):
    """Fill out (K, M, 2, F) with squares of the amplitudes of modes that a pressure excites.

    ``pressure`` (K, Q, 2, F), delayed by ``shape`` (Q,) and times ``scale``, is projected on
    ``waves`` (A, W) around each ring and then on ``radial`` (M, R), with ``wave`` (M,) of each
    mode. The points of a ring are a turn, of which A - 1 is a half; ``odd`` (W,) is 1 for sines.
    """
    half, rings, count = waves.shape[0] - 1, radial.shape[1], out.shape[3]
    turns = np.empty((shape.size, 2, count))
    # Single precision halves the work, with an error of 1e-6 of an echo.
    row, folded = np.empty((2, 2 * count), np.float32), np.empty((2, 2 * count), np.float32)
    around = np.empty((waves.shape[1], rings, 2 * count), np.float32)
    amplitude = np.empty((2, count))
    for q in range(shape.size):
        phases(k0 * shape[q], dk * shape[q], turns[q])
    for b in range(pressure.shape[0]):
        around[:] = 0.0
        for q in range(shape.size):
            r, a = q // (2 * half), q % (2 * half)
            if a > half:
                continue
            # A point and its mirror image: their sum on cosines, their difference on sines.
            mirror = q + 2 * (half - a) if 0 < a < half else q
            for n in range(2):
                p = mirror if n else q
                for f in range(count):
                    x, y = scale * pressure[b, p, 0, f], scale * pressure[b, p, 1, f]
                    row[n, f] = x * turns[p, 0, f] - y * turns[p, 1, f]
                    row[n, count + f] = x * turns[p, 1, f] + y * turns[p, 0, f]
            share = _F(0.5) if mirror == q else _F(1.0)
            for f in range(2 * count):
                folded[0, f] = share * (row[0, f] + row[1, f])
                folded[1, f] = row[0, f] - row[1, f]
            for w in range(waves.shape[1]):
                share, part = waves[a, w], odd[w]
                for f in range(2 * count):
                    around[w, r, f] += share * folded[part, f]
        for m in range(out.shape[1]):
            amplitude[:] = 0.0
            for r in range(rings):
                w, weight = wave[m], radial[m, r]
                for f in range(count):
                    amplitude[0, f] += weight * around[w, r, f]
                    amplitude[1, f] += weight * around[w, r, count + f]
            for f in range(count):
                x, y = amplitude[0, f], amplitude[1, f]
                out[b, m, 0, f], out[b, m, 1, f] = x * x - y * y, 2.0 * x * y


@njit(cache=True, nogil=True, fastmath=True)
def floors(squares, across, depth, step, k0, dk, out):
    """Add echoes (D, K, 2, F) of floors at depth, depth + step, ... to out.

    ``squares`` (K, M, 2, F) of amplitudes of modes with wavenumbers ``across`` (M,).
    """
    modes, count = across.size, out.shape[3]
    first, turns = np.empty((modes, 2, count)), np.empty((modes, 2, count))
    for m in range(modes):
        for f in range(count):
            k = k0 + f * dk
            down = np.sqrt(abs(k * k - across[m] ** 2))
            if k > across[m]:  # 2 i down exp(2 i down depth)
                first[m, 0, f] = -2.0 * down * np.sin(2.0 * down * depth)
                first[m, 1, f] = 2.0 * down * np.cos(2.0 * down * depth)
                turns[m, 0, f] = np.cos(2.0 * down * step)
                turns[m, 1, f] = np.sin(2.0 * down * step)
            else:  # it decays: the wavenumber along the pit is imaginary
                first[m, 0, f] = -2.0 * down * np.exp(-2.0 * down * depth)
                turns[m, 0, f] = np.exp(-2.0 * down * step)
                first[m, 1, f] = turns[m, 1, f] = 0.0
    term = np.empty((2, count))
    for b in range(squares.shape[0]):
        for m in range(modes):
            square, turn = squares[b, m], turns[m]
            for f in range(count):
                x, y = square[0, f], square[1, f]
                term[0, f] = x * first[m, 0, f] - y * first[m, 1, f]
                term[1, f] = x * first[m, 1, f] + y * first[m, 0, f]
            for d in range(out.shape[0]):
                echo = out[d, b]
                for f in range(count):
                    x, y = term[0, f], term[1, f]
                    echo[0, f] += x
                    echo[1, f] += y
                    term[0, f] = x * turn[0, f] - y * turn[1, f]
                    term[1, f] = x * turn[1, f] + y * turn[0, f]


@njit(cache=True, nogil=True, fastmath=True)
def best_shifts(product, wavenumbers, trials, turns, slip, shift):
    """Fill shift (K,) with the most likely distances of traces from the plane.

    A distance s maximises Re(sum product exp(-2 i k s)) - s^2 / (2 slip^2); ``product`` (K, 2, F)
    is the expected spectrum, conjugate, times the received one over the square of the noise. The
    best of ``trials`` (T,), with exp(2 i k s) in ``turns`` (T, 2, F), is improved by Newton steps.
    """
    k0, dk, count = wavenumbers[0], wavenumbers[1] - wavenumbers[0], wavenumbers.size
    turn = np.empty((2, count))
    for n in range(shift.size):
        best, s = -np.inf, 0.0
        for t in range(trials.size):
            score = 0.0
            for f in range(count):
                score += product[n, 0, f] * turns[t, 0, f] + product[n, 1, f] * turns[t, 1, f]
            score -= 0.5 * (trials[t] / slip) ** 2
            if score > best:
                best, s = score, trials[t]
        for _ in range(_STEPS):
            phases(2.0 * k0 * s, 2.0 * dk * s, turn)
            slope, bend = -s / slip**2, 1.0 / slip**2
            for f in range(count):
                x, y, k = product[n, 0, f], product[n, 1, f], wavenumbers[f]
                slope += 2.0 * k * (y * turn[0, f] - x * turn[1, f])
                bend += 4.0 * k * k * (x * turn[0, f] + y * turn[1, f])
            if bend > 0.0:
                s += min(max(slope / bend, -0.5 * slip), 0.5 * slip)
        shift[n] = s


@njit(cache=True, nogil=True, fastmath=True)
def residual_power(received, expected, wavenumbers, shift, power):
    """Fill power (K,) with the mean of |received - expected exp(2 i k shift)|^2 over F."""
    k0, dk, count = wavenumbers[0], wavenumbers[1] - wavenumbers[0], wavenumbers.size
    turn = np.empty((2, count))
    for n in range(shift.size):
        phases(2.0 * k0 * shift[n], 2.0 * dk * shift[n], turn)
        total = 0.0
        for f in range(count):
            x, y = expected[n, 0, f], expected[n, 1, f]
            real = received[n, 0, f] - x * turn[0, f] + y * turn[1, f]
            imaginary = received[n, 1, f] - x * turn[1, f] - y * turn[0, f]
            total += real * real + imaginary * imaginary
        power[n] = total / count
