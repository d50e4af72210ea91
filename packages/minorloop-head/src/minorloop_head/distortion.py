"""Distortion of a lens, for numbers, arrays and compiled loops."""

from __future__ import annotations

from typing import Any

DISTORTION = ("k1", "k2", "k3", "p1", "p2")
"""Names of the coefficients of distortion, in the order of all arrays of them."""


def distorted(
    x: Any, y: Any, k1: float, k2: float, k3: float, p1: float, p2: float
) -> tuple[Any, Any, Any, Any, Any]:
    """Return normalised coordinates x, y after the distortion of a lens, and their derivatives.

    The derivatives are those of the first by x, of the first by y, which is that of the second by
    x, and of the second by y. Arguments are numbers or arrays; the compiled loops use this function
    too (`minorloop_head._geometry_kernels`).

    References
    ----------
    Brown, Close-range camera calibration, 1971, with the signs and names of OpenCV.
    """
    square = x * x + y * y
    scale = 1.0 + square * (k1 + square * (k2 + square * k3))
    growth = 2.0 * (k1 + square * (2.0 * k2 + square * 3.0 * k3))
    aside, down = 2.0 * p1 * y + 2.0 * p2 * x, 2.0 * p1 * x + 2.0 * p2 * y
    return (
        scale * x + p1 * (2.0 * x * y) + p2 * (square + 2.0 * x * x),
        scale * y + p1 * (square + 2.0 * y * y) + p2 * (2.0 * x * y),
        scale + growth * x * x + aside + 4.0 * p2 * x,
        growth * x * y + down,
        scale + growth * y * y + aside + 4.0 * p1 * y,
    )
