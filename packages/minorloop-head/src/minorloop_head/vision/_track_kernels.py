"""Compiled loops that search for a patch of the wall: arrays in, arrays filled."""

from __future__ import annotations

import numpy as np
from numba import njit

_LEAST_SEEN = 0.7
"""Share of the patch that has to be seen. In 160 patches of the twin's wall (seeds 1000 to 1019),
4 % of the matches are more than 0.1 mm off where 70 % is seen, and 14 % where 40 % is; 3 % if all
of it is."""
_AT_ONCE = 8
"""Columns of a template that are multiplied at once."""
_WHITE = 250.0
"""Grey level from which a texel, a mean of four pixels, counts as saturated."""


@njit(cache=True, nogil=True)
def detail(flat, half, out):
    """Fill out with the logarithm of grey levels less its mean over a box of 2 half + 1 texels.

    The logarithm makes a sum of light and reflectance, of which the box takes the light that varies
    slowly: most of what moves with the lights. Saturated texels count as unseen; NaN stays.
    """
    rows, columns = flat.shape
    total = np.zeros((rows + 1, columns + 1))
    count = np.zeros((rows + 1, columns + 1))
    for i in range(rows):
        for j in range(columns):
            value, seen = 0.0, 0.0
            if flat[i, j] < _WHITE:  # false for NaN
                value, seen = np.log(flat[i, j] + 4.0), 1.0
            out[i, j] = value if seen > 0.0 else np.nan
            total[i + 1, j + 1] = value + total[i, j + 1] + total[i + 1, j] - total[i, j]
            count[i + 1, j + 1] = seen + count[i, j + 1] + count[i + 1, j] - count[i, j]
    for i in range(rows):
        top, end = max(i - half, 0), min(i + half + 1, rows)
        for j in range(columns):
            left, right = max(j - half, 0), min(j + half + 1, columns)
            n = count[end, right] - count[top, right] - count[end, left] + count[top, left]
            if n > 0.0:
                mean = total[end, right] - total[top, right] - total[end, left] + total[top, left]
                out[i, j] -= mean / n


@njit(cache=True, nogil=True, fastmath=True)
def _form_sums(seen, template, i, j, out):
    """Fill ``out[3:5]`` with the sums of t and t t over the texels of one place that are seen."""
    t, tt = np.float32(0), np.float32(0)
    for k in range(template.shape[0]):
        known, model = seen[i + k], template[k]
        for m in range(template.shape[1]):
            t += known[j + m] * model[m]
            tt += known[j + m] * model[m] * model[m]
    out[3], out[4] = t, tt


@njit(cache=True, nogil=True, fastmath={"contract"})
def _products(area, template, i, out):
    """Fill ``out`` with the sums of a t over the places of a row, all places at once.

    Eight columns of the template at once, so that a sum is read and written once for them. The
    template and ``out`` have a multiple of eight columns, and the area those of both together.
    """
    out[:] = 0.0
    for k in range(template.shape[0]):
        line = area[i + k]
        for m in range(0, template.shape[1], _AT_ONCE):
            a, t = line[m : m + out.size + _AT_ONCE], template[k, m : m + _AT_ONCE]
            t0, t1, t2, t3, t4, t5, t6, t7 = t[0], t[1], t[2], t[3], t[4], t[5], t[6], t[7]
            for j in range(out.size):
                four = out[j] + a[j] * t0 + a[j + 1] * t1 + a[j + 2] * t2 + a[j + 3] * t3
                out[j] = four + a[j + 4] * t4 + a[j + 5] * t5 + a[j + 6] * t6 + a[j + 7] * t7


@njit(cache=True, nogil=True)
def _boxes(known, filled):
    """Return the sums (3, H + 1, W + 1) from the corner: of texels seen, a, and a a."""
    rows, columns = known.shape
    box = np.zeros((3, rows + 1, columns + 1))
    for i in range(rows):
        row = np.zeros(3)
        for j in range(columns):
            value = np.float64(filled[i, j])
            row[0] += known[i, j]
            row[1] += value
            row[2] += value * value
            for c in range(3):
                box[c, i + 1, j + 1] = box[c, i, j + 1] + row[c]
    return box


