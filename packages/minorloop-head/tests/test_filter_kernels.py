"""Smoothing in single precision, against ndimage."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from minorloop_head._filter_kernels import MIRROR, ZERO, gaussian, smooth

MODES = {MIRROR: "reflect", ZERO: "constant"}


@given(
    shape=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    sd=st.floats(0.5, 12.0),
    truncate=st.floats(1.0, 4.0),
    beyond=st.sampled_from([MIRROR, ZERO]),
    seed=st.integers(0, 1000),
)
def test_a_gaussian_is_that_of_ndimage(shape, sd, truncate, beyond, seed):
    image = np.random.default_rng(seed).uniform(-1.0, 1.0, shape).astype(np.float32)
    plain = ndimage.gaussian_filter(
        image.astype(np.float64), sd, truncate=truncate, mode=MODES[beyond]
    )
    np.testing.assert_allclose(gaussian(image, sd, truncate, beyond), plain, atol=2e-6)


@pytest.mark.parametrize("size", [3, 19])
def test_equal_shares_are_a_mean_over_a_box(size):
    image = np.random.default_rng(size).uniform(0.0, 1.0, (31, 23)).astype(np.float32)
    shares = np.full(size // 2 + 1, 1.0 / size, np.float32)
    out = np.empty_like(image)
    smooth(image, shares, ZERO, out)
    plain = ndimage.uniform_filter(image.astype(np.float64), size, mode="constant")
    np.testing.assert_allclose(out, plain, atol=1e-6)
