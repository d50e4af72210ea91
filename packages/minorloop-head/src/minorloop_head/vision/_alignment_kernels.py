"""Compiled loops that align patches of the wall with an image: arrays in, arrays filled."""

from __future__ import annotations

import numpy as np
from numba import njit

from minorloop_head._geometry_kernels import distorted

_FLAT = 1e-4
"""Least sum of squares of a patch's logarithms, per texel, for it to have texture: 1 % contrast."""
_FOLDED = 0.1
"""Least factor by which the distortion of a lens may scale an area."""


@njit(cache=True, nogil=True)
def _without_plane(values, side):
    """Subtract mean and slopes, those of the light, from (side * side,) values on a grid."""
    middle = 0.5 * (side - 1)
    mean, across, down, square = 0.0, 0.0, 0.0, 0.0
    for i in range(side):
        for j in range(side):
            value = values[i * side + j]
            mean += value
            across += value * (j - middle)
            down += value * (i - middle)
    for j in range(side):
        square += side * (j - middle) ** 2
    mean, across, down = mean / (side * side), across / square, down / square
    for i in range(side):
        for j in range(side):
            values[i * side + j] -= mean + across * (j - middle) + down * (i - middle)


@njit(cache=True, nogil=True)
def sample(image, point, lens, rotation, position, turns, moves, shift, values, slopes):
    """Sample an image at points (N, 3) of the wall; return whether it shows all of them.

    ``turns`` (2, 3, 3) and ``moves`` (2, 3) are the derivatives of ``rotation`` and ``position``
    by pan and tilt, ``shift`` (2,) the turn of both from row to row. Fills ``values`` (N,)
    and their derivatives ``slopes`` (2, N).
    """
    fx, fy, u0, v0, k1, k2, k3, p1, p2 = lens
    height, width = image.shape
    du, dv = np.empty(2), np.empty(2)
    for n in range(point.shape[0]):
        x = point[n, 0] - position[0]
        y = point[n, 1] - position[1]
        z = point[n, 2] - position[2]
        depth = rotation[0, 2] * x + rotation[1, 2] * y + rotation[2, 2] * z
        if not depth > 1e-4:
            return False
        a = (rotation[0, 0] * x + rotation[1, 0] * y + rotation[2, 0] * z) / depth
        b = (rotation[0, 1] * x + rotation[1, 1] * y + rotation[2, 1] * z) / depth
        moved_x, moved_y, across, both, down = distorted(a, b, k1, k2, k3, p1, p2)
        u, v = u0 + fx * moved_x, v0 + fy * moved_y
        # The distortion may fold points far outside back into the image.
        if not across * down - both * both > _FOLDED:
            return False
        for c in range(2):
            d, m = turns[c], moves[c]
            dx = (
                d[0, 0] * x + d[1, 0] * y + d[2, 0] * z
                - rotation[0, 0] * m[0] - rotation[1, 0] * m[1] - rotation[2, 0] * m[2]
            )  # fmt: skip
            dy = (
                d[0, 1] * x + d[1, 1] * y + d[2, 1] * z
                - rotation[0, 1] * m[0] - rotation[1, 1] * m[1] - rotation[2, 1] * m[2]
            )  # fmt: skip
            dz = (
                d[0, 2] * x + d[1, 2] * y + d[2, 2] * z
                - rotation[0, 2] * m[0] - rotation[1, 2] * m[1] - rotation[2, 2] * m[2]
            )  # fmt: skip
            da, db = (dx - a * dz) / depth, (dy - b * dz) / depth
            du[c], dv[c] = fx * (across * da + both * db), fy * (both * da + down * db)
        row = v - 0.5 * height
        u += row * (shift[0] * du[0] + shift[1] * du[1])
        v += row * (shift[0] * dv[0] + shift[1] * dv[1])
        if not (0.0 <= u < width - 1.0 and 0.0 <= v < height - 1.0):
            return False
        p, q = int(u), int(v)
        su, sv = u - p, v - q
        upper = image[q, p + 1] - image[q, p]
        lower = image[q + 1, p + 1] - image[q + 1, p]
        left = image[q + 1, p] - image[q, p]
        values[n] = image[q, p] + su * upper + sv * left + su * sv * (lower - upper)
        rightwards = upper + sv * (lower - upper)
        downwards = left + su * (lower - upper)
        for c in range(2):
            slopes[c, n] = rightwards * du[c] + downwards * dv[c]
    return True


