"""Compiled loops that draw features into the map of a wall, and shade it: arrays in, arrays out.

The fields are those of `_camera_kernels`. Values of the texture are computed for all cells of a row
at once, since the compiler vectorises only long and plain loops: arrays (CELL, cells) have the
first pixels of all cells first, then the second ones.

A map is (Z, P, 4) float32: albedo, slope around, slope along, share of the specular reflection.
``size`` is (texel around, texel along); the map wraps around and ends along.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from minorloop_head.twins._camera_kernels import CELL, COMMON, PER_LED, unwrapped

_F = np.float32
_ZERO, _HALF, _ONE = _F(0.0), _F(0.5), _F(1.0)
_PART = _ONE / _F(CELL)
_UNUSED = (3, 5, 6)
"""Fields that the wall without bores does not need: blur, and slopes of the ray."""
_PLACE, _WIDTH, _OTHERS = 1, 2, 4  # fields: z, width of a pixel, light of the other walls


@njit(cache=True, nogil=True, fastmath=True)
def _lines_between(fields, row, edge, lines):
    """Fill lines (F, W) with the light along a row of pixels; edge (U,) is scratch."""
    i, share = row // CELL, _F(row % CELL) * _PART
    for f in range(_OTHERS, fields.shape[0]):
        if f in _UNUSED:
            continue
        upper, lower, line = fields[f, i], fields[f, i + 1], lines[f]
        for j in range(edge.size):
            edge[j] = upper[j] + share * (lower[j] - upper[j])
        for j in range(edge.size - 1):
            left, slope = edge[j], (edge[j + 1] - edge[j]) * _PART
            for k in range(CELL):
                line[j * CELL + k] = left + slope * _F(k)


@njit(cache=True, nogil=True, fastmath=True)
def _corners(fields, i, corners):
    """Fill corners (4, cells) with phi at those of a row of cells, without jumps."""
    for j in range(corners.shape[1]):
        a, b, c, d = unwrapped(fields, i, j)
        corners[0, j], corners[1, j], corners[2, j], corners[3, j] = a, b, c, d


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _cells(fields, row, corners, shapes, size, cells, level):
    """Fill for each cell of a row the numbers of its texels.

    ``cells`` (6, cells): column and its step from pixel to pixel, columns of the level, row and
    its step, last row; ``level`` (2, cells): its first texel, and texels in a row.
    """
    top = shapes.shape[0] - 1
    i, share = row // CELL, _F(row % CELL) * _PART
    for j in range(corners.shape[1]):
        left = fields[_WIDTH, i, j] + share * (fields[_WIDTH, i + 1, j] - fields[_WIDTH, i, j])
        ahead = fields[_WIDTH, i, j + 1], fields[_WIDTH, i + 1, j + 1]
        right = ahead[0] + share * (ahead[1] - ahead[0])
        wide, n = _HALF * (left + right) / size[0], 0
        while n < top and wide > _F(1.5):
            wide *= _HALF
            n += 1
        scale = _ONE / _F(1 << n)
        middle = _HALF - _HALF * scale  # texels of a coarser level sit between those below
        turn, along = _F(shapes[n, 2]), scale / size[1]
        a = (corners[0, j] + share * (corners[2, j] - corners[0, j])) * scale / size[2]
        b = (corners[1, j] + share * (corners[3, j] - corners[1, j])) * scale / size[2]
        cells[0, j] = a + (_ONE - np.floor(a / turn)) * turn - middle
        cells[1, j], cells[2, j] = (b - a) * _PART, turn
        left = fields[_PLACE, i, j] + share * (fields[_PLACE, i + 1, j] - fields[_PLACE, i, j])
        ahead = fields[_PLACE, i, j + 1], fields[_PLACE, i + 1, j + 1]
        right = ahead[0] + share * (ahead[1] - ahead[0])
        cells[3, j], cells[4, j] = left * along - middle, (right - left) * _PART * along
        cells[5, j] = _F(shapes[n, 1] - 1)
        level[0, j], level[1, j] = shapes[n, 0], shapes[n, 2] + 1


@njit(cache=True, nogil=True, fastmath=True)
def _texels(cells, level, part, where):
    """Fill ``where`` (CELL, cells) with the texel up and left of each pixel, and ``part`` (2,).

    ``part`` (2, CELL, cells) is the distance of the pixel to the right of it, and below.
    """
    x0, x_step, turn, y0, y_step, last = cells[0], cells[1], cells[2], cells[3], cells[4], cells[5]
    first, width = level[0], level[1]
    for k in range(CELL):
        x, y, at = part[0, k], part[1, k], where[k]
        for j in range(x.size):
            # Within a cell phi may pass pi, by less than a turn either way.
            column = x0[j] + x_step[j] * _F(k)
            column = column - turn[j] if column >= turn[j] else column
            x[j] = column - turn[j] if column >= turn[j] else column
        for j in range(x.size):
            y[j] = min(max(y0[j] + y_step[j] * _F(k), _ZERO), last[j])
        for j in range(x.size):
            at[j] = first[j] + np.int32(y[j]) * width[j] + np.int32(x[j])
        for j in range(x.size):
            x[j] -= _F(np.int32(x[j]))
        for j in range(x.size):
            y[j] -= _F(np.int32(y[j]))


@njit(cache=True, nogil=True, fastmath=True)
def _look_up(texels, level, part, where, look):
    """Fill look (4, W) with albedo, slopes and gloss along a row."""
    albedo, slope_around, slope_along, gloss = look[0], look[1], look[2], look[3]
    for j in range(where.shape[1]):
        width = np.uint64(level[1, j])
        for k in range(CELL):
            u, here = np.uint64(j * CELL + k), np.uint64(where[k, j])
            below = here + width
            sx, sy = part[0, k, j], part[1, k, j]
            pa, pb = texels[here], texels[here + np.uint64(1)]
            pc, pd = texels[below], texels[below + np.uint64(1)]
            wd = sx * sy
            wb, wc = sx - wd, sy - wd
            wa = _ONE - sx - wc
            albedo[u] = wa * pa[0] + wb * pb[0] + wc * pc[0] + wd * pd[0]
            slope_around[u] = wa * pa[1] + wb * pb[1] + wc * pc[1] + wd * pd[1]
            slope_along[u] = wa * pa[2] + wb * pb[2] + wc * pc[2] + wd * pd[2]
            gloss[u] = wa * pa[3] + wb * pb[3] + wc * pc[3] + wd * pd[3]


_EXACT = {"nnan", "ninf", "nsz"}
"""Allowed assumptions of the compiler, with which each product, quotient and root is still rounded:
fused products and estimates of reciprocals differ between processors."""


# Without a check of each divisor, loops that divide become loops of vectors too.
@njit(cache=True, nogil=True, fastmath=_EXACT, error_model="numpy")
def _radiance(lines, look, metal, out):
    """Compute the radiance along a row."""
    around, along = _ONE / metal[2], _ONE / metal[3]
    peak, ambient, diffuse = metal[1] * around * along / _F(np.pi), metal[4], metal[0]
    albedo, a, b, gloss, others = look[0], look[1], look[2], look[3], lines[_OTHERS]
    for u in range(out.size):
        white = albedo[u] * diffuse
        out[u] = ambient * white * others[u]
        albedo[u] = white / np.sqrt(_ONE + a[u] * a[u] + b[u] * b[u])
    for first in range(COMMON, lines.shape[0], PER_LED):
        en, ea, ez = lines[first], lines[first + 1], lines[first + 2]
        p, q, weight = lines[first + 3], lines[first + 4], lines[first + 5]
        for u in range(out.size):
            face = max(en[u] - (a[u] * ea[u] + b[u] * ez[u]), _ZERO)
            s, t = (p[u] + a[u]) * around, (q[u] + b[u]) * along
            wide = _ONE + s * s + t * t
            out[u] = out[u] + albedo[u] * face + peak * gloss[u] * weight[u] / (wide * wide)


@njit(cache=True, nogil=True)
def shade(fields, texels, shapes, size, metal, radiance):
    """Fill radiance with that of the wall, without its bores and cracks.

    ``size`` is (texel around, texel along, angle of a texel), ``metal`` (diffuse, specular,
    roughness around, roughness along, ambient), all float32.
    """
    count = fields.shape[2] - 1
    lines = np.empty((fields.shape[0], radiance.shape[1]), np.float32)
    look = np.empty((4, radiance.shape[1]), np.float32)
    edge, corners = np.empty(count + 1, np.float32), np.empty((4, count), np.float32)
    cells, level = np.empty((6, count), np.float32), np.empty((2, count), np.int32)
    part, where = np.empty((2, CELL, count), np.float32), np.empty((CELL, count), np.int32)
    for row in range(radiance.shape[0]):
        if row % CELL == 0:
            _corners(fields, row // CELL, corners)
        _cells(fields, row, corners, shapes, size, cells, level)
        _texels(cells, level, part, where)
        _look_up(texels, level, part, where, look)
        _lines_between(fields, row, edge, lines)
        _radiance(lines, look, metal, radiance[row])


@njit(cache=True, nogil=True)
def add_dent(surface, size, x0, z0, width, height):
    """Add the slopes of a Gaussian bump at x0 around and z0 along."""
    rows, columns = surface.shape[:2]
    reach = 4.0 * width
    first, last = int(np.floor((z0 - reach) / size[1])), int(np.ceil((z0 + reach) / size[1]))
    left, right = int(np.floor((x0 - reach) / size[0])), int(np.ceil((x0 + reach) / size[0]))
    for i in range(max(first, 0), min(last, rows - 1) + 1):
        y = i * size[1] - z0
        for j in range(left, right + 1):
            x = j * size[0] - x0
            slope = -height / width**2 * np.exp(-0.5 * (x * x + y * y) / width**2)
            surface[i, j % columns, 1] += slope * x
            surface[i, j % columns, 2] += slope * y


@njit(cache=True, nogil=True)
def add_scratch(surface, size, x0, z0, angle, length, width, slope, albedo, bend):
    """Add the flanks of a groove whose course is a parabola."""
    rows, columns = surface.shape[:2]
    c, s = np.cos(angle), np.sin(angle)
    half = 0.5 * length
    reach = 2.0 * width + 0.5 * abs(bend) * half * half
    wide, high = half * abs(c) + reach, half * abs(s) + reach
    for i in range(
        max(int((z0 - high) / size[1]), 0), min(int((z0 + high) / size[1]) + 1, rows - 1) + 1
    ):
        y = i * size[1] - z0
        for j in range(int(np.floor((x0 - wide) / size[0])), int((x0 + wide) / size[0]) + 2):
            x = j * size[0] - x0
            along = x * c + y * s
            across = y * c - x * s - 0.5 * bend * along * along
            if abs(along) > half:
                continue
            form = np.exp(-2.0 * (across / width) ** 2)
            tilt = 2.3 * slope * across / width * form
            k = j % columns
            surface[i, k, 1] -= tilt * s
            surface[i, k, 2] += tilt * c
            surface[i, k, 0] *= 1.0 + (albedo - 1.0) * form


@njit(cache=True, nogil=True)
def add_weld(surface, size, x0, z0, angle, length, width, height, pitch, ripple):
    """Add the slopes of a parabolic crown with ripples that lag in the middle of the bead."""
    rows, columns = surface.shape[:2]
    c, s = np.cos(angle), np.sin(angle)
    half, side = 0.5 * length, 0.5 * width
    wide, high = half * abs(c) + side * abs(s), half * abs(s) + side * abs(c)
    for i in range(
        max(int((z0 - high) / size[1]), 0), min(int((z0 + high) / size[1]) + 1, rows - 1) + 1
    ):
        y = i * size[1] - z0
        for j in range(int(np.floor((x0 - wide) / size[0])), int((x0 + wide) / size[0]) + 2):
            x = j * size[0] - x0
            along, across = x * c + y * s, (y * c - x * s) / side
            square = across * across
            if abs(along) > half or square > 1.0:
                continue
            phase = (along - side * square) / pitch
            steep = ripple * (1.0 - square) * (1.0 - 2.0 * (phase - np.floor(phase)))
            sink = -2.0 * across * (height / side + steep)
            k = j % columns
            surface[i, k, 1] += steep * c - sink * s
            surface[i, k, 2] += steep * s + sink * c


@njit(cache=True, nogil=True)
def add_dirt(surface, size, x0, z0, radius, albedo, softness, lobes):
    """Add a patch whose outline has lobes (N, 2): amplitude and phase of harmonics from 2."""
    rows, columns = surface.shape[:2]
    reach = radius * (1.0 + np.abs(lobes[:, 0]).sum()) + 3.0 * softness
    for i in range(
        max(int((z0 - reach) / size[1]), 0), min(int((z0 + reach) / size[1]) + 1, rows - 1) + 1
    ):
        y = i * size[1] - z0
        for j in range(int(np.floor((x0 - reach) / size[0])), int((x0 + reach) / size[0]) + 2):
            x = j * size[0] - x0
            angle, outline = np.arctan2(y, x), 1.0
            for n in range(lobes.shape[0]):
                outline += lobes[n, 0] * np.cos((n + 2) * angle + lobes[n, 1])
            inside = (outline * radius - np.hypot(x, y)) / softness
            share = 1.0 / (1.0 + np.exp(-4.0 * min(max(inside, -20.0), 20.0)))
            k = j % columns
            surface[i, k, 0] *= 1.0 + (albedo - 1.0) * share
            surface[i, k, 3] *= 1.0 - 0.7 * share
