"""Odds of cracks: ``python -m benchmarks.cracks fit`` fits and writes them, ``score`` scores them.

Places within 0.15 mm of the drawn course are those of a crack, places farther than 0.3 mm are not.
Whole lines are judged by the share of them that is on the course. ``fit`` takes scenes of our own
renderer, black cracks and grooves whose flanks return light, and the judge's with a crack that
``python -m benchmarks.judge render --first 1000`` has put into ``--folder``, each as it is and with
marks painted on it (`benchmarks.crack_maps`). It prints what odds find that are fitted with one
renderer left out, and writes those fitted on all. ``score`` prints the figures of the inspection
study with 95 % intervals on other scenes, with a scan across each fourth crack.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize

from benchmarks.crack_maps import CrackMap, painted, rendered_maps, seen_map
from minorloop.arrays import FloatArray
from minorloop_head.vision.crack_evidence import (
    LEAST_EVIDENCE,
    WEIGHTS,
    CrackOdds,
    Profiles,
    features_of,
    likely_parts,
    profiles_of,
    whole_features,
)
from minorloop_head.vision.cracks import (
    LinedWall,
    TracedCrack,
    lined_wall,
    traced_lines,
    whole_courses,
)
from papers.catheter.crack_trials import (
    crack_figures,
    outcome_of,
    score_cracks,
    search_cracks,
)
from papers.harness import Results

ON, OFF = 0.15e-3, 0.3e-3
"""Distances from the course in metres of places that are and are not on a crack."""
SAME, LEAST, MOST = 0.2e-3, 0.2, 0.6
"""Distance in metres within which a place of a line is on the course, and shares of a line that are
on it: below the first it is not that of a crack, above the second it is; others are left out."""
SHORTEST = 1.5e-3
"""In metres: shorter lines do not count."""
SCANNED = 4
"""Cracks for each one that is scanned."""
DENSE = 2
"""Every how many-th place counts: neighbours have nearly the same profile."""
OURS, FIRST = "ours", 6000
"""Our own renderer, and its first seed."""


def own_maps(seeds: range) -> list[CrackMap]:
    """Return the maps of our own scenes: with a black crack, with a lit groove, and with none."""
    found = (
        seen_map(search_cracks(seed, crack, lit=lit), OURS, seed)
        for seed in seeds
        for crack, lit in ((True, True), (True, False), (False, False))
    )
    return [one for one in found if one is not None]


def painted_on(plain: CrackMap) -> CrackMap:
    """Return a map with marks painted on it; each fourth under one light only."""
    crack, turn = len(plain.course) > 0, plain.seed % 4
    grooves = 0 if crack and plain.kind == OURS else 1 + turn // 2
    more = painted(plain, grooves, 3 if turn else 0)
    return more.under_one_light() if turn == 3 else more


@dataclass(frozen=True, eq=False)
class Lined:
    """A map with its lines, their features, and their distances from its cracks."""

    map: CrackMap
    wall: LinedWall
    lines: tuple[Profiles, ...]
    features: tuple[FloatArray, ...]
    off: tuple[FloatArray, ...]


def lined(maps: Sequence[CrackMap]) -> list[Lined]:
    """Return the maps on which anything is seen with their lines."""
    found = []
    for one in maps:
        wall = lined_wall(one.stack, one.window, one.radius, one.holes)
        if wall is not None:
            lines = tuple(profiles_of(course, wall.levels) for course in wall.courses)
            features = tuple(features_of(line, wall.texture) for line in lines)
            found.append(Lined(one, wall, lines, features, tuple(one.off(x.course) for x in lines)))
    return found


def fit(some: Sequence[Lined]) -> CrackOdds:
    """Return the odds fitted on maps; those of whole lines by trees of the other half of them."""
    rows = []
    for half in (0, 1):
        odds = trees_of([one for one in some if one.map.seed // 2 % 2 != half])
        for one in some:
            if one.map.seed // 2 % 2 == half:
                rows += whole_lines(one, odds)
    table = np.array(rows)
    whole = regression(table[:, 1:], table[:, 0] > MOST)
    return replace(trees_of(some), whole=whole)


def trees_of(some: Sequence[Lined]) -> CrackOdds:
    """Return boosted trees for the places of lines; the odds of whole lines are not known yet."""
    from sklearn.ensemble import HistGradientBoostingClassifier

    features, right = [], []
    for one in some:
        for each, off in zip(one.features, one.off, strict=True):
            sure = (off < ON) | (off > OFF)
            features.append(each[sure][::DENSE])
            right.append((off < ON)[sure][::DENSE])
    model = HistGradientBoostingClassifier(
        max_iter=150, max_depth=4, learning_rate=0.08, min_samples_leaf=80, random_state=0
    )
    return odds_of(model.fit(np.concatenate(features), np.concatenate(right)))


def whole_lines(one: Lined, odds: CrackOdds) -> list[tuple[float, ...]]:
    """Return the share on a crack and the features of whole lines, where the share is clear."""
    parts = [
        part
        for line, features in zip(one.lines, one.features, strict=True)
        for part in likely_parts(line, odds.along(features))
    ]
    rows = []
    for course in whole_courses(parts, one.wall):
        line = profiles_of(course, one.wall.levels)
        share = float((one.map.off(line.course) < SAME).mean())
        if line.length * one.map.window.step > SHORTEST and not LEAST <= share <= MOST:
            along = odds.along(features_of(line, one.wall.texture))
            rows.append((share, *whole_features(line, along)))
    return rows


def odds_of(model: Any) -> CrackOdds:
    """Return the trees of a classifier of scikit-learn; those of whole lines are not known yet."""
    trees = [step[0].nodes for step in model._predictors]
    nodes = np.concatenate(trees)
    return CrackOdds(
        base=float(np.ravel(model._baseline_prediction)[0]),
        first=np.cumsum([0, *map(len, trees[:-1])]).astype(np.int32),
        feature=np.where(nodes["is_leaf"], -1, nodes["feature_idx"]).astype(np.int8),
        threshold=nodes["num_threshold"].astype(np.float64),
        branches=np.stack([nodes["left"], nodes["right"]], axis=1).astype(np.int16),
        value=np.where(nodes["is_leaf"], nodes["value"], 0.0).astype(np.float32),
        whole=np.zeros(6),
    )


def regression(features: FloatArray, right: FloatArray, ridge: float = 0.3) -> FloatArray:
    """Return constant and weights of a logistic regression with a penalty on the weights."""
    mean, sd = features.mean(axis=0), features.std(axis=0) + 1e-9
    scaled, sign = (features - mean) / sd, np.where(right, 1.0, -1.0)

    def cost(b: FloatArray) -> tuple[float, FloatArray]:
        z = sign * (b[0] + scaled @ b[1:])
        slope = -sign / (1 + np.exp(z))
        value = np.logaddexp(0, -z).sum() + ridge * (b[1:] ** 2).sum()
        return float(value), np.append(slope.sum(), scaled.T @ slope + 2 * ridge * b[1:])

    b = minimize(cost, np.zeros(features.shape[1] + 1), jac=True).x
    return np.append(b[0] - (b[1:] * mean / sd).sum(), b[1:] / sd)


def traced_with(odds: CrackOdds, one: Lined) -> list[TracedCrack]:
    """Trace the lines of a map by given odds."""
    found = traced_lines(one.wall, one.map.window, one.map.radius, odds)
    return [crack for crack in found if crack.length >= SHORTEST]


def figures_of(some: Sequence[tuple[Lined, list[TracedCrack]]], least: float) -> dict[str, Any]:
    """Return the figures of traces with at least some evidence."""
    outcomes = []
    for one, found in some:
        traces = tuple(crack for crack in found if crack.evidence >= least)
        search = Results(**{**vars(one.map.search), "traces": traces})
        outcomes.append(outcome_of(one.map.seed, search))
    return crack_figures(outcomes)


def print_left_out(plain: Sequence[Lined], all_of: Sequence[Lined]) -> None:
    """Print what the odds find on each renderer's scenes when they are fitted on the others."""
    for kind in sorted({one.map.kind for one in plain}):
        others = [one for one in all_of if one.map.kind != kind]
        if others:
            odds = fit(others)
            found = [(one, traced_with(odds, one)) for one in plain if one.map.kind == kind]
            for least in (0.0, LEAST_EVIDENCE, 2.0):
                figures = summary(figures_of(found, least))
                print(f"{kind} left out, evidence of {least:+.1f}: {figures}")