@njit(cache=True, nogil=True)
def normalise(values, side):
    """Remove the plane of (N,) values and scale them to length 1; return their length before."""
    _without_plane(values, side)
    total = 0.0
    for n in range(values.size):
        total += values[n] * values[n]
    length = np.sqrt(total)
    if length > 0.0:
        for n in range(values.size):
            values[n] /= length
    return length


@njit(cache=True, nogil=True)
def _compared(image, points, side, lens, rotation, position, turns, moves, shift, values, slopes):
    """Fill normalised ``values`` and ``slopes`` of a patch, as `sample` does; return the length.

    It is 0 if the patch is not wholly in view, or has no texture.
    """
    if not sample(image, points, lens, rotation, position, turns, moves, shift, values, slopes):
        return 0.0
    length = normalise(values, side)
    return length if length * length > _FLAT * values.size else 0.0


@njit(cache=True, nogil=True)
def align(
    image, points, templates, side, lens, rotation, position, turns, moves, shift, scores, normal,
    slope,
):  # fmt: skip
    """Compare patches (P, N) at points (P, N, 3) with an image at a pose.

    Fills for each patch ``scores`` (P,), the correlation, NaN if it is not wholly in view, and the
    normal matrix ``normal`` (P, 2, 2) and ``slope`` (P, 2) of the squared difference of normalised
    greys by pan and tilt: a Gauss-Newton step solves sum(normal) step = sum(slope).
    """
    texels = points.shape[1]
    values, slopes = np.empty(texels), np.empty((2, texels))
    for p in range(points.shape[0]):
        scores[p] = np.nan
        normal[p], slope[p] = 0.0, 0.0
        length = _compared(
            image, points[p], side, lens, rotation, position, turns, moves, shift, values, slopes
        )
        if length == 0.0:
            continue
        score, along = 0.0, np.zeros(2)
        for c in range(2):
            _without_plane(slopes[c], side)
        for n in range(texels):
            score += values[n] * templates[p, n]
            for c in range(2):
                along[c] += slopes[c, n] * values[n]
        for n in range(texels):
            first = (slopes[0, n] - along[0] * values[n]) / length
            second = (slopes[1, n] - along[1] * values[n]) / length
            normal[p, 0, 0] += first * first
            normal[p, 0, 1] += first * second
            normal[p, 1, 1] += second * second
            slope[p, 0] += first * templates[p, n]
            slope[p, 1] += second * templates[p, n]
        normal[p, 1, 0] = normal[p, 0, 1]
        scores[p] = score


@njit(cache=True, nogil=True)
def align_each(
    image, points, templates, side, lens, rotation, position, turns, moves, steps, scores, normal,
    turned,
):  # fmt: skip
    """Align each patch (P, N) by itself with an image, from a pose, in a number of steps.

    Noise makes the slopes of the image larger than those of the wall, so that one Gauss-Newton
    step corrects less than half of the error. Fills ``scores`` (P,) and ``normal`` (P, 2, 2) as
    `align` does, and ``turned`` (P, 2), the turn from the pose to the best match of the patch.
    """
    slope, still = np.empty((1, 2)), np.zeros(2)
    for p in range(points.shape[0]):
        turned[p] = 0.0
        for _ in range(steps):
            a, b = turned[p]
            one = slice(p, p + 1)
            align(
                image, points[one], templates[one], side, lens,
                rotation + a * turns[0] + b * turns[1], position + a * moves[0] + b * moves[1],
                turns, moves, still, scores[one], normal[one], slope,
            )  # fmt: skip
            n = normal[p]
            det = n[0, 0] * n[1, 1] - n[0, 1] * n[0, 1]
            if not det > 0.0:  # also where it is not seen
                break
            turned[p, 0] += (n[1, 1] * slope[0, 0] - n[0, 1] * slope[0, 1]) / det
            turned[p, 1] += (n[0, 0] * slope[0, 1] - n[0, 1] * slope[0, 0]) / det


@njit(cache=True, nogil=True)
def search(image, points, templates, side, lens, rotations, positions, least, found):
    """Fill found (M,) with the mean correlation at poses, reduced if few patches are in view."""
    texels = points.shape[1]
    values, slopes = np.empty(texels), np.empty((2, texels))
    turns, moves, still = np.zeros((2, 3, 3)), np.zeros((2, 3)), np.zeros(2)
    for m in range(rotations.shape[0]):
        total, count = 0.0, 0
        for p in range(points.shape[0]):
            length = _compared(
                image, points[p], side, lens, rotations[m], positions[m], turns, moves, still,
                values, slopes,
            )  # fmt: skip
            if length == 0.0:
                continue
            for n in range(texels):
                total += values[n] * templates[p, n]
            count += 1
        found[m] = total / max(count, least)
