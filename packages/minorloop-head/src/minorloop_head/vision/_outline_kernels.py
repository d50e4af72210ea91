"""Compiled loops that fit round outlines to unrolled images: arrays in, numbers out.

The weights of ``hole_weights.json`` are fitted to features that depend on these constants: fit them
anew after a change. Comparisons of values in comments are on 60 noisy discs with a radius of 8.5 to
11.5 texels (seeds 1000 to 1059).
"""

from __future__ import annotations

import numpy as np
from numba import njit

RAYS = 48
"""Number of rays of a polar profile: about one per texel of the outline of the smallest hole. With
24 the radius scatters by 0.42 %, with 48 and with 96 by 0.40 %."""
FIRST = 2.0
"""Radius of the first sample in texels; nearer to the middle all rays see the same texels."""
_SPACING = 0.5
"""Texels between samples. With 1 the radius scatters by 0.44 %, with 0.5 by 0.40 %, with 0.25 by
0.39 % in twice the time."""
SAMPLES = 64
"""Samples of a ray, up to 33.5 texels: 1.9 times the largest outline that is kept, 16 texels."""
_BANDS = (0.55, 0.4, 0.3, 0.25)
"""Bands about the outline in which edges are searched in each iteration, relative to its radius.
The first must hold the edges of an outline that begins 3 texels off: with 0.3 the radius scatters
by 4.2 %."""
_HARMONICS = 5
"""Numbers of an outline: the mean radius, two for its place and two for an ellipse, which is what
an oblique hole looks like."""
_RINGS = (1.0, 0.7, 1.35)
"""Radii at which rises are compared, relative to the outline: on it, inside and outside of the
search for its edge in the last iteration."""
_FAINT, _STEEP = 0.03, 0.25
"""Slopes below the first are noise and do not vote; slopes above the second are clipped to it, so
that glints do not outweigh a hole."""
_WALL, _LEAST_WALL = (1.45, 2.1), 30
"""Radii of the ring of wall about an outline, in radii of the outline, and its fewest texels."""
_TURNS, _FIRST_SCALE, _EVEN = 6, 0.3, 0.02
"""Iterations of the fit of the wall, and scale of its residuals: the first, and the least."""
_DEPARTED = 1.0
"""Limit to which departures from the wall are clipped: light 2.7 times as bright or as dark."""
OUT = 17
"""Number of values that `describe` returns."""
_ANGLES = 2.0 * np.pi * np.arange(RAYS) / RAYS
_BASIS = np.stack(
    [np.ones(RAYS), *(part(n * _ANGLES) for n in (1, 2) for part in (np.cos, np.sin))], axis=1
)
"""1, cos, sin, cos 2, sin 2 (RAYS, _HARMONICS) of the angle of each ray, computed once: they would
take half of the time of a fit."""


@njit(cache=True, nogil=True)
def vote(level, near, far, out):
    """Add the steepness of each edge to ``out``, at the centres of circles that it may be part of.

    ``level`` (rows, columns) is logarithmic, radii go from ``near`` to ``far`` pixels. An edge
    votes on both of its sides; edges fainter than noise do not vote.
    """
    rows, columns = level.shape
    for i in range(1, rows - 1):
        for j in range(1, columns - 1):
            x = 0.5 * (level[i, j + 1] - level[i, j - 1])
            y = 0.5 * (level[i + 1, j] - level[i - 1, j])
            steep = np.sqrt(x * x + y * y)
            if not steep > _FAINT:
                continue
            weight, x, y = min(steep, _STEEP), x / steep, y / steep
            radius = near
            while radius <= far:
                for side in (-radius, radius):
                    p, q = int(i + side * y + 0.5), int(j + side * x + 0.5)
                    if 0 <= p < rows and 0 <= q < columns:
                        out[p, q] += weight
                radius += 0.5