@njit(cache=True, nogil=True)
def correlate(area, template, scores):
    """Fill scores with the normalised correlation of a template (n, m) and each place of an area.

    NaN texels of the area are left out of both; the score is -1 where less than 70 % is seen, or
    where nothing varies.
    """
    rows, columns = template.shape
    form = np.zeros((rows, -(-columns // _AT_ONCE) * _AT_ONCE), np.float32)
    form[:, :columns] = template
    products = np.empty(-(-scores.shape[1] // _AT_ONCE) * _AT_ONCE, np.float32)
    known = np.zeros(area.shape, np.float32)
    # What is beyond the area is multiplied by nothing, or gives no score.
    filled = np.zeros((area.shape[0], form.shape[1] + products.size), np.float32)
    total, count = 0.0, 0
    for i in range(area.shape[0]):
        for j in range(area.shape[1]):
            if np.isfinite(area[i, j]):
                total += area[i, j]
                count += 1
    middle = np.float32(total / max(count, 1))
    for i in range(area.shape[0]):
        for j in range(area.shape[1]):
            if np.isfinite(area[i, j]):
                known[i, j] = 1.0
                filled[i, j] = area[i, j] - middle
    sums = np.empty(6)
    whole = rows * columns
    box = _boxes(known, filled)
    t, tt = 0.0, 0.0
    for i in range(rows):
        for j in range(columns):
            t += template[i, j]
            tt += template[i, j] * template[i, j]
    for i in range(scores.shape[0]):
        _products(filled, form, i, products)
        for j in range(scores.shape[1]):
            scores[i, j] = -1.0
            for c in range(3):
                ends = box[c, i + rows, j + columns] - box[c, i, j + columns]
                sums[c] = ends - box[c, i + rows, j] + box[c, i, j]
            n = sums[0]
            if n < _LEAST_SEEN * whole:
                continue
            if n > whole - 0.5:
                sums[3], sums[4] = t, tt
            else:
                _form_sums(known, template, i, j, sums)
            sums[5] = products[j]
            va = sums[2] - sums[1] * sums[1] / n
            vt = sums[4] - sums[3] * sums[3] / n
            if va > 1e-3 * n * 0.01 and vt > 1e-6 * n:
                scores[i, j] = (sums[5] - sums[1] * sums[3] / n) / np.sqrt(va * vt)


@njit(cache=True, nogil=True)
def peak(scores, out):
    """Fill out (3,) with column, row and height of the highest score, by parabolas."""
    best, i0, j0 = -2.0, 0, 0
    for i in range(scores.shape[0]):
        for j in range(scores.shape[1]):
            if scores[i, j] > best:
                best, i0, j0 = scores[i, j], i, j
    out[0], out[1], out[2] = j0, i0, best
    if 0 < j0 < scores.shape[1] - 1:
        a, c = scores[i0, j0 - 1], scores[i0, j0 + 1]
        if a > -1.0 and c > -1.0 and a + c < 2.0 * best:
            out[0] += 0.5 * (a - c) / (a - 2.0 * best + c)
    if 0 < i0 < scores.shape[0] - 1:
        a, c = scores[i0 - 1, j0], scores[i0 + 1, j0]
        if a > -1.0 and c > -1.0 and a + c < 2.0 * best:
            out[1] += 0.5 * (a - c) / (a - 2.0 * best + c)


@njit(cache=True, nogil=True)
def second(scores, best, near):
    """Return the highest score farther than ``near`` cells from a peak (column, row, height)."""
    most = -1.0
    for i in range(scores.shape[0]):
        for j in range(scores.shape[1]):
            if max(abs(i - best[1]), abs(j - best[0])) > near and scores[i, j] > most:
                most = scores[i, j]
    return most


@njit(cache=True, nogil=True)
def vote(scores, ways, weights, out):
    """Fill out (r, r) with the weighted mean of scores (N, r, r) that one motion of the head gives.

    A shift of the first patch by (column, row) from the middle shifts patch k by ``ways[k]`` times
    that. Patches that are not seen at a shift are left out; -1 where they have half of the weight.
    """
    middle, whole = 0.5 * (out.shape[0] - 1), weights.sum()
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            total, seen = 0.0, 0.0
            for k in range(scores.shape[0]):
                x = middle + ways[k, 0, 0] * (j - middle) + ways[k, 0, 1] * (i - middle)
                y = middle + ways[k, 1, 0] * (j - middle) + ways[k, 1, 1] * (i - middle)
                p, q = int(np.floor(x)), int(np.floor(y))
                if p < 0 or q < 0 or p + 1 >= scores.shape[2] or q + 1 >= scores.shape[1]:
                    continue
                a, b = scores[k, q, p], scores[k, q, p + 1]
                c, d = scores[k, q + 1, p], scores[k, q + 1, p + 1]
                if min(min(a, b), min(c, d)) <= -1.0:
                    continue
                sx, sy = x - p, y - q
                value = (1 - sy) * ((1 - sx) * a + sx * b) + sy * ((1 - sx) * c + sx * d)
                total += weights[k] * max(value, 0.0)
                seen += weights[k]
            out[i, j] = total / seen if seen > 0.5 * whole else -1.0
