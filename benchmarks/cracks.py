"""Weights of the evidence of cracks: ``python -m benchmarks.cracks fit``; ``score`` scores them.

Places within 0.15 mm of the drawn course are those of a crack, places farther than 0.3 mm are not.
Whole lines are judged by the share of them that is on the course. Prints the weights for
``crack_evidence``, and false findings and lines found for a range of thresholds. ``score`` prints
the figures of the inspection study with 95 % intervals on other scenes, with a scan across each
fourth crack; ``--lit`` scores cracks whose flanks return light, on which nothing is fitted yet.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from scipy.optimize import minimize

from minorloop.arrays import FloatArray
from minorloop_head.procedures.trace import between
from minorloop_head.vision.crack_evidence import (
    Profiles,
    features_of,
    likely_parts,
    profiles_of,
    whole_features,
)
from minorloop_head.vision.cracks import DarkWall, dark_wall, whole_courses
from papers.catheter.crack_trials import crack_figures, score_cracks, search_cracks
from papers.harness import Results

ON, OFF = 0.15e-3, 0.3e-3
"""Distances from the course in metres of places that are and are not on a crack."""
SAME, LEAST, MOST = 0.2e-3, 0.2, 0.6
"""Distance in metres within which a place of a line is on the course, and shares of a line that are
on it: below the first it is not that of a crack, above the second it is; others are left out."""
SHORTEST = 30.0
"""Texels, 1.5 mm: shorter lines do not count."""
SCANNED = 4
"""Cracks for each one that is scanned."""
DENSE, PLACES = 2, 0.1
"""Every how many-th place counts, and its weight: neighbours have nearly the same profile."""


def regression(features: FloatArray, right: FloatArray, weight: float, ridge: float) -> FloatArray:
    """Return constant and weights of a logistic regression with a penalty on the weights."""
    mean, sd = features.mean(axis=0), features.std(axis=0) + 1e-9
    scaled, sign = (features - mean) / sd, np.where(right, 1.0, -1.0)

    def cost(b: FloatArray) -> tuple[float, FloatArray]:
        z = sign * (b[0] + scaled @ b[1:])
        slope = -weight * sign / (1 + np.exp(z))
        value = weight * np.logaddexp(0, -z).sum() + ridge * (b[1:] ** 2).sum()
        return float(value), np.append(slope.sum(), scaled.T @ slope + 2 * ridge * b[1:])

    b = minimize(cost, np.zeros(features.shape[1] + 1), jac=True).x
    return np.append(b[0] - (b[1:] * mean / sd).sum(), b[1:] / sd)


def off_course(search: Results, line: Profiles) -> FloatArray:
    """Return the distance (N,) of each place of a line from the crack; infinite without one."""
    radius = search.camera.radius
    if not len(search.course):
        return np.full(len(line.course), np.inf)
    places = search.findings.wall.window.place(line.course[:, 1], line.course[:, 0], radius)
    return between(places, search.course, radius).min(axis=1)


def dark_lines(search: Results) -> DarkWall | None:
    """Return the dark lines of a scene, except at the rims of holes."""
    wall = search.findings.wall
    holes = [(*map(float, hole.place), hole.diameter) for hole in search.findings.holes]
    return wall and dark_wall(wall.stack, wall.window, search.camera.radius, holes)


def fit(searches: list[Results]) -> dict[str, Any]:
    """Return both sets of weights, and evidence and truth of all whole lines."""
    walls = [(search, dark_lines(search)) for search in searches]
    lines = [
        [(search, wall, profiles_of(course, wall.levels)) for course in wall.courses]
        for search, wall in walls
        if wall is not None
    ]
    features, right = [], []
    for search, _, line in (one for each in lines for one in each):
        off = off_course(search, line)
        sure = (off < ON) | (off > OFF)
        features.append(features_of(line)[sure][::DENSE])
        right.append((off < ON)[sure][::DENSE])
    along = regression(np.concatenate(features), np.concatenate(right), PLACES, 1.0)
    along = tuple(np.round(along, 2).tolist())
    rows = []
    for each in lines:
        parts = [part for _, _, line in each for part in likely_parts(line, along)]
        for course in whole_courses(parts, each[0][1]) if each else ():
            line = profiles_of(course, each[0][1].levels)
            share = float((off_course(each[0][0], line) < SAME).mean())
            if line.length > SHORTEST:
                rows.append((share, *whole_features(line, along)))
    table = np.array(rows)
    clear = (table[:, 0] < LEAST) | (table[:, 0] > MOST)
    whole = regression(table[clear, 1:], table[clear, 0] > MOST, 1.0, 0.3)
    evidence = whole[0] + table[:, 1:] @ whole[1:]
    return {"along": along, "whole": whole, "evidence": evidence, "share": table[:, 0]}


def score(seeds: list[int], lit: bool) -> None:
    """Print the figures of scenes with the weights in use."""
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
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--lit", action="store_true", help="cracks whose flanks return light")
    options = parser.parse_args()
    first = options.first or [5000 if options.what == "fit" else 3000]
    if options.what == "score":
        score([start + k for start in first for k in range(options.count)], options.lit)
        return
    seeds = [start + k for start in first for k in range(options.count)]
    searches = [search_cracks(seed, crack) for seed in seeds for crack in (True, False)]
    found = fit(searches)
    print(f"ALONG = {found['along']}")
    print(f"WHOLE = {tuple(np.round(found['whole'], 2).tolist())}")
    for least in np.arange(-2.0, 2.1, 0.25):
        above = found["evidence"] >= least
        false = (above & (found["share"] < 0.5)).sum() / len(searches)
        right = (above & (found["share"] >= 0.5)).sum()
        print(f"evidence {least:+.2f}: {false:.3f} false an acquisition, {right} lines on a crack")


if __name__ == "__main__":
    main()