@njit(cache=True, nogil=True)
def _samples(radius):
    """Return the number of samples of a ray up to a radius, and two more."""
    return min(max(int(np.ceil((radius - FIRST) / _SPACING)) + 4, 8), SAMPLES)


@njit(cache=True, nogil=True)
def _profiles(images, x, y, count, out):
    """Sample rays from (x, y) in images (K, rows, columns) into out (K, RAYS, SAMPLES).

    The rays go as far as ``count``, and are NaN beyond and outside the images.
    """
    right, bottom = images.shape[2] - 1, images.shape[1] - 1
    for n in range(RAYS):
        c, s = _BASIS[n, 1], _BASIS[n, 2]
        out[:, n, count:] = np.nan
        for k in range(count):
            r = FIRST + _SPACING * k
            u, v = x + r * c, y + r * s
            if not (u >= 0.0 and v >= 0.0 and u < right and v < bottom):
                out[:, n, k] = np.nan
                continue
            j, i = np.uint64(u), np.uint64(v)
            a, b = u - j, v - i
            beside, below = j + np.uint64(1), i + np.uint64(1)
            for m in range(images.shape[0]):
                upper, lower = images[m, i], images[m, below]
                first = (1.0 - a) * upper[j] + a * upper[beside]
                out[m, n, k] = (1.0 - b) * first + b * ((1.0 - a) * lower[j] + a * lower[beside])


