"""Cracks in a mission: traced in the looks around, seen again from nearer, and scanned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import uniform_filter1d

from minorloop.arrays import FloatArray
from minorloop.geometry import wall_distance, wall_lengths, wrapped
from minorloop.inspection.crackdepth import CrackDepth, crack_depth, crack_finding, crack_map
from minorloop.inspection.findings import Finding
from minorloop.inspection.unrolled import Patch, WallMap
from minorloop.studies.mission_crew import RADIUS, Crew, Photo
from minorloop.studies.mission_ears import scan
from minorloop.studies.mission_steps import centre, focus, look_nearer, pick
from minorloop.twins.pipe import Crack
from minorloop.vision.cracks import TracedCrack, trace_cracks
from minorloop.vision.defects import Findings

CLOSER, KNOWN = (6.0, 10.0), {"high": 0.25, "low": 0.12}
"""How much nearer a course is looked at, in mm, until it is seen; heights of a ridge that suffice
where it is not seen by the usual ones, now that it is known where to look."""
MOST = 3
"""Things like cracks that are gone to in all."""
BESIDE, SHARED = 0.6e-3, 0.5
"""How far apart two courses may run, in metres, and over which share of the shorter, to be one."""
TEXEL, MARGIN = 0.05e-3, 0.6e-3
"""Of the map of a crack: size of a texel, and what is shown around, in metres."""
LONGER = 1.1
"""How many times as long as by the nearer look a crack is by another, for that to be its course."""
EVEN = 0.5e-3
"""Length over which the width of a crack is averaged, in metres."""


@dataclass(frozen=True, eq=False)
class SeenCrack:
    """A crack that a mission reports.

    Parameters
    ----------
    traced : TracedCrack
        By the nearer look.
    course : TracedCrack
        By whichever look shows it longest.
    widest : (2,) array
        Phi and z where it was scanned.
    width : float
        There, in metres.
    found : CrackDepth
        What the echoes told.
    photo : Photo
        In which it is seen from nearer.
    wall : WallMap
        The wall about it.
    """

    traced: TracedCrack
    course: TracedCrack
    widest: FloatArray
    width: float
    found: CrackDepth
    photo: Photo
    wall: WallMap

    @property
    def finding(self) -> Finding:
        """Its line in the table."""
        return crack_finding(self.course.places, self.width, self.found, RADIUS)


def traces_of(looks: Findings, **heights: float) -> tuple[TracedCrack, ...]:
    """What looks like a crack in an acquisition, away from what looks like holes.

    Parameters
    ----------
    looks : Findings
        The acquisition.
    **heights
        ``high`` and ``low`` of `trace_cracks`.
    """
    if looks.wall is None:
        return ()
    holes = [(float(h.place[0]), float(h.place[1]), h.diameter) for h in looks.holes]
    return trace_cracks(looks.wall.brightest, looks.wall.window, RADIUS, apart=holes, **heights)


def likely(
    traces: Sequence[TracedCrack], tried: Sequence[TracedCrack]
) -> list[tuple[TracedCrack, int]]:
    """Courses that were not tried, in how many looks each was seen, the surest first."""
    groups: list[list[TracedCrack]] = []
    for trace in sorted(traces, key=lambda trace: -trace.length):
        for group in groups:
            if one_course(trace.places, group[0].places):
                group.append(trace)
                break
        else:
            groups.append([trace])
    groups.sort(key=lambda group: -sum(trace.length * trace.contrast for trace in group))
    return [
        (group[0], len(group))
        for group in groups
        if not any(one_course(group[0].places, other.places) for other in tried)
    ]


def one_course(one: FloatArray, other: FloatArray) -> bool:
    """Whether two courses (N, 2) and (M, 2) are those of one crack."""
    off = _between(one, other)
    shares = (off.min(axis=1) < BESIDE).mean(), (off.min(axis=0) < BESIDE).mean()
    return bool(max(shares) > SHARED)


def examined(crew: Crew, trace: TracedCrack, looks: int) -> SeenCrack | None:
    """Go to a course, trace it from nearer, and scan across it; None where it is not seen again."""
    middle = trace.places[len(trace.places) // 2]
    many = f"{looks} look{'s' if looks > 1 else ''}"
    pick(crew, middle, f"a line of {1e3 * trace.length:.1f} mm in {many}")
    centre(crew, middle)
    focus(crew)
    again, photo = _again(crew, trace, middle)
    if not again or photo is None:
        crew.say("trace", "not seen again from nearer; not counted as a crack")
        return None
    best = max(again, key=lambda other: other.length)
    # The nearer look may end before the crack does.
    course = trace if trace.length > LONGER * best.length else best
    widest, width = _widest(best)
    words = f"{1e3 * course.length:.1f} mm long, {1e3 * width:.2f} mm at its widest"
    crew.say("trace", f"a crack, {words}")
    _, ear, bursts = scan(crew, (float(widest[0]), float(widest[1])))
    crew.head.sway = None
    found = crack_depth(bursts, ear, best.places, width)
    deep = f", {1e3 * found.depth:.2f} mm deep" if np.isfinite(found.depth) else ""
    crew.say("measure", f"{found.verdict}{deep}")
    patch = _patch(course.places)
    wall = crack_map(course.places, width, found, tuple(widest.tolist()), patch)
    return SeenCrack(best, course, widest, width, found, photo, wall)


def _again(
    crew: Crew, trace: TracedCrack, middle: FloatArray
) -> tuple[list[TracedCrack], Photo | None]:
    """What is seen of a course from nearer, and the photo of it."""
    for by in CLOSER:
        near, photo = look_nearer(crew, middle, by)
        for lines in (traces_of(near), traces_of(near, **KNOWN)):
            again = [line for line in lines if one_course(line.places, trace.places)]
            if again:
                return again, photo
    return [], None


def crack_figures(cracks: Sequence[SeenCrack], truth: Crack) -> dict[str, Any]:
    """How far from the truth cracks are; NaN where none is it.

    Parameters
    ----------
    cracks : sequence of SeenCrack
        As reported; one that lies on the true one is it, any other is false.
    truth : Crack
        For scoring only.
    """
    course, widths = _true(truth)
    right = [one for one in cracks if one_course(one.course.places, course)]
    figures: dict[str, Any] = {
        "crack_found": bool(right),
        "false_cracks": len(cracks) - len(right),
        "crack_measured": any(np.isfinite(one.found.depth) for one in right),
    }
    names = (
        "crack_length_error_pct",
        "crack_width_error_pct",
        "crack_off_mm",
        "crack_depth_error_mm",
    )
    if not right:
        return figures | dict.fromkeys(names, np.nan)
    best = max(right, key=lambda one: one.course.length)
    off = _between(best.course.places, course)
    length = float(wall_lengths(course, RADIUS)[-1])
    there = widths[int(np.argmin(_between(best.widest[None], course)[0]))]
    values = (
        100 * abs(best.course.length / length - 1),
        100 * abs(best.width / there - 1),
        1e3 * float(np.median(off.min(axis=1))),
        1e3 * abs(best.found.depth - truth.depth),
    )
    return figures | dict(zip(names, map(float, values), strict=True))


def _between(one: npt.ArrayLike, other: npt.ArrayLike) -> FloatArray:
    """(N, M) metres between the places of two courses."""
    return wall_distance(np.asarray(one)[:, None], np.asarray(other)[None], RADIUS)


def _widest(traced: TracedCrack) -> tuple[FloatArray, float]:
    """Where a crack is widest, over half a millimetre, and how wide."""
    step = traced.length / max(len(traced.places) - 1, 1)
    even = uniform_filter1d(traced.widths, max(round(EVEN / step), 1), mode="nearest")
    best = int(np.argmax(even))
    return traced.places[best], float(even[best])


def _patch(places: FloatArray) -> Patch:
    """A rectangle about a course."""
    middle = float(places[len(places) // 2, 0])
    around = RADIUS * wrapped(places[:, 0] - middle)
    left, low = float(around.min()) - MARGIN, float(places[:, 1].min()) - MARGIN
    rows = int((float(places[:, 1].max()) + MARGIN - low) / TEXEL) + 1
    columns = int((float(around.max()) + MARGIN - left) / TEXEL) + 1
    return Patch(middle + left / RADIUS, low, rows, columns, RADIUS, TEXEL)


def _true(crack: Crack) -> tuple[FloatArray, FloatArray]:
    """Course (N, 2) and widths (N,) of a true crack, in steps of 50 um."""
    corners = np.array(crack.points)
    along = wall_lengths(corners, RADIUS)
    fine = np.arange(0.0, along[-1], 0.05e-3)
    course = [
        np.interp(fine, along, np.unwrap(corners[:, 0])),
        np.interp(fine, along, corners[:, 1]),
    ]
    return np.stack(course, axis=1), np.interp(fine, along, np.array(crack.widths))
