"""Compiled loops that shrink and unroll images and light the wall: arrays in, arrays filled."""

from __future__ import annotations

import numpy as np
from numba import njit

_NEAR = 1e-4  # square of 10 mm


@njit(cache=True, nogil=True)
def shrink(fine, coarse):
    """Fill coarse with means of 2 by 2 pixels of an image; NaN where one of them is."""
    for i in range(coarse.shape[0]):
        for j in range(coarse.shape[1]):
            coarse[i, j] = 0.25 * (
                fine[2 * i, 2 * j]
                + fine[2 * i + 1, 2 * j]
                + fine[2 * i, 2 * j + 1]
                + fine[2 * i + 1, 2 * j + 1]
            )


@njit(cache=True, nogil=True)
def unroll(image, flat, phi, z, step, radius, rotation, position, lens, least):
    """Unroll an image, bilinearly; NaN where it does not show the wall.

    ``rotation`` (3, 3) and ``position`` (3,) of the camera in the pipe, ``lens`` (focal length,
    u, v, k1, k2) in pixels, ``least`` pixels per metre.
    """
    rows, columns = flat.shape
    focal, u0, v0, k1, k2 = lens
    # Radii beyond which the polynomial of the lens may fold back into the image.
    limit = 1.1 * max(max(u0, image.shape[1] - u0), 0.0) ** 2
    limit = (limit + 1.1 * max(v0, image.shape[0] - v0) ** 2) / focal**2
    for j in range(columns):
        angle = phi + j * step / radius
        nx, ny = np.cos(angle), np.sin(angle)
        x, y = radius * nx - position[0], radius * ny - position[1]
        cx = rotation[0, 0] * x + rotation[1, 0] * y
        cy = rotation[0, 1] * x + rotation[1, 1] * y
        cz = rotation[0, 2] * x + rotation[1, 2] * y
        out = x * nx + y * ny
        for i in range(rows):
            along = z + i * step - position[2]
            flat[i, j] = np.nan
            depth = cz + rotation[2, 2] * along
            if depth <= 1e-4:
                continue
            if focal * out < least * (x * x + y * y + along * along):
                continue
            a = (cx + rotation[2, 0] * along) / depth
            b = (cy + rotation[2, 1] * along) / depth
            square = a * a + b * b
            if square > 1.5 * limit:
                continue
            scale = focal * (1.0 + square * (k1 + square * k2))
            u, v = u0 + scale * a, v0 + scale * b
            # Written so that NaN, of an unknown pose, counts as outside.
            if not (0.0 <= u < image.shape[1] - 1 and 0.0 <= v < image.shape[0] - 1):
                continue
            p, q = int(u), int(v)
            su, sv = u - p, v - q
            upper = (1.0 - su) * image[q, p] + su * image[q, p + 1]
            lower = (1.0 - su) * image[q + 1, p] + su * image[q + 1, p + 1]
            flat[i, j] = (1.0 - sv) * upper + sv * lower


@njit(cache=True, nogil=True)
def irradiance(light, phi, z, step, radius, leds):
    """Fill light (N, rows, columns) with cos / r^2 of LEDs (N, 3) in the pipe."""
    for j in range(light.shape[2]):
        angle = phi + j * step / radius
        nx, ny = np.cos(angle), np.sin(angle)
        for k in range(light.shape[0]):
            x, y = leds[k, 0] - radius * nx, leds[k, 1] - radius * ny
            face = -(x * nx + y * ny)
            flat = x * x + y * y
            for i in range(light.shape[1]):
                along = leds[k, 2] - z - i * step
                square = flat + along * along
                light[k, i, j] = _NEAR * face / (square * np.sqrt(square))


@njit(cache=True, nogil=True)
def cell_means(image, means):
    """Fill means (rows, columns) with the mean grey of square cells of an image."""
    side = image.shape[0] // means.shape[0]
    for i in range(means.shape[0]):
        for j in range(means.shape[1]):
            total = 0
            for p in range(i * side, (i + 1) * side):
                for q in range(j * side, (j + 1) * side):
                    total += image[p, q]
            means[i, j] = total / (side * side)


@njit(cache=True, nogil=True)
def row_steps(image, stride, steps):
    """Fill steps (H - 1,) with the median grey step from each row of an image to the next.

    Every ``stride``-th pixel counts; a count of each step finds the median without sorting.
    """
    counts = np.empty(256, np.int64)
    size = (image.shape[1] + stride - 1) // stride
    for i in range(steps.size):
        counts[:] = 0
        for j in range(0, image.shape[1], stride):
            counts[abs(np.int64(image[i + 1, j]) - np.int64(image[i, j]))] += 1
        low, below = 0, counts[0]
        while below <= (size - 1) // 2:
            low += 1
            below += counts[low]
        high = low
        while below <= size // 2:
            high += 1
            below += counts[high]
        steps[i] = 0.5 * (low + high)
