"""Compiled loops that draw features into the map of a wall, in place.

A map is (Z, P, 4) float32: albedo, slope around, slope along, share of the specular reflection.
``size`` is (texel around, texel along); the map wraps around and ends along.
"""

from __future__ import annotations

import numpy as np
from numba import njit


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
