"""Fit the evidence of the hole detector on some scenes and score it on others.

    python -m benchmarks.detector fit --first 10000 --count 460 > evidence.py
    python -m benchmarks.detector score --first 30000 --count 500

With ``--rendered FOLDER``, scenes of ``python -m benchmarks.judge render`` with seeds from 1000 to
``--until`` are fitted too. Switched lights are also fitted on half as many scenes in water, and as
many with holes and pits of 0.4 to 3 mm, slots and corrosion, which are searched in all sizes.

Each seed gives a scene with a hole and one without, beside saturated glints. A finding within
0.3 mm of the hole is correct (0.3 diameters of a smaller one); one farther than 0.8 mm off (0.8
diameters of a larger one), or without a hole, is false. Places are compared on the map of the
camera, which knows the pivot to 0.2 mm and the angles to 0.05 degrees, so that the error of the
pose is not scored.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from minorloop_head.geometry import wrapped
from minorloop_head.vision.calibrated_camera import CalibratedCamera
from minorloop_head.vision.candidates import FEATURES, KINDS, Candidate, candidates
from minorloop_head.vision.defects import (
    LEAST_EVIDENCE,
    MODES,
    SIZED,
    SIZES,
    SWITCHED,
    WEIGHTS,
    Hole,
    scales,
    strongest,
)
from minorloop_head.vision.reflectance_map import LitFrame, aligned, lay_flat
from papers.catheter.detection import FAR, NEAR, misjudged, shots, wilson
from papers.catheter.scene_view import DIAMETERS, draw_sized_view, draw_view

OURS, RENDERED, FLOODED = "ours", "rendered", "flooded"
FALSE = 0.05
ASKED = {(SWITCHED, OURS): 0.0125}
"""False findings an acquisition at the thresholds, where not ``FALSE``: switched lights leave
evidence to spare, and one set of scenes has twice as many as another."""
PARTS = 3
"""Parts of a cross-validation."""
PENALTY, LEAST_WEIGHT = 1.0, 0.2


@dataclass(frozen=True, eq=False)
class Scene:
    """The findings in a scene, and the truth: place (2,) on the map, diameter, inside."""

    place: np.ndarray
    diameter: float
    inside: str
    found: dict[str, list[tuple[Candidate, np.ndarray]]]
    seconds: dict[str, float]
    source: str = OURS

    @property
    def near(self) -> float:
        """Distance within which a finding is at the hole, in metres."""
        return NEAR * min(self.diameter / 1e-3, 1.0)

    @property
    def far(self) -> float:
        """Distance beyond which a finding is not at the hole, in metres."""
        return FAR * max(self.diameter / 1e-3, 1.0)


def scene(seed: int, hole: bool, modes: tuple[str, ...], source: str = OURS) -> Scene:
    """Draw, photograph and search a scene."""
    if source == SIZED:
        view, sizes = draw_sized_view(seed, hole=hole), DIAMETERS
    else:
        view, sizes = draw_view(seed, hole=hole, flooded=source == FLOODED), SIZES
    rng = np.random.default_rng([seed, int(hole), 7])
    camera = misjudged(view, rng)
    place = camera.place(view.camera._pixel(*view.place), view.pan, view.tilt)
    found, seconds = {}, {}
    for mode in modes:
        frames = shots(view, rng, mode)
        start = time.thread_time()
        found[mode] = searched(frames, camera, sizes)
        seconds[mode] = time.thread_time() - start
    bore = view.hole
    inside = bore.inside if bore else ""
    return Scene(place, bore.diameter if bore else 0.0, inside, found, seconds, source)


def searched(
    frames: list[LitFrame], camera: CalibratedCamera, sizes: tuple[float, float] = SIZES
) -> list[tuple[Candidate, np.ndarray]]:
    """Return candidates of all sizes, with their places."""
    found, frames = [], aligned(frames, camera)
    for scale in scales(sizes):
        wall = lay_flat(frames, camera, scale)
        objects = candidates(wall) if wall is not None else []
        found += [(each, wall.window.place(each.x, each.y, camera.radius)) for each in objects]
    return found


def rendered_scene(drawn: object, radiance: np.ndarray) -> Scene:
    """Search a scene of the other renderer under switched lights."""
    from benchmarks.judge.score import frames_of

    camera, frames, place = frames_of(drawn, radiance)
    hole = drawn.hole
    size, inside = (1e-3 * hole.mouth, hole.inside) if hole else (0.0, "")
    return Scene(place, size, inside, {"switched": searched(frames, camera)}, {}, RENDERED)


def errors(scene: Scene, place: np.ndarray, diameter: float) -> tuple[float, float]:
    """Return the error of a finding in metres, and its relative error of size."""
    turn = 10e-3 * float(wrapped(place[0] - scene.place[0]))
    size = diameter / scene.diameter - 1 if scene.diameter else np.inf
    return float(np.hypot(turn, place[1] - scene.place[1])), size


def logistic(x: np.ndarray, y: np.ndarray, share: np.ndarray) -> tuple[float, np.ndarray]:
    """Constant and weights of the odds, by Newton's method with a penalty on the weights.

    ``share`` is how much each row counts.
    """
    design = np.column_stack([np.ones(len(x)), x])
    penalty = np.diag([0.0] + [PENALTY] * x.shape[1])
    beta = np.zeros(design.shape[1])
    middle = float(np.average(y, weights=share))
    beta[0] = np.log(max(middle, 1e-6) / (1 - middle))
    for _ in range(60):
        p = 1 / (1 + np.exp(-np.clip(design @ beta, -30, 30)))
        gradient = design.T @ (share * (p - y)) + penalty @ beta
        curve = (design * (share * (p * (1 - p) + 1e-9))[:, None]).T @ design + penalty
        step = np.linalg.solve(curve + 1e-9 * np.eye(len(beta)), gradient)
        beta = beta - step * min(1.0, 2.0 / max(np.abs(step).max(), 1e-9))
        if np.abs(step).max() < 1e-6:
            break
    return float(beta[0]), beta[1:]


def fit_kind(scenes: list[Scene], mode: str, kind: str) -> tuple[float, dict[str, float]]:
    """Fit the weights of one kind of candidate; features with small weights are left out.

    Scenes of the other renderer count as much together as ours.
    """
    rows, labels, shares = [], [], []
    others = sum(one.source == RENDERED for one in scenes)
    share = {False: 1.0, True: max(len(scenes) - others, 1) / max(others, 1)}
    for one in scenes:
        for candidate, place in one.found[mode]:
            if candidate.kind != kind:
                continue
            off, size = errors(one, place, candidate.diameter)
            right = one.diameter > 0 and off < 2 / 3 * one.near and abs(size) < 0.2
            if right or not one.diameter or off > one.far:
                rows.append(candidate.features)
                labels.append(float(right))
                shares.append(share[one.source == RENDERED])
    if not labels or sum(labels) < 3:
        return -20.0, {}
    x, y, counts = np.array(rows), np.array(labels), np.array(shares)
    keep = np.flatnonzero(x.std(axis=0) > 1e-6)
    while True:
        middle, width = x[:, keep].mean(axis=0), x[:, keep].std(axis=0)
        constant, weights = logistic((x[:, keep] - middle) / width, y, counts)
        least = int(np.argmin(np.abs(weights)))
        if abs(weights[least]) >= LEAST_WEIGHT or len(keep) == 1:
            break
        keep = np.delete(keep, least)
    raw = weights / width
    names = [FEATURES[n] for n in keep]
    return constant - float(raw @ middle), dict(zip(names, raw.tolist(), strict=True))


def weigh(candidate: Candidate, table: dict[str, tuple[float, dict[str, float]]]) -> float:
    """Evidence of a candidate under a table of weights."""
    constant, weights = table[candidate.kind]
    values = dict(zip(FEATURES, candidate.features.tolist(), strict=True))
    return constant + sum(weight * values[name] for name, weight in weights.items())


def judged(scenes: list[Scene], mode: str, table: dict) -> tuple[list[float], list[tuple]]:
    """Return the evidence of each false finding, and the best correct finding of each hole.

    The latter are evidence, scene, distance and error of size; without a finding, the evidence
    is minus infinity.
    """
    false, right = [], []
    for one in scenes:
        holes = [
            Hole(
                place, candidate.diameter, weigh(candidate, table), candidate.kind, np.empty((0, 2))
            )
            for candidate, place in one.found[mode]
        ]
        best = None
        smallest = (DIAMETERS if one.source == SIZED else SIZES)[0]
        for hole in strongest(holes, 10e-3, -np.inf, smallest):
            off, size = errors(one, hole.place, hole.diameter)
            if one.diameter and off < one.near:
                best = best or (hole.evidence, one, off, size)
            elif not one.diameter or off > one.far:
                false.append(hole.evidence)
        if one.diameter:
            right.append(best or (-np.inf, one, np.inf, np.inf))
    return false, right


def threshold_of(false: list[float], count: int, share: float = FALSE) -> float:
    """Return the evidence with a given number of false findings an acquisition."""
    ordered = sorted(false, reverse=True)
    last = int(share * count)
    return float(ordered[last]) + 1e-6 if len(ordered) > last else -10.0


def table_of(scenes: list[Scene], mode: str) -> dict[str, tuple[float, dict[str, float]]]:
    return {kind: fit_kind(scenes, mode, kind) for kind in KINDS}


def fit(scenes: list[Scene], modes: tuple[str, ...]) -> tuple[dict, dict, dict]:
    """Return weights, thresholds, and recall by mode and source on the parts not fitted.

    The weights for all sizes are fitted on all scenes under switched lights, those of switched
    lights on all but those with other sizes.
    """
    tables, thresholds, recall = {}, {}, {}
    for mode in modes:
        frames = SWITCHED if mode == SIZED else mode
        own = [s for s in scenes if frames in s.found and (mode == SIZED or s.source != SIZED)]
        sources = list(dict.fromkeys(one.source for one in own))
        false, right = {which: [] for which in sources}, {which: [] for which in sources}
        for part in range(PARTS):
            # A seed gives two scenes, one after the other.
            table = table_of([s for n, s in enumerate(own) if n // 2 % PARTS != part], frames)
            for which in sources:
                left = [s for n, s in enumerate(own) if n // 2 % PARTS == part]
                more = judged([s for s in left if s.source == which], frames, table)
                false[which] += more[0]
                right[which] += more[1]
        counts = {which: sum(s.source == which for s in own) for which in sources}
        thresholds[mode] = max(
            threshold_of(false[which], counts[which], ASKED.get((mode, which), FALSE))
            for which in sources
            if mode != SIZED or which == SIZED
        )
        for which in sources:
            share = np.mean([best[0] >= thresholds[mode] for best in right[which]])
            alarms = sum(value >= thresholds[mode] for value in false[which]) / counts[which]
            recall[mode, which] = float(share), alarms
        tables[mode] = table_of(own, frames)
    return tables, thresholds, recall


def source(tables: dict, thresholds: dict, seeds: range, others: int) -> str:
    """The file ``hole_weights.json``, of a fit on our seeds and a number of rendered scenes."""
    most = {mode: ASKED.get((mode, OURS), FALSE) for mode in tables}
    about = (
        "Logarithms of the odds that a candidate is a hole: for each acquisition mode and kind of "
        "candidate a constant and the weights of its features, by logistic regression on own "
        f"scenes {seeds[0]} to {seeds[-1]}, each with and without a hole, and, as much, on "
        f"{others} of the other renderer. Those of switched lights on half of the own in water "
        "too, those of all sizes on own scenes with holes of 0.4 to 3 mm too. Least evidence "
        f"gives at most {most} false findings an acquisition of own scenes, and {FALSE} of each "
        f"other kind, by cross-validation in {PARTS} parts."
    )
    rounded = {
        mode: {
            kind: (round(constant, 2), {name: round(value, 2) for name, value in weights.items()})
            for kind, (constant, weights) in table.items()
        }
        for mode, table in tables.items()
    }
    least = {mode: round(value, 2) for mode, value in thresholds.items()}
    return json.dumps({"about": about, "least": least, "weights": rounded}, indent=1) + "\n"


def score(scenes: list[Scene], mode: str) -> dict:
    """Score the detector."""
    false, right = judged(scenes, mode, WEIGHTS[mode])
    least = LEAST_EVIDENCE[mode]
    hits = [best for best in right if best[0] >= least]
    off, size = np.array([best[2:] for best in hits]).T
    alarms = [value for value in false if value >= least]
    at_alarms = threshold_of(false, len(scenes))
    return {
        "scenes_with_hole": len(right),
        "scenes_without": len(scenes) - len(right),
        "recall": len(hits) / len(right),
        "recall_interval": wilson(len(hits), len(right)),
        "false_per_acquisition": len(alarms) / len(scenes),
        "recall_at_0.05_false": float(np.mean([best[0] >= at_alarms for best in right])),
        "centre_mm_median_p90": (1e3 * np.percentile(off, [50, 90])).tolist(),
        "size_within_15pct": float((np.abs(size) < 0.15).mean()),
        "recall_by_inside": {
            inside: float(np.mean([b[0] >= least for b in right if b[1].inside == inside]))
            for inside in ("dark", "backlit", "white")
        },
        "ms_per_acquisition": 1e3 * float(np.median([one.seconds[mode] for one in scenes])),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("fit", "score"))
    parser.add_argument("--first", type=int, required=True)
    parser.add_argument("--count", type=int, required=True)
    parser.add_argument("--modes", nargs="+", choices=MODES, default=MODES)
    parser.add_argument("--rendered", type=Path, help="folder of scenes of the other renderer")
    parser.add_argument("--until", type=int, default=1039, help="last of their seeds from 1000")
    asked = parser.parse_args()
    seeds = range(asked.first, asked.first + asked.count)
    modes = tuple(asked.modes)
    scenes = [scene(seed, hole, modes) for seed in seeds for hole in (True, False)]
    if asked.rendered is not None:
        from benchmarks.judge.__main__ import rendered
        from benchmarks.judge.scenes import PLAIN

        others = rendered(range(1000, asked.until + 1), asked.rendered, PLAIN)
        scenes += [rendered_scene(*one) for one in others]
    if asked.what == "fit" and "switched" in modes:
        for which, part in ((FLOODED, seeds[::2]), (SIZED, seeds)):
            scenes += [scene(seed, h, (SWITCHED,), which) for seed in part for h in (True, False)]
    if asked.what == "fit":
        modes += (SIZED,) if SWITCHED in modes else ()
        tables, thresholds, recall = fit(scenes, modes)
        print(source(tables, thresholds, seeds, sum(s.source == RENDERED for s in scenes)), end="")
        for (mode, which), (share, false) in recall.items():
            print(f"{mode}, {which}: recall {share:.3f}, false {false:.3f}", file=sys.stderr)
    else:
        print(json.dumps({mode: score(scenes, mode) for mode in modes}, indent=2))


if __name__ == "__main__":
    main()
