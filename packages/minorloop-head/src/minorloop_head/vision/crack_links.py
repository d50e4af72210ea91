"""Cut courses where lines cross, and join the parts that a scratch, a dent or a stain separates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from scipy.spatial.distance import cdist

from minorloop.arrays import BoolArray, FloatArray
from minorloop_head.vision import _line_kernels as kernels
from minorloop_head.vision.imaging import Image32

_REACH = 28.0
"""Longest gap in texels, 1.4 mm: a crossing at a small angle to a scratch of 0.2 mm is as long."""
_AHEAD = 0.5
"""Least cosine between the heading of a part and the way to the next: a crack turns less."""
_CROSSING, _CUT = 8.0, 4.0
"""Distance in texels below which two courses cross or branch, more than the distance of a line from
its course; and texels that are cut to either side: a path turns there."""
FEWEST = 8
"""Fewest texels of a course."""
_TOUCHING = 4.0
"""Gap in texels below which the way between two ends has no direction."""
_HEADING = 8
"""Texels whose chord is the heading of an end."""
_CORNER = 3
"""Texels cut at an end, since a path ends at a corner of a line."""
_FARTHEST = 60
"""Most texels for which a line is followed from an end, 3 mm: another part begins before."""
_NEAR, _FAINT = 16, 0.4
"""Texels at an end whose median height is that of the line there, and the share of it above which
the line goes on: half of the filter is beyond an end, and a crack is narrower at its tip."""
_BESIDE = 3
"""Texels from a course that belong to it."""


def cut_at_crossings(courses: Sequence[FloatArray]) -> list[FloatArray]:
    """Return courses (N, 2) in texels, cut where lines cross or branch, and at sharp corners.

    There the cheapest path may continue along another line.
    """
    parts = []
    for n, course in enumerate(courses):
        left = np.ones(len(course), dtype=bool)
        offs = [
            cdist(course, one).min(axis=1) - _CROSSING for k, one in enumerate(courses) if k != n
        ]
        for off in (*offs, _straightness(course) - _AHEAD):
            labels, count = ndimage.label(off < 0)
            for k in range(1, count + 1):
                at = int(np.argmin(np.where(labels == k, off, np.inf)))
                left &= np.hypot(*(course - course[at]).T) > _CUT
        labels, _ = ndimage.label(left)
        parts += [course[part] for (part,) in ndimage.find_objects(labels)]
    return [part for part in parts if len(part) >= FEWEST]


def _straightness(course: FloatArray) -> FloatArray:
    """Return the cosine (N,) of the angle between the ways before and after; 1 near the ends."""
    straight = np.ones(len(course))
    ways = course[_HEADING:] - course[:-_HEADING]
    before, after = ways[:-_HEADING], ways[_HEADING:]
    if len(after):
        size = np.hypot(*before.T) * np.hypot(*after.T)
        straight[_HEADING:-_HEADING] = (before * after).sum(axis=1) / np.maximum(size, 1e-9)
    return straight


def joined(courses: Sequence[FloatArray]) -> list[FloatArray]:
    """Return courses (N, 2) in texels, joined end to end where one continues another."""
    links = sorted(_links(courses))
    used: set[tuple[int, bool]] = set()
    chains = [[(n, False)] for n in range(len(courses))]
    owner = list(range(len(courses)))
    for _, one, other in links:
        if one in used or other in used or owner[one[0]] == owner[other[0]]:
            continue
        used |= {one, other}
        first, second = owner[one[0]], owner[other[0]]
        # The first chain must end at the link, and the second begin there.
        if chains[first][-1] != (one[0], not one[1]):
            chains[first] = _reversed(chains[first])
        if chains[second][0] != (other[0], other[1]):
            chains[second] = _reversed(chains[second])
        chains[first] += chains[second]
        for number, _turn in chains[second]:
            owner[number] = first
        chains[second] = []
    return [_concatenated(courses, chain) for chain in chains if chain]


def followed(
    courses: Sequence[FloatArray],
    heights: Image32,
    least: float,
    seen: BoolArray,
    margin: BoolArray,
) -> list[FloatArray]:
    """Return courses (N, 2) followed from both ends along the line, to its tips or to another.

    Parts that are too faint or too disturbed to be judged belong to the line that they continue.
    The height of a line halves where it ends, since half of the filter is beyond its end.

    Parameters
    ----------
    courses : sequence of (N, 2) arrays
        Rows and columns.
    heights : (rows, columns) array of float32
        Of the lines.
    least : float
        Least height of a line.
    seen : (rows, columns) array of bool
        Where the wall is seen.
    margin : (rows, columns) array of bool
        Where it is seen without a known height; a line that reaches it continues.
    """
    known = seen & ~margin
    heights = ndimage.maximum_filter(heights, 3)  # a line is between texels
    whole = [_clear(course[_CORNER : len(course) - _CORNER], heights) for course in courses]
    owner = np.zeros(heights.shape, dtype=np.int32)
    longest = sorted(range(len(whole)), key=lambda n: -len(whole[n]))
    for n in longest:
        _claim(owner, whole[n], n + 1)
    for n in longest:
        for _ in range(2):
            more = _followed(whole[n], heights, least, (known, seen), owner, n + 1)
            _claim(owner, more, n + 1)
            whole[n] = np.concatenate([whole[n], more])[::-1]
    return whole


def _clear(course: FloatArray, heights: Image32) -> FloatArray:
    """Return a course without the ends where its line has less than half of its height nearby."""
    i, j = np.clip(np.rint(course).astype(int), 0, np.array(heights.shape) - 1).T
    ends = heights[i, j][:_NEAR], heights[i, j][::-1][:_NEAR]
    first, last = (int(np.argmax(end > 0.5 * np.median(end))) for end in ends)
    return course[first : len(course) - last]


def _claim(owner: npt.NDArray[np.int32], course: FloatArray, own: int) -> None:
    """Mark the texels about a course that belong to no other."""
    for i, j in np.rint(course).astype(int):
        about = owner[
            max(i - _BESIDE, 0) : max(i + _BESIDE + 1, 0),
            max(j - _BESIDE, 0) : max(j + _BESIDE + 1, 0),
        ]
        about[about == 0] = own


def _followed(
    course: FloatArray,
    heights: Image32,
    least: float,
    view: tuple[BoolArray, BoolArray],
    owner: npt.NDArray[np.int32],
    own: int,
) -> FloatArray:
    """Return the texels (N, 2) of a line beyond the end of its course."""
    i, j = np.clip(np.rint(course[-_NEAR:]).astype(int), 0, np.array(heights.shape) - 1).T
    faintest = max(least, _FAINT * float(np.median(heights[i, j])))
    way = course[-1] - course[-1 - min(_HEADING, len(course) - 1)]
    out = np.empty((_FARTHEST, 2))
    count = kernels.follow(heights, *view, owner, own, course[-1], way, faintest, out)
    return out[:count]


def _links(
    courses: Sequence[FloatArray],
) -> list[tuple[float, tuple[int, bool], tuple[int, bool]]]:
    """Return costs and ends of possible links; an end is a course and whether it is its last."""
    ends = [(n, last) for n in range(len(courses)) for last in (False, True)]
    places, ways = [], []
    for n, last in ends:
        course = courses[n][::-1] if last else courses[n]
        way = course[0] - course[min(_HEADING, len(course) - 1)]
        places.append(course[0])
        ways.append(way / max(float(np.hypot(*way)), 1e-9))
    links = []
    for i, one in enumerate(ends):
        for j in range(i + 1, len(ends)):
            gap = places[j] - places[i]
            far = float(np.hypot(*gap))
            if ends[j][0] == one[0] or far > _REACH:
                continue
            ahead = gap / max(far, 1e-9)
            straight = -float(ways[i] @ ways[j])
            turns = [straight]
            if far > _TOUCHING:
                turns += [float(ways[i] @ ahead), -float(ways[j] @ ahead)]
            if min(turns) >= _AHEAD:
                links.append(((1.0 + far) * (1.5 - min(turns)), one, ends[j]))
    return links


def _reversed(chain: list[tuple[int, bool]]) -> list[tuple[int, bool]]:
    return [(n, not turn) for n, turn in reversed(chain)]


def _concatenated(courses: Sequence[FloatArray], chain: list[tuple[int, bool]]) -> FloatArray:
    """Return one course, with gaps filled in steps of about a texel."""
    whole = [courses[n][::-1] if turn else courses[n] for n, turn in chain]
    pieces = [whole[0]]
    for after in whole[1:]:
        start, stop = pieces[-1][-1], after[0]
        count = max(int(np.hypot(*(stop - start))), 1)
        share = np.arange(1, count)[:, None] / count
        pieces += [start + share * (stop - start), after]
    return np.concatenate(pieces)
