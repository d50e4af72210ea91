"""All controllers that use readings beside each other, by the camera alone.

The same steps, surroundings and circle as in the study of the head, but every reading is of a
picture, and every controller has the wires that were identified by pictures.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from papers.catheter.head_camera import (
    CIRCLES,
    LAWS,
    STEPS,
    WallCircle,
    given_camera,
    identify_seen,
    run_circle,
    run_step,
    seen_control,
)
from papers.catheter.head_loop import DISTURBED, HeadRun, controller_figures
from papers.catheter.head_rivals_report import WORDS
from papers.claims import Claim

TITLE = "Controllers of a head by its camera alone"
CIRCLE = "circle_30s"
"""The circle of all controllers, the faster one whose error is limited."""
_FIGURES = {
    "settle_s": "steps of 20, 30, 40, the worst: settling [s]",
    "overshoot_pct": "the same: overshoot [%]",
    "steady_rms_deg": "the same: steady rms [deg]",
    "disturbed_settle_s": "step of 40 in four other surroundings, the worst: settling [s]",
    "disturbed_rms_deg": "the same: steady rms [deg]",
    "circle_rms_mm": "circle 8 mm across in 30 s: rms [mm]",
    "energy_A2s": "energy of the steps [A^2 s]",
}
CLAIMS = (
    *(
        Claim(f"{WORDS[law]}, {words}", f"rivals.{law}.{key}", "-")
        for key, words in _FIGURES.items()
        for law in LAWS
    ),
    Claim("seconds for a specimen", "seconds", "-"),
)


@dataclass(frozen=True, eq=False)
class CameraRivals:
    """Runs of one specimen by its camera alone.

    Parameters
    ----------
    steps : mapping of (law, target) to HeadRun
    disturbed : mapping of (law, surroundings) to HeadRun
        The highest step.
    circles : mapping of law to WallCircle
    seconds : float
    """

    steps: Mapping[tuple[str, float], HeadRun]
    disturbed: Mapping[tuple[str, str], HeadRun]
    circles: Mapping[str, WallCircle]
    seconds: float

    def figures(self) -> dict[str, Any]:
        """Return the figures of each controller by its name."""
        return {"rivals": {law: self._figures(law) for law in LAWS}, "seconds": self.seconds}

    def _figures(self, law: str) -> dict[str, float]:
        steps = [self.steps[law, target] for target in STEPS]
        disturbed = [self.disturbed[law, where] for where in DISTURBED]
        figures = controller_figures(steps, disturbed)
        return {**figures, "circle_rms_mm": self.circles[law].rms}


def run_study(seed: int, told: Callable[[str], None] = lambda part: None) -> CameraRivals:
    """Identify a specimen from pictures, and run every controller on pictures.

    Parameters
    ----------
    seed : int
        Draws specimen, pipe, camera and errors of its calibration.
    told : callable
        Is given the name of each controller that is done.
    """
    began = time.perf_counter()
    seen, circle = identify_seen(seed), CIRCLES[CIRCLE]
    steps, disturbed, circles = {}, {}, {}
    for law in LAWS:
        control, camera = seen_control(law, seen), given_camera(seed, seen.view)
        for target in STEPS:
            steps[law, target] = run_step(seed, law, control, target, camera)
        for where, around in DISTURBED.items():
            disturbed[law, where] = run_step(seed, law, control, STEPS[-1], camera, around)
        by_hole = given_camera(seed, seen.view, bores=(circle.hole,))
        circles[law] = run_circle(seed, control, circle, by_hole)
        told(law)
    return CameraRivals(steps, disturbed, circles, time.perf_counter() - began)
