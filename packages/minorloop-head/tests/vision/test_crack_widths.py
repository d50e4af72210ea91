"""Widths of painted grooves."""

import numpy as np
import pytest
from scipy import ndimage

from minorloop_head.vision.crack_widths import measured_widths

SIDE, CORE, EVEN = 24, 9, 4.0
FINE = 50


def groove(width, flanks, blur=1.0, length=80):
    """Share taken (K, length, M) across a groove of a width in texels and flanks (K, 2)."""
    off = np.arange(-SIDE * FINE // 2, SIDE * FINE // 2 + 1) / FINE
    left, right = (off > -width / 2) & (off <= 0), (off > 0) & (off < width / 2)
    exact = np.outer(flanks[:, 0], left) + np.outer(flanks[:, 1], right)
    across = ndimage.gaussian_filter1d(exact, blur * FINE, axis=1)[:, :: FINE // 2]
    noise = np.random.default_rng(3).normal(0, 0.02, (len(flanks), length, across.shape[1]))
    return across[:, None] + noise


@pytest.mark.parametrize("width", [0.8, 1.5, 3.0, 6.0])
def test_a_black_groove_is_as_wide_as_the_light_it_takes(width):
    widths, deviations = measured_widths(groove(width, np.full((3, 2), 0.93)), SIDE, CORE, EVEN)
    assert np.median(widths) == pytest.approx(width, rel=0.12)
    assert abs(np.median(widths) - width) < 3 * np.median(deviations) + 0.05 * width


@pytest.mark.parametrize("flanks", [[[0.6, -0.8], [-0.3, 0.5], [0.2, 0.1]], [[-0.9, -0.7]] * 3])
@pytest.mark.parametrize("width", [3.0, 5.0])
def test_a_groove_that_shines_is_as_wide_as_its_flanks(width, flanks):
    widths, _ = measured_widths(groove(width, np.array(flanks)), SIDE, CORE, EVEN)
    assert np.median(widths) == pytest.approx(width, rel=0.12)
