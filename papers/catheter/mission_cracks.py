"""Cracks in a mission: traced in the views, traced again in a near view, and scanned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop_head.geometry import wall_lengths
from minorloop_head.procedures.probe_steps import counts_as_crack, scanned_crack
from minorloop_head.procedures.rig import InspectionRig
from minorloop_head.procedures.steps import Photo, centre, focus, near_view, pick
from minorloop_head.procedures.trace import (
    between,
    one_course,
    patch_about,
    traced_again,
    whole_course,
    widest,
)
from minorloop_head.reconstruction.depth_map import DepthMap
from minorloop_head.reconstruction.findings import Finding
from minorloop_head.twins.pipe import Crack
from minorloop_head.ultrasound.crack_depth import CrackDepth, crack_finding, crack_map
from minorloop_head.vision.cracks import TracedCrack
from papers.catheter.crack_scenes import fine_course
from papers.catheter.mission_scene import RADIUS

CLOSER = (6e-3, 10e-3)
"""Advances of the near views in metres, until the course is seen."""
MOST = 3
"""Most candidates for cracks that are visited."""


@dataclass(frozen=True, eq=False)
class SeenCrack:
    """A crack that a mission reports."""

    traced: TracedCrack
    """In the near view."""
    course: TracedCrack
    """In the view that shows it longest."""
    widest: FloatArray
    """Shape (2,). Phi and z of the scan."""
    width: float
    """There, in metres."""
    found: CrackDepth
    """By the echoes."""
    photo: Photo
    """The near view."""
    wall: DepthMap
    """The wall about it."""

    @property
    def finding(self) -> Finding:
        """Line of the table of findings; its width is the median of the near view.

        The width at the widest place is the maximum of what is noisy along the course: too large.
        """
        near = self.traced
        return crack_finding(
            self.course.places, near.width, self.found, RADIUS, width_sd=near.width_sd
        )


def examined(rig: InspectionRig, trace: TracedCrack, views: int) -> SeenCrack | None:
    """Go to a course, trace it in a near view, and scan across it; None if it is no crack.

    It is one if it is traced again, and ``views`` on the way round showed it, or echoes its depth.
    """
    middle = trace.middle
    many = f"{views} view{'s' if views > 1 else ''}"
    pick(rig, middle, f"a line of {1e3 * trace.length:.1f} mm in {many}")
    centre(rig, middle)
    focus(rig)
    again, photo = _again(rig, trace, middle)
    if not again or photo is None:
        rig.say("trace", "not seen again from nearer; not counted as a crack")
        return None
    best = max(again, key=lambda other: other.length)
    course = whole_course(best, trace)
    where, width = widest(best)
    words = f"{1e3 * course.length:.1f} mm long, {1e3 * width:.2f} mm at its widest"
    rig.say("trace", f"a crack, {words}")
    found, _ = scanned_crack(rig, best)
    if not counts_as_crack(views, found):
        words = f"a line in {many}, and no echo of its depth; not counted as a crack"
        rig.say("trace", words, succeeded=False)
        return None
    patch = patch_about(course.places, rig.calibration.radius)
    wall = crack_map(course.places, width, found, tuple(where.tolist()), patch)
    return SeenCrack(best, course, where, width, found, photo, wall)


def _again(
    rig: InspectionRig, trace: TracedCrack, middle: FloatArray
) -> tuple[tuple[TracedCrack, ...], Photo | None]:
    """Return the traces of a course in near views, and the photo."""
    for by in CLOSER:
        near, photo = near_view(rig, middle, by)
        again = traced_again(near, trace.places, rig.calibration.radius)
        if again:
            return again, photo
    return (), None


def crack_figures(cracks: Sequence[SeenCrack], truth: Crack) -> dict[str, Any]:
    """Return the errors of the cracks that are reported; NaN if none is the true one.

    Any that does not lie on the true one is false.
    """
    course, widths = fine_course(truth, RADIUS)
    right = [one for one in cracks if one_course(one.course.places, course, RADIUS)]
    figures: dict[str, Any] = {
        "crack_found": bool(right),
        "false_cracks": len(cracks) - len(right),
        "crack_measured": any(np.isfinite(one.found.depth) for one in right),
    }
    names = [f"crack_{each}" for each in ("length_error_pct", "width_error_pct", "off_mm")]
    names.append("crack_depth_error_mm")
    if not right:
        return figures | dict.fromkeys(names, np.nan)
    best = max(right, key=lambda one: one.course.length)
    off = between(best.course.places, course, RADIUS)
    length = float(wall_lengths(course, RADIUS)[-1])
    there = widths[int(np.argmin(between(best.widest[None], course, RADIUS)[0]))]
    values = (
        100 * abs(best.course.length / length - 1),
        100 * abs(best.width / there - 1),
        1e3 * float(np.median(off.min(axis=1))),
        1e3 * abs(best.found.depth - truth.depth),
    )
    return figures | dict(zip(names, map(float, values), strict=True))
