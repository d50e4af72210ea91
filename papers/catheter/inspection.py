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
from pathlib import Path
from typing import Any

import numpy as np

from minorloop.identification.bands import PER_DEVIATION
from minorloop.report import Table
from minorloop.threads import one_thread
from minorloop_head.procedures.inspected_view import AROUND
from minorloop_head.procedures.sweep_map import draw_pipe_map
from minorloop_head.vision.defects import DITHER, LEAST_EVIDENCE, SINGLE, SIZED, SWITCHED, Hole
from papers.catheter import mission, scan_trials, sweep_trials
from papers.catheter.crack_trials import CrackOutcome, crack_figures, score_cracks, search_cracks
from papers.catheter.detection import (
    FLOODED,
    JUDGE,
    JUDGED_SCENES,
    SceneOutcome,
    Search,
    detection_figures,
    plain_edges,
    recall_curve,
    score_scene,
    search_scene,
)
from papers.catheter.inspection_servo import SETTLED_PX, SWAY_WAIT, Scene, servo_figures
from papers.catheter.scan_trials import SCANS, ScoredScan
from papers.drawing import Paint, draw, level, on_axes, panel, photo
from papers.harness import Results, Study, for_each, mean, medians

SCENES = 4
"""Scenes with and without a hole or a crack for each specimen."""
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
    fusion. ``told`` is called with the name of each finished part and its processor time.
    """
    work = partial(_part, seed, scenes, scans)
    # Of several specimens each has its own core; the first, or a single one, uses idle cores too.
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


def _mission(seed: int, *_: int) -> dict[str, Any]:
    return {"mission": mission.run_mission(seed), "reach": mission.reach_figures(seed)}


def _holes(seed: int, scenes: int, *_: int) -> dict[str, Any]:
    # Plain scenes are a quarter as many: by trial.
    plain, first = -(-scenes // 4), seed * scenes
    outcomes = [
        outcome
        for k in range(first, first + scenes)
        for hole in (True, False)
        for begin, kind in ((50_000, ""), (4_000_000, FLOODED), (5_000_000, SIZED))
        for outcome in score_scene(begin + k, hole, kind)
    ]
    edges = np.concatenate([plain_edges(2_000_000 + seed * plain + k) for k in range(plain)])
    return {"outcomes": tuple(outcomes), "edges": edges}


def _cracks(seed: int, scenes: int, *_: int) -> dict[str, Any]:
    # A scan takes five times as long as a scene, so that a quarter of the cracks are scanned.
    outcomes = (
        score_cracks(3_000_000 + seed * scenes + k, crack, scan=k % 4 == 0)
        for k in range(scenes)
        for crack in (True, False)
    )
    return {"cracks": tuple(outcomes)}


_SHARES: Sequence[tuple[str, Callable[[int, int, int], dict[str, Any]]]] = (
    ("servo", _servo),
    ("mission", _mission),
    ("sweep", lambda seed, *_: sweep_trials.run_study(seed)),
    ("scans of pits", lambda seed, _, scans: scan_trials.run_scans(seed, scans)),
    ("scenes of holes", _holes),
    ("scenes of cracks", _cracks),
)
"""Parts of a specimen, longest first: functions of its seed and of numbers of scenes and scans."""


def gather(runs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return medians over specimens; shares and spreads are over all scored results."""
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
        **scan_trials.gather(runs),
        **mission.gather([run["mission"] for run in runs]),
        **sweep_trials.gather(runs),
        "reach": {key: mean([run["reach"][key] for run in runs]) for key in runs[0]["reach"]},
    }


_WORDS = {
    SWITCHED: ("three lights and none", "C0 - 2.6"),
    SINGLE: ("one frame", "C1 -- 1.8"),
    DITHER: ("five turns of 2 degrees", "C2 : 1.8"),
}
_LEAST_SHOWN = 3e-3
"""Left end of the logarithmic axis of false findings, which cannot show 0; by trial."""
_SHOWN = 6
"""Largest number of drawn scenes of each kind of error, by trial."""
_LIGHTS = {0: "first light", 1: "second light", 2: "third light", 4: "all lights"}
"""Drawn frames of an acquisition, and their lights; the one without light is left out."""


