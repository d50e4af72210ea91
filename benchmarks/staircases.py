"""Planes of random weights from their decaying staircases, without noise."""

from __future__ import annotations

import time

import numpy as np

from benchmarks._timing import FIXED, Row
from minorloop import Preisach, identify
from minorloop.identification import Plane
from minorloop.identification.excitation import decaying_staircase

BANDS = (range(4, 11), range(11, 21), range(21, 31), range(31, 41))
DRAWS = 20
CLOSE = 1e-10


def error(bands: int, seed: int) -> float:
    """Worst error of a weight as a share of the largest."""
    levels = np.linspace(-1, 1, bands + 1)
    weights = np.tril(np.random.default_rng(seed).uniform(size=(bands, bands)))
    u = decaying_staircase(levels)
    found = identify(u, Preisach(levels, weights).simulate(u), Plane(levels, **FIXED)).model
    return float(np.abs(found.weights - weights).max() / weights.max())


def rows(quick: bool = False) -> list[Row]:
    found, draws = [], 2 if quick else DRAWS
    for bands in BANDS[:1] if quick else BANDS:
        began = time.perf_counter()
        worst = max(error(count, seed) for count in bands for seed in range(draws))
        each = (time.perf_counter() - began) / (draws * len(bands))
        what = f"staircases of L = {bands[0]} to {bands[-1]} without noise, {draws} draws, each"
        accuracy = f"weights off by {worst:.0e} of the largest at most"
        found.append(Row(what, each, required="<= 1e-10", met=worst <= CLOSE, accuracy=accuracy))
    return found
