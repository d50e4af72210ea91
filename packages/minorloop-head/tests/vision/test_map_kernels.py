"""Steps from one map of the wall to another, against array expressions."""

import numpy as np
import pytest

from minorloop_head.vision import _map_kernels as kernels


@pytest.mark.parametrize("alike", [True, False])
def test_a_step_is_that_of_weighted_least_squares(alike):
    rng = np.random.default_rng(7)
    level, base = rng.normal(0.0, 0.1, (2, 30, 40)).astype(np.float32)
    both, motion, scale = rng.random((30, 40)) < 0.7, rng.normal(size=(2, 2, 30, 40)), 0.08
    told, right = np.empty((2, 2)), np.empty(2)
    kernels.weigh(level, base, both, motion, scale, alike, told, right)
    slopes = []
    for each in (base, level):
        down, across = np.gradient(each)
        slopes.append((motion[:, 0] * across + motion[:, 1] * down)[:, both])
    steep, slope = (0.5 * (slopes[0] + slopes[1]),) * 2 if alike else slopes
    rest = (level - base)[both].astype(np.float64)
    weight = 1.0 / (1.0 + (rest / scale) ** 2)
    np.testing.assert_allclose(told, (steep * weight) @ slope.T, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(right, (steep * weight) @ rest, rtol=1e-5, atol=1e-6)
