"""Conversion between rad and m of the console, and degrees and millimetres of pages and pictures.

A position is pan and tilt about the middle, advance and roll.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TypeAlias

from minorloop.arrays import FloatArray

Position: TypeAlias = tuple[float, float, float, float]
"""Measured pan and tilt about the middle, advance and roll, in rad and m."""


def pair_of(values: FloatArray) -> tuple[float, float]:
    """Return two numbers of an array (2,)."""
    return float(values[0]), float(values[1])


def to_si(shown: Iterable[float]) -> Position:
    """Return a position in rad and m from one in degrees and mm."""
    pan, tilt, advance, roll = shown
    return math.radians(pan), math.radians(tilt), 1e-3 * advance, math.radians(roll)


def to_shown(position: Iterable[float]) -> Position:
    """Return a position in degrees and mm from one in rad and m."""
    pan, tilt, advance, roll = position
    return math.degrees(pan), math.degrees(tilt), 1e3 * advance, math.degrees(roll)


def mm(metres: float, digits: int = 4) -> float:
    """Return a length in mm, rounded for a message."""
    return round(1e3 * metres, digits)


def degrees(radians: float, digits: int = 4) -> float:
    """Return an angle in degrees, rounded for a message."""
    return round(math.degrees(radians), digits)
