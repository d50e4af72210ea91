"""All controllers that use readings beside each other, by the camera alone.

The same steps, surroundings and circle as in the study of the head, but every reading is of a
picture, and every controller has the wires that were identified by pictures.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from papers.catheter.head_camera import (
    CIRCLES,
    LAWS,
    STEPS,
    given_camera,
    identify_seen,
    run_circle,
    run_step,
    seen_control,
)
from papers.catheter.head_loop import DISTURBED, controller_figures
from papers.harness import Study

CIRCLE = "circle_30s"
"""The circle of all controllers, the faster one whose error is limited."""


def run_study(seed: int, told: Callable[[str], None] = lambda part: None) -> dict[str, Any]:
    """Identify a specimen from pictures, run every controller on pictures, and return the figures.

    Parameters
    ----------
    seed : int
        Draws specimen, pipe, camera and errors of its calibration.
    told : callable
        Is given the name of each controller that is done.
    """
    began = time.perf_counter()
    seen, circle = identify_seen(seed), CIRCLES[CIRCLE]
    rivals = {}
    for law in LAWS:
        control, camera = seen_control(law, seen), given_camera(seed, seen.view)
        steps = [run_step(seed, law, control, target, camera) for target in STEPS]
        disturbed = [
            run_step(seed, law, control, STEPS[-1], camera, around) for around in DISTURBED.values()
        ]
        by_hole = given_camera(seed, seen.view, bores=(circle.hole,))
        round_hole = run_circle(seed, control, circle, by_hole)
        rivals[law] = {**controller_figures(steps, disturbed), "circle_rms_mm": round_hole.rms}
        told(law)
    return {"rivals": rivals, "seconds": time.perf_counter() - began}


STUDY = Study("rivals", "Controllers of a head by its camera alone", run_study)
