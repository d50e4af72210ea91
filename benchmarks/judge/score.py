"""Search rendered acquisitions for holes and cracks, and compare the findings with the truth."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from benchmarks.judge.camera import RenderedCamera, calibrated, metered
from benchmarks.judge.scenes import FINE, Scene, wall
from minorloop_head.geometry import wrapped
from minorloop_head.procedures.meter import acquire
from minorloop_head.procedures.trace import traces_of
from minorloop_head.vision.calibrated_camera import CalibratedCamera
from minorloop_head.vision.defects import LEAST_EVIDENCE, SWITCHED, Hole, find_holes
from minorloop_head.vision.frame_checks import GOOD
from minorloop_head.vision.reflectance_map import LitFrame
from papers.catheter.crack_scenes import FINE as CRACK_STEP
from papers.catheter.crack_trials import shown_on_map
from papers.catheter.detection import FAR, JUDGE, NEAR, wilson
from papers.harness import Results


@dataclass(frozen=True, eq=False)
class Trial:
    """One acquisition, what was found in it, and where the truth is on the map of the camera."""

    scene: Scene
    camera: CalibratedCamera
    frames: tuple[LitFrame, ...]
    truth: np.ndarray
    verdict: str
    holes: tuple[Hole, ...]

    def off(self, hole: Hole) -> float:
        """Return the distance of a finding from the place, in metres."""
        around = self.camera.radius * float(wrapped(hole.place[0] - self.truth[0]))
        return math.hypot(around, hole.place[1] - self.truth[1])

    @property
    def right(self) -> Hole | None:
        """The strongest finding that is at the hole, however weak."""
        if self.scene.hole is None:
            return None
        return next((hole for hole in self.holes if self.off(hole) < NEAR), None)

    @property
    def wrong(self) -> list[Hole]:
        """False findings, however weak."""
        return [hole for hole in self.holes if self.scene.hole is None or self.off(hole) > FAR]


def frames_of(
    scene: Scene, radiance: np.ndarray
) -> tuple[CalibratedCamera, tuple[LitFrame, ...], np.ndarray]:
    """Return the calibrated camera, an acquisition, and the true place (2,) on its map."""
    rendered = RenderedCamera(scene, radiance)
    camera, angles = calibrated(scene)
    frames = acquire(rendered, angles, gain=metered(rendered))
    truth = camera.place(scene.pixels(wall(*map(np.array, scene.place))), scene.pan, scene.tilt)
    return camera, frames, truth


def tried(scene: Scene, radiance: np.ndarray) -> Trial:
    """Return the findings in a scene."""
    camera, frames, truth = frames_of(scene, radiance)
    found = find_holes(frames, camera, least=-math.inf)
    return Trial(scene, camera, frames, truth, found.verdict, found.holes)


def crack_searched(scene: Scene, radiance: np.ndarray) -> Results:
    """Return what was traced in a scene, and its groove, as of `search_cracks`."""
    camera, frames, _ = frames_of(scene, radiance)
    found = find_holes(frames, camera)
    course, widths, width = np.empty((0, 2)), np.empty(0), 0.0
    if scene.groove is not None and found.wall is not None:
        each = slice(None, None, round(1e3 * CRACK_STEP / FINE))
        points = wall(*scene.groove.course[each].T)
        places = camera.place(scene.pixels(points), scene.pan, scene.tilt)
        seen = shown_on_map(found, places, camera.radius)
        course, widths = places[seen], 1e-3 * scene.groove.widths[each][seen]
        width = 1e-3 * scene.groove.width
    return Results(
        view=SimpleNamespace(width=width), camera=camera, findings=found, course=course,
        widths=widths, traces=traces_of(found, camera.radius),
    )  # fmt: skip


def figures(trials: Sequence[Trial], least: float | None = None) -> dict[str, Any]:
    """Return the figures of acquisitions."""
    least = LEAST_EVIDENCE[SWITCHED] if least is None else least
    holes = [trial for trial in trials if trial.scene.hole is not None]
    hits = [t for t in holes if t.right is not None and t.right.evidence >= least]
    false = sum(hole.evidence >= least for trial in trials for hole in trial.wrong)
    refused = Counter(trial.verdict for trial in trials if trial.verdict != GOOD)
    off = [1e3 * t.off(t.right) for t in hits]
    size = [abs(1e3 * t.right.diameter / t.scene.hole.mouth - 1) for t in hits]
    return {
        "scenes": len(trials),
        "holes": len(holes),
        "recall": len(hits) / len(holes) if holes else math.nan,
        "recall_interval": wilson(len(hits), len(holes)) if holes else (math.nan, math.nan),
        "false_per_acquisition": false / max(len(trials), 1),
        "refused": dict(refused),
        "centre_mm_median": float(np.median(off)) if off else math.nan,
        "centre_mm_p90": float(np.quantile(off, 0.9)) if off else math.nan,
        "size_within_15pct": float(np.mean(np.array(size) < 0.15)) if size else math.nan,
    }


_DECIMALS = {"size_within_15pct": 2}
"""Digits of these kept figures; the others have three."""


def outdated(found: Mapping[str, Any]) -> list[str]:
    """Return a line for each kept figure that has changed.

    ``found`` has figures under ``all``, and of each kind of wall and of hole under its name.
    """
    parts = {name: each for name, each in JUDGE.items() if isinstance(each, Mapping)}
    return [
        f"{name}.{key} is {found[name][key]:.3f}, and {kept:g} is kept: correct it in "
        "papers.catheter.detection, README.md and docs/head/reference/studies.md"
        for name, each in {"all": JUDGE, **parts}.items()
        for key, kept in each.items()
        if isinstance(kept, float) and round(found[name][key], _DECIMALS.get(key, 3)) != kept
    ]
