"""Trace cracks in acquisitions, find cracks and holes again, and choose where to scan a crack."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.ndimage import uniform_filter1d

from minorloop.arrays import FloatArray
from minorloop_head.geometry import wall_distance, wrapped
from minorloop_head.reconstruction.depth_map import Patch
from minorloop_head.vision.crack_evidence import LEAST_EVIDENCE
from minorloop_head.vision.cracks import TracedCrack, trace_cracks
from minorloop_head.vision.defects import Findings, Hole

SAME = 1.5e-3
"""Largest distance in metres between two views of one defect: more than the error between views
from two places, and less than the distance between two defects."""
AGAIN = LEAST_EVIDENCE - 2.0
"""Lower evidence, used if a known course is not found with the usual one: by assumption, an earlier
view makes a crack exp(2) = 7 times as likely."""
OPEN = 0.03e-3
"""Least median width in metres of a crack in a near view. A narrower line is a scratch: its ground
reflects light. At its widest place, noise makes a line of 0.01 mm as wide as 0.05 mm."""
BESIDE, _SHARED = 0.6e-3, 0.5
"""Largest distance in metres, over this share of the shorter, between two courses of one crack."""
_LONGER = 1.1
"""Ratio of lengths above which the far view of a crack gives its course: the near image may not
contain the whole crack."""
_EVEN = 0.5e-3
"""Length over which the width of a crack is averaged, in metres."""
TEXEL, MARGIN = 0.05e-3, 0.6e-3
"""Size of a texel of the map of a crack, and margin about the crack, in metres."""


def traces_of(
    found: Findings, radius: float, *, least: float = LEAST_EVIDENCE
) -> tuple[TracedCrack, ...]:
    """Trace cracks in an acquisition, except at the rims of holes.

    ``found``: the acquisition; ``radius``: of the pipe, in metres; ``least``: least evidence.
    """
    if found.wall is None:
        return ()
    holes = [(float(h.place[0]), float(h.place[1]), h.diameter) for h in found.holes]
    return trace_cracks(found.wall.stack, found.wall.window, radius, apart=holes, least=least)


def traced_again(found: Findings, course: FloatArray, radius: float) -> tuple[TracedCrack, ...]:
    """Return the traces of an acquisition from nearer that belong to a known course (N, 2)."""
    for traces in (traces_of(found, radius), traces_of(found, radius, least=AGAIN)):
        same = tuple(
            trace
            for trace in traces
            if one_course(trace.places, course, radius) and trace.width >= OPEN
        )
        if same:
            return same
    return ()


def likely(
    traces: Sequence[TracedCrack], tried: Sequence[TracedCrack], radius: float
) -> list[tuple[TracedCrack, int]]:
    """Return untried courses, surest first, each with its number of acquisitions."""
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
    """Whether two courses (N, 2) and (M, 2) belong to one crack."""
    off = between(one, other, radius)
    shares = (off.min(axis=1) < BESIDE).mean(), (off.min(axis=0) < BESIDE).mean()
    return bool(max(shares) > _SHARED)


def between(one: npt.ArrayLike, other: npt.ArrayLike, radius: float) -> FloatArray:
    """Return distances (N, M) along the wall between the places of two courses, in metres."""
    return wall_distance(np.asarray(one)[:, None], np.asarray(other)[None], radius)


def whole_course(near: TracedCrack, far: TracedCrack) -> TracedCrack:
    """Return the near view of a crack, or the far one if that is much longer."""
    return far if far.length > _LONGER * near.length else near


def widest(traced: TracedCrack) -> tuple[FloatArray, float]:
    """Return the widest place (2,) of a crack, averaged over half a millimetre, and its width."""
    step = traced.length / max(len(traced.places) - 1, 1)
    even = uniform_filter1d(traced.widths, max(round(_EVEN / step), 1), mode="nearest")
    best = int(np.argmax(even))
    return traced.places[best], float(even[best])


def patch_about(places: FloatArray, radius: float) -> Patch:
    """Return a rectangle of the wall about a course (N, 2)."""
    middle = float(places[len(places) // 2, 0])
    around = radius * wrapped(places[:, 0] - middle)
    left, low = float(around.min()) - MARGIN, float(places[:, 1].min()) - MARGIN
    rows = int((float(places[:, 1].max()) + MARGIN - low) / TEXEL) + 1
    columns = int((float(around.max()) + MARGIN - left) / TEXEL) + 1
    return Patch(middle + left / radius, low, rows, columns, radius, TEXEL)


def nearest(holes: Sequence[Hole], place: npt.ArrayLike, radius: float) -> Hole | None:
    """Return the hole nearest to phi and z (2,) in a pipe of a radius; None beyond `SAME`."""
    off = [float(wall_distance(hole.place, place, radius)) for hole in holes]
    best = min(range(len(holes)), key=off.__getitem__, default=None)
    return None if best is None or off[best] > SAME else holes[best]
