"""Inspection of a pipe by the catheter head: servo, detection, tracking, depth, and a mission.

Boudjabi, Ferreira and Krupa (IEEE ICRA 2003) centre a point by visual servo, distinguish a hole
from a reflection, and announce ultrasonic measurement and fusion. All of this runs here on twins of
head, camera, pipe and probe, scored on scenes that were not used for tuning.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from multiprocessing import parent_process
from typing import Any

import numpy as np

from minorloop.threads import one_thread
from minorloop_head.vision.defects import SIZED
from papers.catheter.crack_trials import crack_figures, score_cracks
from papers.catheter.detection import (
    FLOODED,
    detection_figures,
    plain_edges,
    score_kind,
    score_scene,
)
from papers.catheter.inspection_servo import Scene, servo_figures
from papers.catheter.mission import gather as gather_missions
from papers.catheter.mission import reach_figures, run_mission
from papers.catheter.scan_trials import SCANS, run_scans, scan_figures
from papers.catheter.sweep_trials import c_scan_figures, run_sweep
from papers.harness import Results, for_each, mean, medians

FIRST_SCENE, SCENES, FIRST_PLAIN, FIRST_CRACK = 50_000, 4, 2_000_000, 3_000_000
FIRST_FLOODED, FIRST_SIZED = 4_000_000, 5_000_000
"""Seeds of the scored scenes, and number of scenes with and without a hole or a crack for each
specimen."""
_PLAIN_SHARE, _SCANNED = 4, 4
"""Scenes with a hole for each plain scene, and cracks for each one that is scanned: by trial. A
scan takes five times as long as a scene."""
_SCORED = ("outcomes", "cracks", "edges", "scored", "sweep")


@one_thread()
def run_study(
    seed: int,
    scenes: int = SCENES,
    scans: int = SCANS,
    told: Callable[[str], None] = lambda part: None,
) -> Results:
    """Run the study for the specimen of a seed.

    Detection is scored on so many ``scenes`` with a hole, without, with a crack and without, plain
    edges on a quarter as many, and scans across a quarter of the cracks; depths and bands on so
    many ``scans`` of pits with a flat floor, of which the last has the size for the score of
    fusion. The name of a part that is done is told with its processor time.
    """
    work = partial(_part, seed, scenes, scans)
    # One of several specimens has a core of its own; the first of them, or a single one, does not
    # leave the others idle.
    share = parent_process() is None
    count, total = len(_SHARES), 0.0
    found: dict[str, Any] = {}
    for name, part, seconds in (
        for_each(work, count, 0, ordered=False) if share else map(work, range(count))
    ):
        told(f"{name}: {seconds:.0f} s")
        found, total = found | part, total + seconds
    return results(seed, found, total)


def results(seed: int, found: Mapping[str, Any], seconds: float) -> Results:
    """Return the parts of a specimen; the figures are the input of `gather`."""
    kept = {key: found[key] for key in (*_SCORED, "reach")}
    figures = {**found["servo"], **kept, "mission": found["mission"].figures(), "seconds": seconds}
    return Results(figures, seed=seed, seconds=seconds, **found)


def _part(seed: int, scenes: int, scans: int, number: int) -> tuple[str, dict[str, Any], float]:
    """Return the name of a part, its results, and its processor time."""
    began, (name, work) = time.process_time(), _SHARES[number]
    found = work(seed, scenes, scans)
    return name, found, time.process_time() - began


def _servo(seed: int, *_: int) -> dict[str, Any]:
    servo, runs = servo_figures(Scene(seed))
    return {"servo": servo, "runs": runs}


def _holes(seed: int, scenes: int, *_: int) -> dict[str, Any]:
    plain, first = -(-scenes // _PLAIN_SHARE), seed * scenes
    outcomes = [
        outcome
        for k in range(first, first + scenes)
        for hole in (True, False)
        for outcome in (
            *score_scene(FIRST_SCENE + k, hole),
            score_kind(FIRST_FLOODED + k, hole, FLOODED),
            score_kind(FIRST_SIZED + k, hole, SIZED),
        )
    ]
    edges = np.concatenate([plain_edges(FIRST_PLAIN + seed * plain + k) for k in range(plain)])
    return {"outcomes": tuple(outcomes), "edges": edges}


def _cracks(seed: int, scenes: int, *_: int) -> dict[str, Any]:
    outcomes = (
        score_cracks(FIRST_CRACK + seed * scenes + k, crack, scan=k % _SCANNED == 0)
        for k in range(scenes)
        for crack in (True, False)
    )
    return {"cracks": tuple(outcomes)}


_SHARES: Sequence[tuple[str, Callable[[int, int, int], dict[str, Any]]]] = (
    ("servo", _servo),
    ("mission", lambda seed, *_: {"mission": run_mission(seed), "reach": reach_figures(seed)}),
    ("sweep", lambda seed, *_: {"sweep": run_sweep(seed)}),
    ("scans of pits", lambda seed, _, scans: run_scans(seed, scans)),
    ("scenes of holes", _holes),
    ("scenes of cracks", _cracks),
)
"""Parts of a specimen, the longest first: of its seed, and of the numbers of scenes and scans."""


def gather(runs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return medians over specimens; shares and spreads over all that was scored."""
    scored = (*_SCORED, "mission")
    found = medians([{k: v for k, v in run.items() if k not in scored} for run in runs])
    every = [outcome for run in runs for outcome in run["outcomes"]]
    edges = np.concatenate([run["edges"] for run in runs])
    return found | {
        "detection": {
            **detection_figures(every),
            "plain_edge_px_p90": float(np.quantile(edges, 0.9, method="higher")),
        },
        "cracks": crack_figures([one for run in runs for one in run["cracks"]]),
        **scan_figures([run["scored"] for run in runs]),
        **gather_missions([run["mission"] for run in runs]),
        "cscan": c_scan_figures([run["sweep"] for run in runs]),
        "reach": {key: mean([run["reach"][key] for run in runs]) for key in runs[0]["reach"]},
    }
