"""Fits without prior to several kinds of records, and how their time grows with samples and bands.

Each record is beside dense `nnls`, whose matrix is given, and beside the sparse programme of
`benchmarks.real_records` where it is installed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from scipy.optimize import nnls

from benchmarks import real_records
from benchmarks._plants import Array
from benchmarks._timing import FIXED, Row, best, seconds
from minorloop import Preisach, excitation, identify
from minorloop.identification import Plane, Smooth
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec
from minorloop.lab.columns import read_columns

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
PIEZO = "piezo_micromanipulator_minor_loops.csv"
BANDS, SAMPLES, NOISE = 25, 2_000, 1e-3
SAME = 1e-8
"""Relative difference of the objective that counts as the same."""
LENGTHS, FINENESS = (2_000, 20_000, 200_000), (25, 50, 100, 200)
"""Samples for 50 bands, and bands for 20,000 samples."""


def rows(quick: bool = False) -> list[Row]:
    found = []
    for name, u, y in records():
        found += _compared(name, u, y)
        if quick:
            return found
    grown = [_growth("N", LENGTHS, lambda samples: real_records.a_record(50, samples))]
    grown.append(_growth("L", FINENESS, lambda bands: real_records.a_record(bands, 20_000)))
    return found + grown


def records() -> Iterator[tuple[str, Array, Array]]:
    """Yield records by name: inputs from -1 to 1, and outputs."""
    rng = np.random.default_rng(1000)
    model, _, _ = real_records.a_record(BANDS, 100)
    grid = np.linspace(-1, 1, BANDS + 1)
    inputs = {
        "a decaying staircase": excitation.decaying_staircase(grid),
        "reversal curves": excitation.reversal_curves(grid),
        "random inputs": np.concatenate([[-1.0, 1.0], rng.uniform(-1, 1, SAMPLES)]),
    }
    for name, u in inputs.items():
        y = model.simulate(u)
        yield name, u, y + NOISE * np.ptp(y) * rng.normal(size=u.size)
    if (DATA / PIEZO).exists():
        u, y = read_columns(DATA / PIEZO, ["input_V", "displacement_um"]).values()
        u, y = u[200:4200:2], y[204:4204:2]  # without the virgin curve, and with its lag of 4
        yield "a piezo stage", 2 * (u - u.min()) / np.ptp(u) - 1, y


def _compared(name: str, u: Array, y: Array) -> list[Row]:
    """A fit beside `nnls` and the sparse programme, with the same optimum."""
    levels = np.linspace(-1, 1, BANDS + 1)
    fits, norms, squares = [], [], []

    def ours() -> None:
        fits.append(identify(u, y, Plane(levels, **FIXED), prior=Smooth(0.0)))

    matrix = DesignMatrix(PlaneSpec(levels), u, np.ones(u.size, dtype=bool), "negative").dense()
    dense, wanted = np.column_stack([matrix, -matrix[:, -1]]), y - y.mean()
    ours()  # loads the kernels
    elapsed, theirs = best(
        ours, lambda: norms.append(nnls(dense, wanted, maxiter=100_000)[1]), rounds=1
    )
    square = u.size * fits[-1].rmse ** 2
    what = f"identify {name}, L = {BANDS}, N = {u.size:,}"
    found = [_row(what, elapsed, "nnls", theirs, square, norms[-1] ** 2, y)]
    if find_spec(real_records.PROGRAMME):
        elapsed, theirs = best(
            ours, lambda: squares.append(real_records.programme(BANDS, u, y)), rounds=3
        )
        found.append(_row(what, elapsed, real_records.PROGRAMME, theirs, square, squares[-1], y))
    return found


def _row(
    what: str, ours: float, way: str, theirs: float, square: float, other: float, y: Array
) -> Row:
    """A comparison of times; our sum of squares must not be greater."""
    total = float(np.sum((y - y.mean()) ** 2))
    excess = (square - other) / total
    accuracy = f"our objective {excess:+.0e} of the sum of squares about theirs"
    required = f"objective no greater by {SAME:g}"
    return Row(what, ours, way, theirs, ours / theirs, required, excess <= SAME, accuracy)


def _growth(
    letter: str, sizes: tuple[int, ...], record: Callable[[int], tuple[Preisach, Array, Array]]
) -> Row:
    """Times of fits of several sizes, and the power with which they grow."""
    times = []
    for size in sizes:
        model, u, y = record(size)

        def fit(model: Preisach = model, u: Array = u, y: Array = y) -> object:
            return identify(u, y, Plane(model.levels, **FIXED), prior=Smooth(0.0))

        times.append(min(seconds(fit) for _ in range(2)))
    power = np.polyfit(np.log(sizes), np.log(times), 1)[0]
    listed = ", ".join(f"{size:,}: {time:.2g} s" for size, time in zip(sizes, times, strict=True))
    fixed = "L = 50" if letter == "N" else "N = 20,000"
    what = f"identify with {letter} = {sizes[0]:,} to {sizes[-1]:,}, {fixed}, like real"
    return Row(what, times[-1], accuracy=f"{listed}; grows as {letter}^{power:.2f}")