def missed_holes(outcomes: Sequence[SceneOutcome]) -> dict[str, int]:
    """Return counts of holes and of missed ones under switched lights, and of false findings."""
    own = [each for each in outcomes if each.mode == SWITCHED]
    missed = [each for each in own if each.hole and not each.found]
    return {
        "holes": sum(each.hole for each in own),
        "missed": len(missed),
        "dark": sum(each.inside == "dark" for each in missed),
        "unseen": sum(not np.isfinite(each.evidence) for each in missed),
        "false": sum(each.false for each in own),
        "of": len(own),
    }


def draw_curve(outcomes: Sequence[SceneOutcome]) -> Any:
    """Draw recall against false findings for each kind of acquisition."""
    most, least = 0.05, 0.98  # required
    lines: list[Any] = [([_LEAST_SHOWN, most, most], [least, least, 1.0], "0.3 --")]
    for mode, (words, look) in _WORDS.items():
        own = [each for each in outcomes if each.mode == mode]
        if not any(each.hole for each in own):
            continue
        false, recall = recall_curve(own)
        # More false findings before more recall.
        way = np.maximum(np.repeat(false, 2)[1:], _LEAST_SHOWN), np.repeat(recall, 2)[:-1]
        at = max(sum(each.false for each in own) / len(own), _LEAST_SHOWN)
        hits = float(np.mean([each.found for each in own if each.hole]))
        lines += [(*way, look, words), ([at], [hits], f"{look.split()[0]} o 6")]
    x = f"false findings an acquisition ({_LEAST_SHOWN:g} or fewer at the left)"
    y, place = "share of the holes that are found", {"loc": "lower right"}
    frame: dict[str, Any] = {"xscale": "log", "xlim": (_LEAST_SHOWN, 2.0), "ylim": (0.5, 1.03)}
    return draw(panel(x, y, *lines, legend=place, **frame))


def draw_missed(outcomes: Sequence[SceneOutcome]) -> Any:
    """Draw missed holes, and the outlines with the most evidence there; None without one."""
    own = [each for each in outcomes if each.mode == SWITCHED and each.hole and not each.found]
    return _scenes([(each, each.evidence, each.inside) for each in own])


def draw_false(outcomes: Sequence[SceneOutcome]) -> Any:
    """Draw false findings, the strongest of each scene; None without one."""
    shown = []
    for each in outcomes:
        if each.mode == SWITCHED and each.false:
            most = max(value for value in each.alarms if value >= LEAST_EVIDENCE[SWITCHED])
            shown.append((each, most, f"evidence {most:+.1f}"))
    return _scenes(shown)


def _scenes(shown: Sequence[tuple[SceneOutcome, float, str]]) -> Any:
    """Draw the first scenes about the findings with some evidence, with words; None without one."""
    panels: list[Paint] = []
    for each, evidence, words in shown[:_SHOWN]:
        (search,) = search_scene(each.seed, each.hole)
        hole = next((hole for hole in search.holes if hole.evidence == evidence), None)
        panels += _scene(f"scene {each.seed}\n{words}", search, hole)
    rows = len(panels) // len(_LIGHTS)
    return draw(*panels, columns=len(_LIGHTS), height=2.35 * rows) if panels else None