@njit(cache=True, nogil=True)
def _middle(values, count):
    """Return the median of the first numbers of values, which are sorted in place."""
    for a in range(1, count):
        value, b = values[a], a
        while b > 0 and values[b - 1] > value:
            values[b] = values[b - 1]
            b -= 1
        values[b] = value
    return 0.5 * (values[(count - 1) // 2] + values[count // 2])


@njit(cache=True, nogil=True)
def _rise(ray, k, sign):
    """Return the rise of a ray at sample k over two texels; its size for sign 0."""
    rise = 0.5 * (ray[k + 1] + ray[k + 2] - ray[k - 1] - ray[k - 2])
    return abs(rise) if sign == 0.0 else sign * rise


@njit(cache=True, nogil=True)
def _rises(profiles, sign, samples, out):
    """Fill out (RAYS, SAMPLES) with the median rise over the images.

    ``profiles`` is (K, RAYS, SAMPLES). Edges that move from image to image, as reflections and
    shadows do, leave no rise.
    """
    values = np.empty(profiles.shape[0])
    for n in range(RAYS):
        for k in range(SAMPLES):
            out[n, k] = -1e9
            if not 2 <= k < samples - 2:
                continue
            for m in range(values.size):
                ray = profiles[m, n]
                values[m] = _rise(ray, k, sign)
            middle = _middle(values, values.size)
            if np.isfinite(middle):
                out[n, k] = middle


@njit(cache=True, nogil=True)
def _common_radius(rises, least, most, cap):
    """Return the radius at which most rays rise together."""
    best, at = -1e9, 0.5 * (least + most)
    for k in range(2, SAMPLES - 2):
        r = FIRST + _SPACING * k
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
    """Fill edges with the steepest radius of each ray in a band about the form; NaN if none."""
    for n in range(RAYS):
        edges[n] = np.nan
        best, at = 0.02, -1
        for k in range(2, SAMPLES - 2):
            r = FIRST + _SPACING * k
            if abs(r - form[n]) <= band * form[n] and rises[n, k] > best:
                best, at = rises[n, k], k
        if at >= 0:
            a, b, c = rises[n, at - 1], rises[n, at], rises[n, at + 1]
            shift = 0.0
            if a > -1e8 and c > -1e8 and a + c < 2.0 * b:
                shift = 0.5 * (a - c) / (a - 2.0 * b + c)
            edges[n] = FIRST + _SPACING * (at + shift)


@njit(cache=True, nogil=True)
def _solved(matrix, right):
    """Solve positive definite equations in place; LAPACK's routine takes seconds to compile."""
    size = right.size
    for k in range(size):
        for i in range(k + 1, size):
            share = matrix[i, k] / matrix[k, k]
            right[i] -= share * right[k]
            for j in range(k, size):
                matrix[i, j] -= share * matrix[k, j]
    for k in range(size - 1, -1, -1):
        for j in range(k + 1, size):
            right[k] -= matrix[k, j] * right[j]
        right[k] /= matrix[k, k]
    return right


@njit(cache=True, nogil=True)
def _harmonics(edges, start):
    """Fit 1, cos, sin, cos 2, sin 2 to the edges, robustly (Tukey's weights)."""
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
        scale = max(1.48 * _middle(residuals, count), 0.25)
        normal, right = np.zeros((_HARMONICS, _HARMONICS)), np.zeros(_HARMONICS)
        for n in range(RAYS):
            if not np.isfinite(edges[n]):
                continue
            off = (edges[n] - _form(fit, n)) / (4.7 * scale)
            if abs(off) >= 1.0:
                continue
            weight = (1.0 - off * off) ** 2
            for a in range(_HARMONICS):
                right[a] += weight * _BASIS[n, a] * edges[n]
                for b in range(_HARMONICS):
                    normal[a, b] += weight * _BASIS[n, a] * _BASIS[n, b]
        for a in range(_HARMONICS):
            normal[a, a] += 1e-3
            right[a] += 1e-3 * fit[a]
        for a in range(3, _HARMONICS):
            normal[a, a] += 4.0
        fit = _solved(normal, right)
    return fit, count


@njit(cache=True, nogil=True)
def _form(fit, n):
    """Return the radius of the fitted outline on ray n."""
    out = fit[0] + fit[1] * _BASIS[n, 1] + fit[2] * _BASIS[n, 2]
    return out + fit[3] * _BASIS[n, 3] + fit[4] * _BASIS[n, 4]


@njit(cache=True, nogil=True)
def _levels(profiles, n, edge):
    """Return the means of one ray within 0.35 to 0.75 and from 1.2 to 1.5 of the edge."""
    inside, outside, count_in, count_out = 0.0, 0.0, 0, 0
    first = max(int((0.35 * edge - FIRST) / _SPACING) - 1, 0)
    for k in range(first, min(int((1.5 * edge - FIRST) / _SPACING) + 2, SAMPLES)):
        ratio = (FIRST + _SPACING * k) / edge
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
    """Return the radius near the edge where the linear level is half way to outside."""
    half = 0.5 * (np.exp(inside) + np.exp(outside))
    upwards = outside > inside
    best, at = 1e9, np.nan
    first = max(int((0.7 * edge - FIRST) / _SPACING) - 1, 0)
    b = np.exp(profiles[n, min(first, SAMPLES - 1)])
    for k in range(first, min(int((1.3 * edge - FIRST) / _SPACING) + 2, SAMPLES - 1)):
        a, b = b, np.exp(profiles[n, k + 1])
        if not (np.isfinite(a) and np.isfinite(b)):
            continue
        if (upwards and a <= half < b) or (not upwards and a >= half > b):
            r = FIRST + _SPACING * (k + (half - a) / (b - a))
            if abs(r - edge) < best:
                best, at = abs(r - edge), r
    if best > 0.3 * edge:
        return np.nan
    return at


@njit(cache=True, nogil=True)
def _wall_plane(image, x, y, radius, plane):
    """Fit level, slope along columns and along rows of the wall about (x, y), robustly.

    The wall is a ring of ``_WALL`` radii, within the image. Return whether it has enough texels.
    """
    plane[:] = 0.0
    rows, columns = image.shape
    near, far = (_WALL[0] * radius) ** 2, (_WALL[1] * radius) ** 2
    half = int(_WALL[1] * radius) + 1
    top, bottom = max(int(y) - half, 0), min(int(y) + half + 1, rows)
    left, right = max(int(x) - half, 0), min(int(x) + half + 1, columns)
    size = max((bottom - top) * (right - left), 0)
    off = np.empty(size)
    scale = np.inf
    for _ in range(_TURNS):
        normal, wanted, count = np.zeros((3, 3)), np.zeros(3), 0
        for i in range(top, bottom):
            for j in range(left, right):
                u, v = (j - x) / radius, (i - y) / radius
                square = (u * u + v * v) * radius * radius
                if not (near < square < far and np.isfinite(image[i, j])):
                    continue
                value = image[i, j]
                rest = value - plane[0] - plane[1] * u - plane[2] * v
                weight = 1.0 / (1.0 + (rest / scale) ** 2)
                off[count] = abs(rest)
                count += 1
                basis = (1.0, u, v)
                for a in range(3):
                    wanted[a] += weight * basis[a] * value
                    for b in range(3):
                        normal[a, b] += weight * basis[a] * basis[b]
        if count < _LEAST_WALL:
            return False
        # The first fit weighs all texels alike: there are no residuals yet.
        first = scale == np.inf
        scale = _FIRST_SCALE if first else 1.48 * np.median(off[:count]) + _EVEN
        for a in range(3):
            normal[a, a] += 1e-6
        plane[:] = _solved(normal, wanted)
    return True


@njit(cache=True, nogil=True)
def depart(images, x, y, radius, out):
    """Fill out (rows, columns) with the departure of images from the wall about a place.

    It is the maximum over all images, clipped to ``_DEPARTED``; 0 where the wall is not known.
    Return whether the wall about the place is in view.
    """
    out[:] = 0.0
    plane = np.empty(3)
    half = int(_WALL[1] * radius) + 1
    for m in range(images.shape[0]):
        if not _wall_plane(images[m], x, y, radius, plane):
            return False
        for i in range(max(int(y) - half, 0), min(int(y) + half + 1, out.shape[0])):
            for j in range(max(int(x) - half, 0), min(int(x) + half + 1, out.shape[1])):
                wall = plane[0] + (plane[1] * (j - x) + plane[2] * (i - y)) / radius
                off = abs(images[m, i, j] - wall)
                if off > out[i, j]:
                    out[i, j] = min(off, _DEPARTED)
    return True


@njit(cache=True, nogil=True)
def outline(images, x, y, sign, least, most, out):
    """Fit a round outline near (x, y) and describe it.

    ``images`` (K, rows, columns) are logarithmic, ``sign`` 1 for dark, -1 for bright and 0 for
    either, ``least`` and ``most`` bound the radius in texels. ``out`` (OUT,) is as in
    ``describe``; NaN without an outline.
    """
    profiles, rises = np.empty((images.shape[0], RAYS, SAMPLES)), np.empty((RAYS, SAMPLES))
    edges, form = np.empty(RAYS), np.empty(RAYS)
    fit = np.zeros(_HARMONICS)
    for turn in range(4):
        # With its harmonics the outline may extend beyond the mean radius.
        reach = most if turn < 2 else fit[0] + np.sqrt(2.0) * (abs(fit[3]) + abs(fit[4]))
        samples = _samples(reach * (1.0 + _BANDS[turn]))
        _profiles(images, x, y, samples, profiles)
        _rises(profiles, sign, samples, rises)
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
    describe(images, x, y, sign, fit[0], fit[3], fit[4], out)


@njit(cache=True, nogil=True)
def _rim(profiles, sign, fit, out):
    """Describe the rises at an outline, into out (12 to 15).

    They are the shares of rays with a rise in half of the images, with a rise in all, and with a
    rise of the other sign in half; and the rise at the outline less that inside and outside.
    """
    count = profiles.shape[0]
    values, sums = np.empty(count), np.zeros(3)
    half, every, other, seen = 0, 0, 0, 0
    for n in range(RAYS):
        form = max(_form(fit, n), 1.0)
        unseen = False
        for part in range(3):
            r = form * _RINGS[part]
            k0 = int(np.rint((r - FIRST) / _SPACING))
            for m in range(count):
                best, worst = -1e9, 1e9
                for k in range(max(k0 - 2, 2), min(k0 + 3, SAMPLES - 2)):
                    rise = _rise(profiles[m, n], k, sign)
                    best, worst = max(best, rise), min(worst, rise)
                values[m] = best
                if part == 0 and best < -worst:
                    values[m] = worst
            middle = _middle(values, count)
            if not (np.isfinite(middle) and abs(middle) < 1e6):
                unseen = True
                break
            sums[part] += min(abs(middle), 0.5)
            if part == 0:
                seen += 1
                half += middle > 0.1
                other += middle < -0.1
                every += values[0] > 0.1
        if unseen:
            continue
    seen = max(seen, 1)
    out[12], out[13], out[14] = half / seen, every / seen, other / seen
    out[15] = (sums[0] - max(sums[1], sums[2])) / seen


@njit(cache=True, nogil=True)
def describe(images, x, y, sign, radius, c, s, out):
    """Refine an outline, radius + c cos 2a + s sin 2a, at half level, and describe its quality.

    ``out`` (OUT,) takes x, y, radius, c, s, the relative scatter of the edges, the share of rays
    whose edge is on the outline, the contrast at 10, 25 and 50 % of the rays, the contrast of
    the means, and the mean level inside; NaN where fewer than half of the rays are seen. A ray
    has an edge where half of the images have one.
    """
    count = images.shape[0]
    profiles, edges = np.empty((count, RAYS, SAMPLES)), np.empty(RAYS)
    samples = _samples(1.9 * (radius + np.abs(c) + np.abs(s)) + 2.0)
    _profiles(images, x, y, samples, profiles)
    fit = np.array([radius, 0.0, 0.0, c, s])
    contrast, level = np.empty(RAYS), np.empty(RAYS)
    contrasts, levels, found = np.empty(count), np.empty(count), np.empty(count)
    for n in range(RAYS):
        near, held = max(_form(fit, n), 1.0), 0
        for m in range(count):
            inside, outside = _levels(profiles[m], n, near)
            contrasts[m], levels[m] = sign * (outside - inside), inside
            if sign == 0.0:
                contrasts[m] = abs(outside - inside)
            if contrasts[m] > 0.05:
                edge = _half_level(profiles[m], n, near, inside, outside)
                if np.isfinite(edge):
                    found[held] = edge
                    held += 1
        contrast[n] = _middle(contrasts, count)
        level[n] = _middle(levels, count)
        edges[n] = _middle(found, held) if 2 * held >= count and held > 0 else np.nan
    fit, _ = _harmonics(edges, fit)
    seen, good, scatter, total = 0, 0, 0.0, 0.0
    known = np.empty(RAYS)
    for n in range(RAYS):
        if not np.isfinite(contrast[n]):
            continue
        known[seen] = contrast[n]
        total += level[n]
        seen += 1
        off = 0.3
        if np.isfinite(edges[n]):
            off = min(abs(edges[n] - _form(fit, n)) / fit[0], 0.3)
        scatter += off
        if off < 0.1:
            good += 1
    if seen < RAYS // 2:
        out[:] = np.nan
        return
    _middle(known, seen)  # sorts them
    out[0], out[1], out[2] = x + fit[1], y + fit[2], fit[0]
    out[3], out[4] = fit[3], fit[4]
    out[5], out[6] = scatter / seen, good / seen
    out[7], out[8], out[9] = known[int(0.1 * seen)], known[int(0.25 * seen)], known[seen // 2]
    mean = 0.0
    for n in range(seen):
        mean += known[n]
    out[10], out[11] = mean / seen, total / seen
    _rim(profiles, sign, fit, out)
    out[16] = known[int(0.9 * seen)]
