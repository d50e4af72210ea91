"""Trace cracks in acquisitions, tell one course from another, and say where to scan across one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.ndimage import uniform_filter1d

from minorloop.arrays import FloatArray
from minorloop.head.geometry import wall_distance, wrapped
from minorloop.head.reconstruction.depth_map import Patch
from minorloop.head.vision.cracks import TracedCrack, trace_cracks
from minorloop.head.vision.defects import Findings

AGAIN = {"high": 0.25, "low": 0.12}
"""Heights of a ridge that suffice where a course is not seen again by the usual ones: it is known
where to look."""
BESIDE, SHARED = 0.6e-3, 0.5
"""How far apart two courses may run, in metres, and over which share of the shorter, to be one."""
LONGER = 1.1
"""How many times as long as by the nearer look a crack is by another, for that to be its course:
the nearer look may end before the crack does."""
EVEN = 0.5e-3
"""Length over which the width of a crack is averaged, in metres."""
TEXEL, MARGIN = 0.05e-3, 0.6e-3
"""Of the map of a crack: size of a texel, and what is shown around, in metres."""


def traces_of(looks: Findings, radius: float, **heights: float) -> tuple[TracedCrack, ...]:
    """What looks like a crack in an acquisition, away from what looks like holes.

    Parameters
    ----------
    looks : Findings
        The acquisition.
    radius : float
        Of the pipe, in metres.
    **heights
        ``high`` and ``low`` of `trace_cracks`.
    """
    if looks.wall is None:
        return ()
    holes = [(float(h.place[0]), float(h.place[1]), h.diameter) for h in looks.holes]
    return trace_cracks(looks.wall.brightest, looks.wall.window, radius, apart=holes, **heights)


def traced_again(looks: Findings, course: FloatArray, radius: float) -> tuple[TracedCrack, ...]:
    """Traces of an acquisition that are those of a course (N, 2) which is known."""
    for traces in (traces_of(looks, radius), traces_of(looks, radius, **AGAIN)):
        same = tuple(trace for trace in traces if one_course(trace.places, course, radius))
        if same:
            return same
    return ()


def likely(
    traces: Sequence[TracedCrack], tried: Sequence[TracedCrack], radius: float
) -> list[tuple[TracedCrack, int]]:
    """Courses that were not tried, in how many looks each was seen, the surest first."""
    groups: list[list[TracedCrack]] = []
    for trace in sorted(traces, key=lambda trace: -trace.length):
        for group in groups:
            if one_course(trace.places, group[0].places, radius):
                group.append(trace)
                break
        else:
            groups.append([trace])
    groups.sort(key=lambda group: -sum(trace.length * trace.contrast for trace in group))
    return [
        (group[0], len(group))
        for group in groups
        if not any(one_course(group[0].places, other.places, radius) for other in tried)
    ]


def one_course(one: FloatArray, other: FloatArray, radius: float) -> bool:
    """Whether two courses (N, 2) and (M, 2) are those of one crack."""
    off = between(one, other, radius)
    shares = (off.min(axis=1) < BESIDE).mean(), (off.min(axis=0) < BESIDE).mean()
    return bool(max(shares) > SHARED)


def between(one: npt.ArrayLike, other: npt.ArrayLike, radius: float) -> FloatArray:
    """(N, M) metres along the wall between the places of two courses."""
    return wall_distance(np.asarray(one)[:, None], np.asarray(other)[None], radius)


def whole_course(near: TracedCrack, far: TracedCrack) -> TracedCrack:
    """Of a nearer and a farther look at one crack, that which shows its course."""
    return far if far.length > LONGER * near.length else near


def widest(traced: TracedCrack) -> tuple[FloatArray, float]:
    """Where a crack is widest, over half a millimetre, and how wide."""
    step = traced.length / max(len(traced.places) - 1, 1)
    even = uniform_filter1d(traced.widths, max(round(EVEN / step), 1), mode="nearest")
    best = int(np.argmax(even))
    return traced.places[best], float(even[best])


def patch_about(places: FloatArray, radius: float) -> Patch:
    """A rectangle of the wall about a course (N, 2)."""
    middle = float(places[len(places) // 2, 0])
    around = radius * wrapped(places[:, 0] - middle)
    left, low = float(around.min()) - MARGIN, float(places[:, 1].min()) - MARGIN
    rows = int((float(places[:, 1].max()) + MARGIN - low) / TEXEL) + 1
    columns = int((float(around.max()) + MARGIN - left) / TEXEL) + 1
    return Patch(middle + left / radius, low, rows, columns, radius, TEXEL)
