"""Inspection of a pipe by the catheter head: servo, detection, tracking, depth, and a mission.

Boudjabi, Ferreira and Krupa (IEEE ICRA 2003) centre a point by visual servo, distinguish a hole
from a reflection, and announce ultrasonic measurement and fusion. All of this runs here on twins of
head, camera, pipe and probe, scored on scenes that were not used for tuning.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from multiprocessing import parent_process
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.threads import one_thread
from minorloop_head.vision.defects import SIZED
from papers.catheter.crack_trials import CrackOutcome, crack_figures, score_cracks
from papers.catheter.detection import (
    FLOODED,
    SceneOutcome,
    detection_figures,
    plain_edges,
    score_kind,
    score_scene,
)
from papers.catheter.flooded import reach_figures
from papers.catheter.inspection_servo import Scene, ServoRun, servo_figures
from papers.catheter.mission import Mission, run_mission
from papers.catheter.missions import mission_figures, touch_figures
from papers.catheter.scan_trials import ScoredScan
from papers.catheter.scans import SCANS, scan_figures, scored_scans
from papers.catheter.sweep_trials import ScoredSweep, c_scan_figures, run_sweep
from papers.harness import for_each, mean, medians

FIRST_SCENE, SCENES, FIRST_PLAIN, FIRST_CRACK = 50_000, 4, 2_000_000, 3_000_000
FIRST_FLOODED, FIRST_SIZED = 4_000_000, 5_000_000
"""Seeds of the scored scenes, and number of scenes with and without a hole or a crack for each
specimen."""
_PLAIN_SHARE, _SCANNED = 4, 4
"""Scenes with a hole for each plain scene, and cracks for each one that is scanned: by trial. A
scan takes five times as long as a scene."""
_SCORED = ("outcomes", "cracks", "edges", "scored", "sweep")


@dataclass(frozen=True, eq=False)
class InspectionStudy:
    """Results of one specimen."""

    seed: int
    servo: dict[str, Any]
    runs: dict[str, ServoRun]
    outcomes: tuple[SceneOutcome, ...]
    cracks: tuple[CrackOutcome, ...]
    edges: FloatArray
    scored: dict[str, tuple[ScoredScan, ...]]
    mission: Mission
    sweep: ScoredSweep
    reach: dict[str, float]
    seconds: float

    def figures(self) -> dict[str, Any]:
        """Return the input of `gather`; outcomes, cracks and scans by their names."""
        return {
            **self.servo,
            "outcomes": self.outcomes,
            "cracks": self.cracks,
            "edges": self.edges,
            "scored": self.scored,
            "mission": self.mission.figures(),
            "sweep": self.sweep,
            "reach": self.reach,
            "seconds": self.seconds,
        }


@one_thread()
def run_study(
    seed: int,
    scenes: int = SCENES,
    scans: int = SCANS,
    told: Callable[[str], None] = lambda part: None,
) -> InspectionStudy:
    """Run the study for one specimen.

    Parameters
    ----------
    seed : int
        Of head, pipe, camera, probe and noise.
    scenes : int
        Number of scenes with a hole, without, with a crack and without, for the scores of
        detection; plain edges on a quarter as many, and scans across a quarter of the cracks.
    scans : int
        Number of pits with a flat floor for the score of depths and bands; the last has the size
        for the score of fusion.
    told : callable
        Is given the name of each part that is done, with its processor time.
    """
    work = partial(_part, seed, scenes, scans)
    # One of several specimens has a core of its own; the first of them, or a single one, does not
    # leave the others idle.
    share = parent_process() is None
    count = len(_SHARES)
    found: dict[str, Any] = {}
    total = 0.0
    for name, part, seconds in (
        for_each(work, count, 0, ordered=False) if share else map(work, range(count))
    ):
        told(f"{name}: {seconds:.0f} s")
        found, total = found | part, total + seconds
    return InspectionStudy(seed=seed, **found, seconds=total)


def _part(seed: int, scenes: int, scans: int, number: int) -> tuple[str, dict[str, Any], float]:
    """Return the name of a part, its results, and its processor time."""
    began, (name, work) = time.process_time(), _SHARES[number]
    found = work(seed, scenes, scans)
    return name, found, time.process_time() - began


def _servo(seed: int, scenes: int, scans: int) -> dict[str, Any]:
    servo, runs = servo_figures(Scene(seed))
    return {"servo": servo, "runs": runs}


def _holes(seed: int, scenes: int, scans: int) -> dict[str, Any]:
    plain = -(-scenes // _PLAIN_SHARE)
    outcomes = [
        outcome
        for k in range(scenes)
        for hole in (True, False)
        for outcome in (
            *score_scene(FIRST_SCENE + seed * scenes + k, hole),
            score_kind(FIRST_FLOODED + seed * scenes + k, hole, FLOODED),
            score_kind(FIRST_SIZED + seed * scenes + k, hole, SIZED),
        )
    ]
    edges = np.concatenate([plain_edges(FIRST_PLAIN + seed * plain + k) for k in range(plain)])
    return {"outcomes": tuple(outcomes), "edges": edges}


def _cracks(seed: int, scenes: int, scans: int) -> dict[str, Any]:
    outcomes = (
        score_cracks(FIRST_CRACK + seed * scenes + k, crack, scan=k % _SCANNED == 0)
        for k in range(scenes)
        for crack in (True, False)
    )
    return {"cracks": tuple(outcomes)}


def _depths(seed: int, scenes: int, scans: int) -> dict[str, Any]:
    return {"scored": scored_scans(seed, scans)}


def _mission(seed: int, scenes: int, scans: int) -> dict[str, Any]:
    return {"mission": run_mission(seed), "reach": reach_figures(seed)}


def _sweep(seed: int, scenes: int, scans: int) -> dict[str, Any]:
    return {"sweep": run_sweep(seed)}


_SHARES = (
    ("servo", _servo),
    ("mission", _mission),
    ("sweep", _sweep),
    ("scans of pits", _depths),
    ("scenes of holes", _holes),
    ("scenes of cracks", _cracks),
)
"""Parts of a specimen, the longest first."""


def gather(runs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return medians over specimens; shares and spreads over all that was scored."""
    plain = [{k: v for k, v in run.items() if k not in _SCORED} for run in runs]
    found = medians([{k: v for k, v in run.items() if k != "mission"} for run in plain])
    every = [outcome for run in runs for outcome in run["outcomes"]]
    edges = np.concatenate([run["edges"] for run in runs])
    found |= {
        "detection": {
            **detection_figures(every),
            "plain_edge_px_p90": float(np.quantile(edges, 0.9, method="higher")),
        },
        "cracks": crack_figures([one for run in runs for one in run["cracks"]]),
        **scan_figures([run["scored"] for run in runs]),
        "mission": mission_figures([run["mission"] for run in runs]),
        "touch": touch_figures([run["mission"] for run in runs]),
        "cscan": c_scan_figures([run["sweep"] for run in runs]),
        "reach": {key: mean([run["reach"][key] for run in runs]) for key in runs[0]["reach"]},
    }
    return found