def _scene(words: str, search: Search, hole: Hole | None) -> list[Paint]:
    """Return pictures under each light about a finding, with its outline and the true edge.

    Half a side is 75 pixels: 3 mm, within which a glint is, 20 mm away.
    """
    rim = None if hole is None else search.rim(hole)
    true = search.true_rim() if search.view.hole is not None else None
    about = true if rim is None else rim
    middle = np.zeros(2) if about is None else about.mean(axis=0)
    lines = [
        (*np.vstack([edge, edge[:1]]).T, f"{colour} - 0.8")
        for edge, colour in ((true, "C0"), (rim, "C1"))
        if edge is not None
    ]
    roots = {  # shadows are seen so
        light: np.sqrt(search.frames[frame].image, dtype=np.float32)
        for frame, light in _LIGHTS.items()
    }
    first = next(iter(roots))
    return [
        photo(
            root, f"{words}\n{light}" if light == first else light, *lines, middle=middle,
            half=75, vmax=16,
        )
        for light, root in roots.items()
    ]  # fmt: skip


def crack_table(found: Mapping[str, Any]) -> Table:
    """Return a table of recall by width."""
    rows = []
    classes = {"100um": "100 to 200 um", "50um": "50 to 100 um", "30um": "30 to 50 um"}
    for name, words in classes.items():
        if of := found[f"scenes_{name}"]:
            low, high = found[f"recall_{name}_interval"]
            share = f"{found[f'recall_{name}']:.1%} ({low:.1%} to {high:.1%})"
            rows.append((words, share, str(of)))
    return Table(("width", "found (95 % interval)", "cracks"), rows)


def verdict_words(found: Mapping[str, Any]) -> str:
    """Return the verdicts of scans across cracks as a list."""
    return ", ".join(f"{verdict} {count}" for verdict, count in found["verdicts"].items()) or "none"


