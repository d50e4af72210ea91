"""Compiled loops that unroll images and light the wall: arrays in, arrays filled."""

from __future__ import annotations

import numpy as np
from numba import njit

from minorloop_head._geometry_kernels import distorted

_NEAR = 1e-4  # square of 10 mm
_BENT = 3.0
"""Largest square of a radius in the image over that after distortion: a fisheye of 120 degrees."""


@njit(cache=True, nogil=True)
def unroll(image, flat, phi, z, step, radius, rotation, position, lens, least):
    """Unroll an image, bilinearly; NaN where it does not show the wall.

    ``rotation`` (3, 3) and ``position`` (3,) of the camera in the pipe, ``lens`` as
    `calibrated_camera.numbers` has it, ``least`` pixels per metre.
    """
    rows, columns = flat.shape
    fx, fy, u0, v0, k1, k2, k3, p1, p2 = lens
    # Radii beyond which the polynomial of the lens may fold back into the image.
    limit = (max(u0, image.shape[1] - u0) / fx) ** 2 + (max(v0, image.shape[0] - v0) / fy) ** 2
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
            if min(fx, fy) * out < least * (x * x + y * y + along * along):
                continue
            a = (cx + rotation[2, 0] * along) / depth
            b = (cy + rotation[2, 1] * along) / depth
            if a * a + b * b > _BENT * limit:
                continue
            right, low, across, both, down = distorted(a, b, k1, k2, k3, p1, p2)
            if not across * down - both * both > 0.0:
                continue
            u, v = u0 + fx * right, v0 + fy * low
            # Written so that NaN (unknown pose) counts as outside.
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
