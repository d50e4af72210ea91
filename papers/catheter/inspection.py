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
from papers.catheter.crack_trials import CrackOutcome, crack_figures, score_cracks
from papers.catheter.detection import (
    SceneOutcome,
    detection_figures,
    plain_edges,
    score_flooded,
    score_scene,
    score_sizes,
)
from papers.catheter.flooded import TEMPERATURES, reach_figures
from papers.catheter.inspection_servo import Scene, ServoRun, servo_figures
from papers.catheter.mission import Mission, run_mission
from papers.catheter.missions import CLAIMS as MISSION_CLAIMS
from papers.catheter.missions import mission_figures, touch_figures
from papers.catheter.scan_trials import ScoredScan
from papers.catheter.scans import CLAIMS as SCAN_CLAIMS
from papers.catheter.scans import SCANS, scan_figures, scored_scans
from papers.catheter.sweep_trials import ScoredSweep, c_scan_figures, run_sweep
from papers.catheter.sweeps import CLAIMS as SWEEP_CLAIMS
from papers.claims import Claim, for_each, medians

TITLE = "In-pipe inspection with a catheter head"
PARTS = {
    "missions": "papers.catheter.missions",
    "scans": "papers.catheter.scans",
    "sweeps": "papers.catheter.sweeps",
}
FIRST_SCENE, SCENES, FIRST_PLAIN, FIRST_CRACK = 50_000, 4, 2_000_000, 3_000_000
FIRST_FLOODED, FIRST_SIZED = 4_000_000, 5_000_000
"""Seeds of the scored scenes, and number of scenes with and without a hole or a crack for each
specimen."""
_PLAIN_SHARE, _SCANNED = 4, 4
"""Scenes with a hole for each plain scene, and cracks for each one that is scanned: by trial. A
scan takes five times as long as a scene."""
_WARM = 20.0
"""Temperature of the water in degrees Celsius from which on most heads must reach a raster."""
_SCORED = ("outcomes", "cracks", "edges", "scored", "sweep")

CLAIMS = (
    Claim("servo with angle sensor: to 2 px [s]", "servo.settle_s_with_sensor", "shown", most=8),
    Claim("servo, camera only: to 2 px [s]", "servo.settle_s_camera_only", "shown", most=12),
    Claim("servo: steady rms [px]", "servo.steady_rms_px", "shown", most=0.5),
    Claim("sway of 1 degree: motion held over not held", "sway.ratio", "not studied", most=0.65),
    Claim("the same in the stabilised pictures", "sway.stabilised_ratio", "-"),
    Claim("holes found", "detection.recall", "one image (Fig 14)", least=0.98, percent=True),
    Claim(
        "false findings an acquisition",
        "detection.false_per_acquisition",
        "one reflection recognised",
        most=0.05,
    ),
    Claim("single frames: holes found", "detection.single_recall", "-", percent=True),
    Claim("dithered frames: holes found", "detection.dither_recall", "-", percent=True),
    Claim("centre, 90th percentile [mm]", "detection.centre_mm_p90", "-", most=0.07),
    Claim(
        "sizes within 15 %", "detection.size_within_15pct", "not studied", least=0.95, percent=True
    ),
    Claim("in water: holes found", "detection.flooded_recall", "-", percent=True),
    Claim(
        "in water: false findings an acquisition", "detection.flooded_false_per_acquisition", "-"
    ),
    Claim(
        "holes and pits of 0.6 to 3 mm found",
        "detection.sizes_recall",
        "not studied",
        least=0.95,
        percent=True,
        count="detection.sizes_scenes",
        enough=20,
    ),
    Claim("the same, of 0.4 to 0.6 mm", "detection.sizes_recall_below", "-", percent=True),
    Claim(
        "the same, from 0.6 mm: diameter, 90th percentile of errors [%]",
        "detection.sizes_diameter_error_pct_p90",
        "not studied",
        most=10,
        count="detection.sizes_scenes",
        enough=20,
    ),
    Claim(
        "the same: false findings an acquisition",
        "detection.sizes_false_per_acquisition",
        "-",
        most=0.05,
        count="detection.sizes_scenes",
        enough=20,
    ),
    Claim(
        "the same: slots and corrosion called holes, an acquisition",
        "detection.sizes_marks_called_holes",
        "-",
    ),
    Claim(
        "plain edges, 90th percentile [px]", "detection.plain_edge_px_p90", "not studied", most=1.0
    ),
    Claim(
        "cracks of 100 um and wider found",
        "cracks.recall_100um",
        "announced",
        least=0.95,
        percent=True,
        count="cracks.scenes_100um",
        enough=20,
    ),
    Claim(
        "cracks of 50 to 100 um found",
        "cracks.recall_50um",
        "announced",
        least=0.7,
        percent=True,
        count="cracks.scenes_50um",
        enough=20,
    ),
    Claim(
        "cracks of 30 to 50 um found",
        "cracks.recall_30um",
        "-",
        percent=True,
        count="cracks.scenes_30um",
    ),
    Claim("false cracks an acquisition", "cracks.false_per_acquisition", "-", most=0.05),
    Claim("cracks: length error, median [%]", "cracks.length_error_pct", "-", most=10),
    Claim("cracks: width error, median [um]", "cracks.width_error_um", "-", most=15),
    Claim("cracks: half the 90 % band of a width, median [um]", "cracks.width_band_um", "-"),
    Claim(
        "cracks: bands of 90 % cover the width",
        "cracks.width_coverage",
        "-",
        least=0.85,
        most=0.95,
        percent=True,
        count="cracks.found",
        enough=40,
    ),
    Claim("cracks: share of the course traced", "cracks.course_traced", "-", percent=True),
    Claim("cracks: share of the trace on the course", "cracks.trace_right", "-", percent=True),
    Claim(
        "cracks found that have a depth by a scan",
        "cracks.depth_share",
        "announced",
        least=0.6,
        percent=True,
        count="cracks.scans",
        enough=20,
    ),
    Claim(
        "of those, depth error, median [mm]",
        "cracks.depth_error_mm",
        "-",
        most=0.1,
        count="cracks.scans",
        enough=20,
    ),
    Claim("frames lost under motion", "tracking.lost_fraction", "tracked", most=0.01),
    Claim("longest loss [s]", "tracking.reacquire_s", "tracked", most=1.0),
    *SCAN_CLAIMS,
    *(
        Claim(
            f"heads that reach a raster in water of {temperature:.0f} C",
            f"reach.at_{temperature:.0f}_c",
            "-",
            least=0.8 if temperature >= _WARM else -np.inf,
            percent=True,
        )
        for temperature in TEMPERATURES
    ),
    *MISSION_CLAIMS,
    *SWEEP_CLAIMS,
    Claim("processor time of a specimen [s]", "seconds", "-"),
)


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
            score_flooded(FIRST_FLOODED + seed * scenes + k, hole),
            score_sizes(FIRST_SIZED + seed * scenes + k, hole),
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
        "reach": {
            key: float(np.mean([run["reach"][key] for run in runs])) for key in runs[0]["reach"]
        },
    }
    return found