def draw_walls(outcomes: Sequence[CrackOutcome]) -> Any:
    """Draw the unrolled wall of the four widest cracks, with true and traced courses."""
    shown = sorted(outcomes, key=lambda one: -one.width)[:4]
    panels = [_wall(one) for one in shown]
    return draw(*panels, columns=2, height=2.6 * -(-len(shown) // 2)) if shown else None


def _wall(outcome: CrackOutcome) -> Paint:
    search = search_cracks(outcome.seed, outcome.width > 0)
    wall, radius = search.findings.wall, search.camera.radius
    title = f"scene {outcome.seed}, {1e6 * outcome.width:.0f} um"
    if wall is None:
        return photo(None, title)
    traced = [(*wall.window.texels(each.places, radius).T, "C1") for each in search.traces]
    true = (*wall.window.texels(search.course, radius).T, "C0 , 1")
    return photo(wall.whole - wall.ground, title, *traced, true, vmin=-0.8, vmax=0.5)


def draw_depths(runs: Sequence[Mapping[str, Any]]) -> Any:
    """Draw measured minus true depth of every pit, with its 90 % band."""
    panels, probes = [], {"through the lens": ("pit", "fused"), "unfocused disc": ("unfocused",)}
    for title, kinds in probes.items():
        each = [one for run in runs for kind in kinds for one in run["scored"][kind]]
        known = [one for one in each if one.found.measured]
        depth = [1e3 * one.site.depth for one in known]
        error = [1e6 * one.error for one in known]
        band = [1e6 * PER_DEVIATION * one.found.depth_sd for one in known]
        style = {"fmt": "o", "ms": 3, "lw": 0.8, "capsize": 1.5}
        points = [on_axes("errorbar", depth, error, band, **style)] if known else []
        words = "true depth [mm]", "measured less true [um], 90 % band"
        title = f"{title}: {len(known)} of {len(each)} measured"
        panels.append(panel(*words, *points, level(0.0), title=title))
    return draw(*panels, columns=2, height=3.4)


def names(
    study: Results, figures: Mapping[str, Any], runs: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    """Return the further names of the template."""
    many, missions = len(runs) > 1, figures["mission"]
    cracks = [one for run in runs for one in run["cracks"]]
    outcomes = [outcome for run in runs for outcome in run["outcomes"]]
    return {
        "own_pipes": "pipes of their own" if many else "a pipe of its own",
        "drawn": f"{'that of ' if many else ''}seed {study.seed}",
        "missions": f"mission{'s' if missions['of'] > 1 else ''}",
        "JUDGE": JUDGE,
        "JUDGED_SCENES": JUDGED_SCENES,
        "swept": draw_pipe_map(study.sweep.fused, picture=study.sweep.picture),
        "outcomes": outcomes,
        "missed": missed_holes(outcomes),
        "missed_cracks": [one for one in cracks if one.width > 0 and not one.found],
        "false_cracks": [one for one in cracks if one.false],
    }


def save_beside(study: Results, folder: Path) -> list[str]:
    """Write all files of the inspection of the first specimen to a folder beside the report."""
    for name, content in study.mission.files.items():
        path = folder / "inspection" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return [f"written: {folder / 'inspection' / 'report.html'}"]


def mission_table(found: Results) -> Table:
    """Return the findings of an inspection."""
    rows = []
    for row in found.content["findings"]:
        numbers = ("width [mm]", "length [mm]", "depth [mm]")
        cells = ("-" if row[name] is None else f"{row[name]:.3f}" for name in numbers)
        rows.append((row["kind"], row["grade"], *cells, row["verdict"]))
    return Table(("finding", "grade", "width, mm", "length, mm", "depth, mm", "verdict"), rows)


def log_table(found: Results) -> Table:
    """Return the steps of an inspection after it has looked round."""
    rows = [
        (f"{step.t:.0f} s", step.what, step.outcome, "" if step.succeeded else "failed")
        for step in found.log
        if not step.what.startswith(AROUND)
    ]
    return Table(("time", "step", "outcome", ""), rows)


def depth_table(scored: Mapping[str, Sequence[ScoredScan]]) -> Table:
    """Return the depths of all scans beside the true ones."""
    rows = []
    for kind, scan in ((kind, one) for kind, each in scored.items() for one in each):
        pit, truth = scan.found, scan.site.depth
        true = "through" if np.isinf(truth) else f"{1e3 * truth:.3f}"
        depth = f"{1e3 * pit.depth:.3f}" if np.isfinite(pit.depth) else "-"
        sd = pit.depth_sd
        band = f"{1e6 * PER_DEVIATION * sd:.1f}" if np.isfinite(sd) else "-"
        rows.append((kind, true, pit.verdict, depth, band))
    return Table(("scene", "true depth, mm", "verdict", "depth, mm", "90 % band, um"), rows)


def draw_servo(study: Results) -> Any:
    """Draw distances against time: centring, and holding against sway."""
    sensor, camera, still, swayed = (
        study.runs[name] for name in ("sensor", "camera", "still", "swayed")
    )
    centring = [(sensor.t, sensor.off, "C0", "with angle sensor")]
    centring.append((camera.t, camera.off, "C1", "camera only"))
    late = swayed.t > SWAY_WAIT
    t = swayed.t[late] - SWAY_WAIT
    lines = [(still.t, still.off, "C0", "constant angles, without camera")]
    lines.append((t, swayed.off[late], "C1", "tracked and held"))
    lines.append((t, swayed.left[late], "C2", "and the picture shifted"))
    most = 1.5 * float(max(still.off.max(), swayed.off[late].max(initial=0.0)))
    words, limit = ("time [s]", "off the middle [px]"), level(SETTLED_PX, "0.3 -- 0.8")
    frame: dict[str, Any] = {"title": "sway of 1 degree", "ylim": (0.0, most)}
    return draw(
        panel(*words, *centring, limit, yscale="log"),
        panel(*words, *lines, legend={"loc": "upper right"}, **frame),
        columns=2,
        height=3.6,
    )


STUDY = Study(
    "inspection",
    "In-pipe inspection with a catheter head",
    run_study,
    gather,
    {
        "missions": "papers.catheter.mission",
        "scans": "papers.catheter.scan_trials",
        "sweeps": "papers.catheter.sweep_trials",
    },
    page=__name__,
    beside=save_beside,
)
