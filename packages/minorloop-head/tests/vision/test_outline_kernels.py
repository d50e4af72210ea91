"""Profiles along rays, against interpolation by ndimage."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from minorloop_head.vision import _outline_kernels as kernels

IMAGES = np.random.default_rng(5).normal(size=(3, 40, 50)).astype(np.float32)


@given(x=st.floats(-5.0, 55.0), y=st.floats(-5.0, 45.0), count=st.integers(1, kernels.SAMPLES))
def test_profiles_are_bilinear_along_the_rays_and_unknown_outside(x, y, count):
    found = np.empty((3, kernels.RAYS, kernels.SAMPLES))
    kernels._profiles(IMAGES, x, y, count, found)
    angle = 2 * np.pi * np.arange(kernels.RAYS)[:, None] / kernels.RAYS
    radius = kernels.FIRST + kernels.SPACING * np.arange(kernels.SAMPLES)
    u, v = x + radius * np.cos(angle), y + radius * np.sin(angle)
    known = (u >= 0) & (v >= 0) & (u < 49) & (v < 39) & (np.arange(kernels.SAMPLES) < count)
    for image, profile in zip(IMAGES.astype(np.float64), found, strict=True):
        plain = ndimage.map_coordinates(image, [v, u], order=1)
        np.testing.assert_allclose(profile[known], plain[known], atol=1e-9)
        assert np.isnan(profile[~known]).all()
