"""Fit the evidence of the hole detector on some scenes and score it on others.

    python -m benchmarks.detector fit --first 10000 --count 460 > evidence.py
    python -m benchmarks.detector score --first 30000 --count 500

With ``--rendered FOLDER``, scenes of ``python -m benchmarks.judge render`` with seeds from 1000 to
``--until`` are fitted too.

Each seed gives a scene with a hole and one without, beside saturated glints. A finding within
0.3 mm of the hole is correct; one farther than 0.8 mm off, or without a hole, is false. Places are
compared on the map of the camera, which knows the pivot to 0.2 mm and the angles to 0.05 degrees,
so that the error of the pose is not scored.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from minorloop.head.geometry import wrapped
from minorloop.head.twins.scene_view import SceneView, draw_view
from minorloop.head.vision.calibrated_camera import CalibratedCamera
from minorloop.head.vision.candidates import FEATURES, KINDS, Candidate, candidates
from minorloop.head.vision.defects import ALONE, MODES, SEQUENCE, Hole, strongest
from minorloop.head.vision.reflectance_map import LitFrame, lay_flat

PIVOT, ANGLE, DITHER = 0.2e-3, np.deg2rad(0.05), np.deg2rad(2.0)
NEAR, FAR = 0.3e-3, 0.8e-3
FALSE = 0.05
ASKED = {"switched": 0.0125}
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
    rendered: bool = False


def shots(view: SceneView, rng: np.random.Generator, mode: str) -> list[LitFrame]:
    """Take the frames of an acquisition of a view."""
    turns = np.zeros((len(SEQUENCE), 2))
    lights = SEQUENCE
    if mode == "single":
        lights, turns = SEQUENCE[-1:], turns[:1]
    elif mode == "dither":
        lights = (SEQUENCE[-1],) * 5
        turns = DITHER * np.array([(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)])
    frames = []
    for on, turn in zip(lights, turns, strict=True):
        pan, tilt = view.pan + turn[0], view.tilt + turn[1]
        view.camera.look(pan, tilt)
        view.camera.switch(on)
        view.camera.expose(0.01 if all(on) else 0.01 * ALONE, view.gain)
        seen = np.array([pan, tilt]) + ANGLE * rng.standard_normal(2)
        frames.append(LitFrame(view.camera.frame().image, float(seen[0]), float(seen[1]), on))
    return frames


def scene(seed: int, hole: bool, modes: tuple[str, ...]) -> Scene:
    """Draw, photograph and search a scene."""
    view, rng = draw_view(seed, hole=hole), np.random.default_rng([seed, int(hole), 7])
    way = rng.uniform(0, 2 * np.pi)
    off = np.array(view.mount.offset) + PIVOT * np.array([np.cos(way), np.sin(way)])
    camera = CalibratedCamera(
        view.camera.calibration, replace(view.mount, offset=tuple(off)), view.camera.leds
    )
    place = camera.place(view.camera._pixel(*view.place), view.pan, view.tilt)
    found, seconds = {}, {}
    for mode in modes:
        frames = shots(view, rng, mode)
        start = time.thread_time()
        wall = lay_flat(frames, camera)
        objects = candidates(wall) if wall is not None else []
        seconds[mode] = time.thread_time() - start
        found[mode] = [
            (candidate, wall.window.place(candidate.x, candidate.y, camera.radius))
            for candidate in objects
        ]
    bore = view.hole
    return Scene(place, bore.diameter if bore else 0.0, bore.inside if bore else "", found, seconds)


def rendered_scene(drawn: object, radiance: np.ndarray) -> Scene:
    """Search a scene of the other renderer under switched lights."""
    from benchmarks.judge.score import frames_of

    camera, frames, place = frames_of(drawn, radiance)
    wall = lay_flat(frames, camera)
    objects = candidates(wall) if wall is not None else []
    places = [wall.window.place(each.x, each.y, camera.radius) for each in objects]
    hole = drawn.hole
    size, inside = (1e-3 * hole.mouth, hole.inside) if hole else (0.0, "")
    return Scene(
        place, size, inside, {"switched": list(zip(objects, places, strict=True))}, {}, True
    )


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
    others = sum(one.rendered for one in scenes)
    share = {False: 1.0, True: max(len(scenes) - others, 1) / max(others, 1)}
    for one in scenes:
        for candidate, place in one.found[mode]:
            if candidate.kind != kind:
                continue
            off, size = errors(one, place, candidate.diameter)
            right = one.diameter > 0 and off < 0.2e-3 and abs(size) < 0.2
            if right or not one.diameter or off > FAR:
                rows.append(candidate.features)
                labels.append(float(right))
                shares.append(share[one.rendered])
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
        for hole in strongest(holes, 10e-3, -np.inf):
            off, size = errors(one, hole.place, hole.diameter)
            if one.diameter and off < NEAR:
                best = best or (hole.evidence, one, off, size)
            elif not one.diameter or off > FAR:
                false.append(hole.evidence)
        if one.diameter:
            right.append(best or (-np.inf, one, np.inf, np.inf))
    return false, right


def wilson(hits: int, count: int) -> tuple[float, float]:
    """95 % interval of a share (Wilson, 1927)."""
    z, p = 1.959964, hits / count
    middle = (p + z * z / (2 * count)) / (1 + z * z / count)
    half = z / (1 + z * z / count) * np.sqrt(p * (1 - p) / count + z * z / (4 * count**2))
    return float(middle - half), float(middle + half)


def threshold_of(false: list[float], count: int, share: float = FALSE) -> float:
    """Return the evidence with a given number of false findings an acquisition."""
    ordered = sorted(false, reverse=True)
    last = int(share * count)
    return float(ordered[last]) + 1e-6 if len(ordered) > last else -10.0


def table_of(scenes: list[Scene], mode: str) -> dict[str, tuple[float, dict[str, float]]]:
    return {kind: fit_kind(scenes, mode, kind) for kind in KINDS}


def fit(scenes: list[Scene], modes: tuple[str, ...]) -> tuple[dict, dict, dict]:
    """Return weights, thresholds, and recall on the halves that were not fitted."""
    tables, thresholds, recall = {}, {}, {}
    for mode in modes:
        own = [one for one in scenes if mode in one.found]
        false: dict[bool, list[float]] = {True: [], False: []}
        right = []
        for part in range(PARTS):
            # A seed gives two scenes, one after the other.
            table = table_of([s for n, s in enumerate(own) if n // 2 % PARTS != part], mode)
            for which in false:
                left = [s for n, s in enumerate(own) if n // 2 % PARTS == part]
                more = judged([s for s in left if s.rendered == which], mode, table)
                false[which] += more[0]
                right += more[1]
        limits = {True: FALSE, False: ASKED.get(mode, FALSE)}
        thresholds[mode] = max(
            threshold_of(false[which], sum(s.rendered == which for s in own), limits[which])
            for which in (True, False)
        )
        recall[mode] = float(np.mean([best[0] >= thresholds[mode] for best in right]))
        tables[mode] = table_of(own, mode)
    return tables, thresholds, recall


def source(tables: dict, thresholds: dict, first: int, count: int) -> str:
    """The module ``_evidence.py``."""
    lines = [
        '"""Weights of the features of a candidate, for each acquisition mode.',
        "",
        "They give the logarithm of the odds that a candidate is a hole, by logistic regression on",
        f"scenes {first} to {first + count - 1}, each with and without a hole; printed by",
        "``python -m benchmarks.detector fit``. Cross-validation gives at the thresholds",
        *(f"{ASKED.get(mode, FALSE)} false findings an acquisition ({mode})," for mode in tables),
        "where each half of the seeds is one set of scenes.",
        '"""',
        "",
        "from __future__ import annotations",
        "",
        "THRESHOLDS = {",
    ]
    lines += [f'    "{mode}": {value:.2f},' for mode, value in thresholds.items()]
    lines += ["}", "", "WEIGHTS: dict[str, dict[str, tuple[float, dict[str, float]]]] = {"]
    for mode, table in tables.items():
        lines.append(f'    "{mode}": {{')
        for kind, (constant, weights) in table.items():
            lines += [f'        "{kind}": (', f"            {constant:.2f},", "            {"]
            lines += [f'                "{name}": {value:.2f},' for name, value in weights.items()]
            lines += ["            },", "        ),"]
        lines.append("    },")
    return "\n".join([*lines, "}", ""])


def score(scenes: list[Scene], mode: str) -> dict:
    """Score the detector."""
    from minorloop.head.vision._evidence import THRESHOLDS, WEIGHTS

    false, right = judged(scenes, mode, WEIGHTS[mode])
    least = THRESHOLDS[mode]
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

        others = rendered(range(1000, asked.until + 1), asked.rendered)
        scenes += [rendered_scene(*one) for one in others]
    if asked.what == "fit":
        print(source(*fit(scenes, modes)[:2], asked.first, asked.count), end="")
    else:
        print(json.dumps({mode: score(scenes, mode) for mode in modes}, indent=2))


if __name__ == "__main__":
    main()