def summary(found: dict[str, Any]) -> str:
    """Return recall by width, false findings and errors in one line."""
    recall = ", ".join(
        f"{found[f'recall_{limit}']:.2f} of {found[f'scenes_{limit}']} from {limit}"
        for limit in ("100um", "50um", "30um")
    )
    return (
        f"{recall}; false {found['false_per_acquisition']:.3f}; width off by "
        f"{found['width_error_um']:.0f} um, length by {found['length_error_pct']:.0f} %"
    )


def score(seeds: list[int], lit: bool) -> None:
    """Print the figures of scenes with the odds in use."""
    outcomes = [
        score_cracks(seed, crack, scan=n % SCANNED == 0, lit=lit)
        for n, seed in enumerate(seeds)
        for crack in (True, False)
    ]
    for name, value in crack_figures(outcomes).items():
        print(f"{name}: {value}")


def main() -> None:
    """Draw scenes, fit or score, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("fit", "score"))
    parser.add_argument("--first", type=int, nargs="+")
    parser.add_argument("--count", type=int, help="scenes; 60 to fit on, 200 to score")
    parser.add_argument("--lit", action="store_true", help="score cracks whose flanks return light")
    parser.add_argument("--folder", type=Path, default=Path("build/judge"))
    options = parser.parse_args()
    if options.what == "score":
        starts, count = options.first or [3000], options.count or 200
        score([start + k for start in starts for k in range(count)], options.lit)
        return
    first = (options.first or [FIRST])[0]
    maps = own_maps(range(first, first + (options.count or 60)))
    maps += rendered_maps(options.folder, range(1000, 2000))
    plain = lined(maps)
    all_of = plain + lined([painted_on(one) for one in maps])
    print_left_out(plain, all_of)
    odds = fit(all_of)
    odds.save(WEIGHTS)
    print(f"{len(odds.first)} trees on {len(maps)} maps of {sorted({one.kind for one in maps})}")


if __name__ == "__main__":
    main()
