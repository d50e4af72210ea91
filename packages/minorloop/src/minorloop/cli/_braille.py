"""Draw curves in a terminal with braille characters of two by four dots."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import groupby

_BLANK = 0x2800
_DOTS = ((0x01, 0x02, 0x04, 0x40), (0x08, 0x10, 0x20, 0x80))
"""Bits of the dots of a character, by column and by row from the top."""
_BETWEEN = 24
"""Dots drawn from a point to the next: no gaps in lines across half of the drawing."""


def scatter(
    series: Sequence[tuple[Sequence[float], Sequence[float]]], width: int, height: int
) -> list[str]:
    """Return lines of text with the points of each series joined in order, and their ranges.

    Points that are not finite are left out, and no line is drawn across them.
    """
    known = [piece for x, y in series for piece in _pieces(zip(x, y, strict=True))]
    points = [point for one in known for point in one]
    if not points:
        return []
    xs, ys = zip(*points, strict=True)
    cells = [[_BLANK] * width for _ in range(height)]
    across, down = 2 * width - 1, 4 * height - 1
    (left, right), (low, high) = ((min(each), max(each)) for each in (xs, ys))
    for one in known:
        placed = [
            (_place(a, left, right) * across, (1 - _place(b, low, high)) * down) for a, b in one
        ]
        _join(cells, placed)
    labels = {0: f"{high:.4g}", height - 1: f"{low:.4g}"}
    wide = max(map(len, labels.values()))
    rows = ["".join(map(chr, row)) for row in cells]
    lines = [f"{labels.get(k, ''):>{wide}} {row}" for k, row in enumerate(rows)]
    ends = f"{left:.4g}", f"{right:.4g}"
    gap = max(1, width - len(ends[0]) - len(ends[1]))
    return [*lines, f"{'':>{wide}} {ends[0]}{'':>{gap}}{ends[1]}"]


def _pieces(points: Iterable[tuple[float, float]]) -> list[list[tuple[float, float]]]:
    """Return the points between those that are not finite."""
    finite = groupby(points, key=lambda point: all(map(math.isfinite, point)))
    return [list(piece) for known, piece in finite if known]


def _join(cells: list[list[int]], placed: list[tuple[float, float]]) -> None:
    """Set the dots of a line through the places."""
    for (a, b), (c, d) in zip(placed, [*placed[1:], *placed[-1:]], strict=True):
        for k in range(_BETWEEN):
            share = k / _BETWEEN
            column, row = round(a + share * (c - a)), round(b + share * (d - b))
            cells[row // 4][column // 2] |= _DOTS[column % 2][row % 4]


def _place(value: float, low: float, high: float) -> float:
    return 0.5 if high == low else (value - low) / (high - low)
