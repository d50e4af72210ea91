"""A raw log of the strip through a laser: verdicts and settled values after ``reduce``.

A hold counts as settled if another one of the same length moves the output without noise by less
than 0.2 % of the span. The twin's output without noise is read for scoring only.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from benchmarks._timing import Row
from minorloop.arrays import BoolArray, FloatArray, uniform_levels
from minorloop.identification.excitation import decaying_staircase
from minorloop.lab.conversion import LaserCurvature
from minorloop.lab.curvature import displacement_from_curvature
from minorloop.lab.records import Record
from minorloop.lab.reduction import reduce
from minorloop.lab.settling import SPAN_SHARE
from minorloop.twins.ipmc import Ipmc

D0, H0 = 20.0, 15.0
"""Distance and height of the laser, in mm."""
HOLDS = (50.0, 100.0, 150.0, 200.0)
"""Lengths of holds, in seconds: the first are too short, the last long enough."""
NOISES = (0.003, 0.02, 0.1)
"""Standard deviations of the sensor, referred to curvature, in 1/m."""
MOST_NOISE = 0.02
"""Noise up to which the shares are required: a laser 15 mm above the clamp with 2.3 um."""
INTERVAL = 0.1
INPUT_NOISE = 2e-3
BANDS = 8


@dataclass(frozen=True, eq=False)
class Scored:
    """Verdicts and errors of the holds of one log."""

    called: BoolArray
    truly: BoolArray
    z: FloatArray
    seconds: FloatArray


def rows(quick: bool) -> list[Row]:
    """Measure, and return the rows of the report."""
    specimens = range(1000, 1002) if quick else range(20)
    found = []
    for noise in NOISES:
        scored = [score(specimen, hold, noise) for specimen in specimens for hold in HOLDS]
        called, truly, z, seconds = (
            np.concatenate([getattr(one, name) for one in scored])
            for name in ("called", "truly", "z", "seconds")
        )
        right, wrong = np.mean(called[truly]), np.mean(called[~truly])
        accuracy = (
            f"{called.size} holds, {np.count_nonzero(truly)} settled: {right:.3f} of these called "
            f"settled, {wrong:.3f} of the others, {np.mean(~truly[called]):.3f} of those called; "
            f"{np.mean(np.abs(z) <= 3):.3f} of the values within three standard deviations"
        )
        must = noise <= MOST_NOISE
        required = ">= 0.95 and <= 0.05" if must else ""
        met = bool(right >= 0.95 and wrong <= 0.05) if must else None
        name = f"reduce a raw log, sensor noise {noise:g} 1/m"
        found.append(
            Row(name, float(np.median(seconds)), required=required, met=met, accuracy=accuracy)
        )
    return found


def score(specimen: int, hold: float, noise: float) -> Scored:
    """Return the scores of one specimen."""
    twin, records, truth, moves = Ipmc(specimen=specimen), [], [], []
    for level in decaying_staircase(uniform_levels(-1.2, 1.2, BANDS)):
        records.append(twin.apply(level, hold, INTERVAL))
        state = twin.checkpoint()
        moves.append(twin.apply(level, hold, hold).y[-1] - records[-1].y[-1])
        truth.append(twin.apply(level, 6000.0, 6000.0).y[-1])
        twin.restore(state)
    log = Record.joined(records)
    chance = np.random.default_rng(specimen)
    distance = 1e3 * displacement_from_curvature(log.y, D0 / 1e3, H0 / 1e3)
    distance = distance + noise * H0**2 / 2e3 * chance.normal(size=distance.size)
    u = log.u + INPUT_NOISE * chance.normal(size=log.u.size)
    raw = Record(u, distance, log.t, "voltage [V]", "distance [mm]")
    began = time.perf_counter()
    reduction = reduce(raw, conversion=LaserCurvature(D0, H0))
    seconds = time.perf_counter() - began
    points = [point for point in reduction.points if point.verdict != "passed"]
    if len(points) != len(truth):
        raise AssertionError(f"{len(points)} of {len(truth)} holds were found")
    limit = SPAN_SHARE * np.ptp(truth)
    value, sd = (np.array([getattr(point, name) for point in points]) for name in ("value", "sd"))
    return Scored(
        np.array([point.verdict == "settled" for point in points]),
        np.abs(moves) <= limit,
        (value - truth) / sd,
        np.array([seconds]),
    )
