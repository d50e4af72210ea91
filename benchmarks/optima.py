"""Fits of weights of either sign against dense least squares, near-singular ones among them."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from benchmarks._timing import Row
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec
from minorloop.identification.least_squares import FittedUnknowns, Problem, neighbour_differences

PROBLEMS, QUICK = 600, 40
CLOSE = 1e-9
_ROUNDING = 1e-12
_LEAST = 1e-18


@dataclass(frozen=True, eq=False)
class Dense:
    """A problem as dense rows, those of the penalty last, with outputs on a range of one."""

    rows: np.ndarray
    target: np.ndarray
    shift: float
    unit: float

    def squares(self, z: np.ndarray) -> float:
        """Sum of squares that is left, in the longest floats there are."""
        wide = np.longdouble
        return float(np.sum((self.rows.astype(wide) @ z.astype(wide) - self.target) ** 2))

    def least(self) -> float:
        """The least sum of squares by singular values, corrected twice.

        Directions whose singular values, with columns of unit length, are below 1e-12 of the
        largest are rounding, and are left out.
        """
        norms = np.linalg.norm(self.rows, axis=0)
        unit = self.rows / np.where(norms > 0, norms, 1.0)
        z = np.zeros(unit.shape[1])
        for _ in range(3):
            left = self.target - unit.astype(np.longdouble) @ z.astype(np.longdouble)
            z += np.linalg.lstsq(unit, left.astype(float), rcond=_ROUNDING)[0]
        return Dense(unit, self.target, 0.0, 1.0).squares(z)


def a_problem(seed: int) -> tuple[Problem, float]:
    """A problem with weights of either sign, and a smoothness; most are hardly determined."""
    rng = np.random.default_rng(seed)
    bands = int(rng.integers(2, 13))
    even = rng.random() < 0.5
    levels = np.linspace(-1, 1, bands + 1) if even else np.sort(rng.uniform(-1, 1, bands + 1))
    spec = PlaneSpec(
        levels,
        relay=rng.choice(["bipolar", "unipolar"]).item(),
        diagonal=rng.choice(["uniform", "reversible"]).item(),
        offset=bool(rng.random() < 0.8),
        slope=bool(rng.random() < 0.3),
    )
    samples = int(spec.unknowns * rng.choice([0.5, 1.0, 1.0, 1.2, 2.0, 5.0])) + 3
    anywhere = rng.uniform(-1, 1, samples)
    kinds = (anywhere, np.round(anywhere, 1), levels[rng.integers(0, bands + 1, samples)])
    u = kinds[rng.integers(3)]
    matrix = DesignMatrix(spec, u, np.ones(samples, dtype=bool), "negative")
    y = matrix.forward(rng.normal(size=spec.unknowns))
    y += float(rng.choice([0.0, 1e-6, 1e-3, 0.1])) * np.ptp(y) * rng.normal(size=samples)
    return Problem(matrix, y, signed=True), float(rng.choice([0.0, 0.0, 1e-8, 1e-5, 1e-3]))


def dense_of(problem: Problem, smoothness: float) -> Dense:
    """The same problem written out."""
    spec, y = problem.matrix.spec, problem.y
    shift, unit = (float(y.mean()) if spec.offset else 0.0), float(np.ptp(y)) or 1.0
    penalty = np.sqrt(smoothness * y.size) * spec.bands * neighbour_differences(spec).toarray()
    rows = np.vstack([problem.matrix.dense(), penalty])
    return Dense(rows, np.append((y - shift) / unit, np.zeros(len(penalty))), shift, unit)


def excess(problem: Problem, smoothness: float, fit: FittedUnknowns) -> float:
    """By which share the sum of squares of a fit is above the least."""
    dense, spec = dense_of(problem, smoothness), problem.matrix.spec
    z = fit.x.copy()
    if spec.offset:
        z[spec.cells] -= dense.shift
    least = dense.least()
    smallest = _LEAST * float(dense.target @ dense.target)
    return (dense.squares(z / dense.unit) - least) / (max(least, smallest) or 1.0)


def rows(quick: bool = False) -> list[Row]:
    count = QUICK if quick else PROBLEMS
    elapsed, worst, said, silent = 0.0, 0.0, 0, 0
    for seed in range(count):
        problem, smoothness = a_problem(seed)
        began = time.perf_counter()
        fit = problem.fit(smoothness)
        elapsed += time.perf_counter() - began
        above = excess(problem, smoothness, fit)
        if not fit.converged:
            said += 1
            continue
        worst = max(worst, above)
        silent += above > CLOSE
    what = f"{count} signed fits, many near-singular, each"
    accuracy = f"objective above the least by {worst:.0e} at most; {silent} by more than 1e-9 "
    accuracy += f"without saying so, {said} say that they did not converge"
    required = "0 silently off"
    return [Row(what, elapsed / count, required=required, met=silent == 0, accuracy=accuracy)]
