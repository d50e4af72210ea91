"""Identification against dense non-negative least squares, and how it grows."""

from __future__ import annotations

import json

import numpy as np
from scipy.optimize import nnls

from benchmarks._timing import FIXED, Row, best, dearer, faster, in_child, within
from benchmarks.one_fit import a_record
from minorloop import identify
from minorloop.identification import Plane, Smooth
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec

HARDEST = ((100, 100_000, "0"), (200, 20_000, "0"), (200, 20_000, "auto"))
LONG = ((500_000, "auto", 3.0), (5_000_000, "25", 20.0))
"""Samples and levels of long records, all other options compared, and most seconds."""
GROWTH = ((25, 20_000), (50, 20_000), (100, 2_000), (100, 5_000), (100, 50_000))


def rows(quick: bool = False) -> list[Row]:
    size = (20, 500) if quick else (50, 2_000)
    found = [_against_nnls(kind, *size) for kind in ("smooth", "rough")]
    if quick:
        return [*found, _fit(20, 500, "auto", 4)]
    dense = min(row.theirs for row in found)
    found += [_fit(100, 20_000, smoothness, 4, dense) for smoothness in ("0", "auto")]
    found += [_fit(bands, samples, smoothness, 8) for bands, samples, smoothness in HARDEST]
    found += [_fit(bands, samples, "0", 8) for bands, samples in GROWTH]
    return found + [_long(*case) for case in LONG]


def _against_nnls(kind: str, bands: int, samples: int) -> Row:
    model, u, y = a_record(bands, samples, rough=kind == "rough")
    matrix = DesignMatrix(PlaneSpec(model.levels), u, np.ones(u.size, dtype=bool), "negative")
    plain = matrix.dense()
    dense = np.column_stack([plain, -plain[:, -1]])  # the offset may have either sign
    fits, norms = [], []
    ours, theirs = best(
        lambda: fits.append(identify(u, y, Plane(model.levels, **FIXED), prior=Smooth(0.0))),
        lambda: norms.append(nnls(dense, y)[1]),
        rounds=7,
    )
    excess = u.size * fits[-1].rmse ** 2 / norms[-1] ** 2 - 1
    what = f"identify L = {bands}, N = {samples:,}, {kind} plane"
    accuracy, accurate = f"objective off by {excess:+.0e}, kkt {fits[-1].kkt:.0e}", excess <= 1e-6
    # How many times as fast depends on the version of SciPy and its linear algebra.
    return faster(what, ours, "dense nnls, matrix given", theirs, 1, accuracy, bool(accurate))


def _fit(bands: int, samples: int, smoothness: str, most: int, dense: float | None = None) -> Row:
    """A fit in a child; ``most`` GB allowed, and where given 5 times the dense seconds."""
    figures = json.loads(in_child("-m", "benchmarks.one_fit", bands, samples, smoothness))
    met = figures["kkt"] <= 1e-6 and figures["peak_gb"] < most
    what = f"identify L = {bands}, N = {samples:,}, smoothness {smoothness}"
    accuracy = f"kkt {figures['kkt']:.0e}; peak {figures['peak_gb']:.2f} of {most} GB"
    if dense is None:
        return Row(what, figures["seconds"], required="kkt, memory", met=met, accuracy=accuracy)
    way = "dense nnls of L = 50, N = 2,000"
    return dearer(what, figures["seconds"], way, dense, 5, accuracy, met)


def _long(samples: int, levels: str, most: float) -> Row:
    """A long record in a child, within so many seconds and 1.5 GB."""
    figures = json.loads(in_child("-m", "benchmarks.long_record", samples, levels))
    accuracy = f"{figures['error']:.2%} held out, L = {figures['levels']}"
    accuracy += f"; peak {figures['peak_gb']:.2f} of 1.5 GB"
    small = figures["peak_gb"] <= 1.5
    return within(f"identify N = {samples:,}", figures["seconds"], most, accuracy, small)
