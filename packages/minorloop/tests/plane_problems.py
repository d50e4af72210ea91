"""Least-squares problems on a random Preisach plane."""

import numpy as np

from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec
from minorloop.identification.least_squares import Problem


def a_problem(bands=8, samples=200, noise=0.01, seed=0, signed=False, **spec):
    rng = np.random.default_rng(seed)
    levels = np.sort(rng.uniform(-1, 1, bands + 1))
    u = rng.uniform(-1, 1, samples)
    matrix = DesignMatrix(PlaneSpec(levels, **spec), u, np.ones(samples, dtype=bool), "negative")
    x = rng.uniform(-0.3, 1, matrix.spec.unknowns).clip(min=0)
    y = matrix.forward(x)
    return Problem(matrix, y + noise * np.ptp(y) * rng.normal(size=samples) + 5, signed)


def objective(problem, x):
    return 0.5 * np.sum((problem.matrix.forward(x) - problem.y) ** 2)
