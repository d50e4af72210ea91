"""Compiled loops that fit round outlines to unrolled images: arrays in, numbers out.

A polar profile has ``RAYS`` rays; samples lie every ``SPACING`` texels from ``FIRST``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

RAYS = 48
FIRST = 2.0
SPACING = 0.5
SAMPLES = 64
_BANDS = (0.55, 0.4, 0.3, 0.25)
_HARMONICS = 5


@njit(cache=True, nogil=True)
def bilinear(image, x, y):
    """Image at column x and row y; NaN outside."""
    if not (x >= 0.0 and y >= 0.0 and x < image.shape[1] - 1 and y < image.shape[0] - 1):
        return np.nan
    j, i = int(x), int(y)
    s, t = x - j, y - i
    upper = (1.0 - s) * image[i, j] + s * image[i, j + 1]
    lower = (1.0 - s) * image[i + 1, j] + s * image[i + 1, j + 1]
    return (1.0 - t) * upper + t * lower


@njit(cache=True, nogil=True)
def _profiles(image, x, y, out):
    """Sample rays from (x, y) into out (RAYS, SAMPLES)."""
    for n in range(RAYS):
        angle = 2.0 * np.pi * n / RAYS
        c, s = np.cos(angle), np.sin(angle)
        for k in range(SAMPLES):
            r = FIRST + SPACING * k
            out[n, k] = bilinear(image, x + r * c, y + r * s)


@njit(cache=True, nogil=True)
def _rises(profiles, sign, out):
    """Rise of each profile over two texels, outwards for sign 1, into out."""
    for n in range(RAYS):
        for k in range(SAMPLES):
            out[n, k] = -1e9
            if 2 <= k < SAMPLES - 2:
                rise = profiles[n, k + 1] + profiles[n, k + 2]
                rise -= profiles[n, k - 1] + profiles[n, k - 2]
                if np.isfinite(rise):
                    out[n, k] = 0.5 * sign * rise


@njit(cache=True, nogil=True)
def _common_radius(rises, least, most, cap):
    """Radius at which most rays rise together."""
    best, at = -1e9, 0.5 * (least + most)
    for k in range(2, SAMPLES - 2):
        r = FIRST + SPACING * k
        if r < least or r > most:
            continue
        total = 0.0
        for n in range(RAYS):
            total += min(max(rises[n, k], 0.0), cap)
        if total > best:
            best, at = total, r
    return at


@njit(cache=True, nogil=True)
def _edges(rises, form, band, edges):
    """Steepest radius of each ray within a band about the form (RAYS,), into edges; NaN if none."""
    for n in range(RAYS):
        edges[n] = np.nan
        best, at = 0.02, -1
        for k in range(2, SAMPLES - 2):
            r = FIRST + SPACING * k
            if abs(r - form[n]) <= band * form[n] and rises[n, k] > best:
                best, at = rises[n, k], k
        if at >= 0:
            a, b, c = rises[n, at - 1], rises[n, at], rises[n, at + 1]
            shift = 0.0
            if a > -1e8 and c > -1e8 and a + c < 2.0 * b:
                shift = 0.5 * (a - c) / (a - 2.0 * b + c)
            edges[n] = FIRST + SPACING * (at + shift)


@njit(cache=True, nogil=True)
def _harmonics(edges, start):
    """Robust fit of 1, cos, sin, cos 2, sin 2 to the edges (Tukey's weights)."""
    fit = start.copy()
    for _ in range(5):
        scale = 0.0
        count = 0
        for n in range(RAYS):
            if np.isfinite(edges[n]):
                count += 1
        if count < 12:
            return fit, 0
        residuals = np.empty(count)
        m = 0
        for n in range(RAYS):
            if np.isfinite(edges[n]):
                residuals[m] = abs(edges[n] - _form(fit, n))
                m += 1
        scale = max(1.48 * np.median(residuals), 0.25)
        normal, right = np.zeros((_HARMONICS, _HARMONICS)), np.zeros(_HARMONICS)
        for n in range(RAYS):
            if not np.isfinite(edges[n]):
                continue
            off = (edges[n] - _form(fit, n)) / (4.7 * scale)
            if abs(off) >= 1.0:
                continue
            weight = (1.0 - off * off) ** 2
            angle = 2.0 * np.pi * n / RAYS
            basis = np.array(
                [1.0, np.cos(angle), np.sin(angle), np.cos(2 * angle), np.sin(2 * angle)]
            )
            for a in range(_HARMONICS):
                right[a] += weight * basis[a] * edges[n]
                for b in range(_HARMONICS):
                    normal[a, b] += weight * basis[a] * basis[b]
        for a in range(_HARMONICS):
            normal[a, a] += 1e-3
            right[a] += 1e-3 * fit[a]
        for a in range(3, _HARMONICS):
            normal[a, a] += 4.0
        fit = np.linalg.solve(normal, right)
    return fit, count


@njit(cache=True, nogil=True)
def _form(fit, n):
    """Radius of the fitted outline on ray n."""
    angle = 2.0 * np.pi * n / RAYS
    out = fit[0] + fit[1] * np.cos(angle) + fit[2] * np.sin(angle)
    return out + fit[3] * np.cos(2 * angle) + fit[4] * np.sin(2 * angle)


@njit(cache=True, nogil=True)
def _levels(profiles, n, edge):
    """Mean within 0.35 to 0.75 and from 1.2 to 1.5 of the edge of one ray."""
    inside, outside, count_in, count_out = 0.0, 0.0, 0, 0
    for k in range(SAMPLES):
        ratio = (FIRST + SPACING * k) / edge
        value = profiles[n, k]
        if not np.isfinite(value):
            continue
        if 0.35 <= ratio <= 0.75:
            inside += value
            count_in += 1
        elif 1.2 <= ratio <= 1.5:
            outside += value
            count_out += 1
    if count_in == 0 or count_out == 0:
        return np.nan, np.nan
    return inside / count_in, outside / count_out


@njit(cache=True, nogil=True)
def _half_level(profiles, n, edge, inside, outside):
    """Radius near the edge where the linear level is half way from inside to outside."""
    half = 0.5 * (np.exp(inside) + np.exp(outside))
    upwards = outside > inside
    best, at = 1e9, np.nan
    for k in range(SAMPLES - 1):
        a, b = np.exp(profiles[n, k]), np.exp(profiles[n, k + 1])
        if not (np.isfinite(a) and np.isfinite(b)):
            continue
        if (upwards and a <= half < b) or (not upwards and a >= half > b):
            r = FIRST + SPACING * (k + (half - a) / (b - a))
            if abs(r - edge) < best:
                best, at = abs(r - edge), r
    if best > 0.3 * edge:
        return np.nan
    return at


@njit(cache=True, nogil=True)
def outline(image, x, y, sign, least, most, out):
    """Fit a round outline near (x, y) and describe it.

    ``image`` is logarithmic, ``sign`` 1 for dark and -1 for bright, ``least`` and ``most`` bound
    the radius in texels. ``out`` (10,) takes x, y, radius, relative size of the second harmonic,
    relative scatter of the edges, share of rays whose edge is on the outline, and contrasts at
    10, 25 and 50 % of the rays, and the level inside.
    """
    profiles, rises = np.empty((RAYS, SAMPLES)), np.empty((RAYS, SAMPLES))
    edges, form = np.empty(RAYS), np.empty(RAYS)
    fit = np.zeros(_HARMONICS)
    for turn in range(4):
        _profiles(image, x, y, profiles)
        _rises(profiles, sign, rises)
        if turn < 2:
            fit[:] = 0.0
            fit[0] = _common_radius(rises, least, most, 0.6)
        else:
            fit[1] = fit[2] = 0.0
        for n in range(RAYS):
            form[n] = max(_form(fit, n), 1.0)
        _edges(rises, form, _BANDS[turn], edges)
        fit, count = _harmonics(edges, fit)
        if count == 0 or not 0.3 * least < fit[0] < 2.0 * most:
            out[:] = np.nan
            return
        reach = np.sqrt(fit[1] ** 2 + fit[2] ** 2)
        shrink = min(1.0, 6.0 / max(reach, 1e-9))
        x, y = x + shrink * fit[1], y + shrink * fit[2]
    _describe(image, x, y, sign, fit, out)


@njit(cache=True, nogil=True)
def _describe(image, x, y, sign, fit, out):
    """Refine an outline at half level and say how good it is."""
    profiles, edges = np.empty((RAYS, SAMPLES)), np.empty(RAYS)
    _profiles(image, x, y, profiles)
    fit[1] = fit[2] = 0.0
    contrast, level = np.empty(RAYS), np.empty(RAYS)
    for n in range(RAYS):
        near = max(_form(fit, n), 1.0)
        inside, outside = _levels(profiles, n, near)
        contrast[n] = sign * (outside - inside)
        level[n] = inside
        edges[n] = np.nan
        if np.isfinite(contrast[n]) and contrast[n] > 0.05:
            edges[n] = _half_level(profiles, n, near, inside, outside)
    fit, count = _harmonics(edges, fit)
    if count == 0:
        out[:] = np.nan
        return
    seen, good, scatter = 0, 0, 0.0
    for n in range(RAYS):
        if not np.isfinite(contrast[n]):
            continue
        seen += 1
        if np.isfinite(edges[n]):
            off = abs(edges[n] - _form(fit, n)) / fit[0]
            scatter += min(off, 0.3)
            if off < 0.1:
                good += 1
        else:
            scatter += 0.3
    if seen < 24:
        out[:] = np.nan
        return
    known = np.sort(contrast[np.isfinite(contrast)])
    out[0], out[1] = x + fit[1], y + fit[2]
    out[2] = fit[0]
    out[3] = np.sqrt(fit[3] ** 2 + fit[4] ** 2) / fit[0]
    out[4] = scatter / seen
    out[5] = good / RAYS
    out[6], out[7] = known[int(0.1 * seen)], known[int(0.25 * seen)]
    out[8] = known[int(0.5 * seen)]
    out[9] = np.median(level[np.isfinite(contrast)])


@njit(cache=True, nogil=True)
def disc_levels(image, x, y, radius, out):
    """Into out (4,): mean and deviation within 0.7 radius, mean and deviation of a ring outside."""
    sums = np.zeros((2, 3))
    reach = 1.6 * radius
    for i in range(int(y - reach), int(y + reach) + 2):
        for j in range(int(x - reach), int(x + reach) + 2):
            if not (0 <= i < image.shape[0] and 0 <= j < image.shape[1]):
                continue
            value = image[i, j]
            if not np.isfinite(value):
                continue
            off = np.sqrt((j - x) ** 2 + (i - y) ** 2) / radius
            if off <= 0.7:
                part = 0
            elif 1.25 <= off <= 1.6:
                part = 1
            else:
                continue
            sums[part, 0] += 1.0
            sums[part, 1] += value
            sums[part, 2] += value * value
    for part in range(2):
        count = max(sums[part, 0], 1.0)
        mean = sums[part, 1] / count
        out[2 * part] = mean
        out[2 * part + 1] = np.sqrt(max(sums[part, 2] / count - mean * mean, 0.0))
