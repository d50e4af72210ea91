"""Sharpness of a region of an image."""

import numpy as np
import pytest

from minorloop_head.geometry import wall_point
from minorloop_head.vision.focus import peak_of, sharpness

from .walls import CAMERA, photograph

AIM = CAMERA.mount.aim(wall_point(0.5, 20e-3, 10e-3))
MIDDLE = (319.5, 239.5)
RAMP = np.add.outer(np.arange(480), np.arange(640)).astype(np.uint8)


def test_sharpness_does_not_depend_on_the_gain_and_is_blind_to_glare():
    image = photograph(*AIM, noise=0.0)
    dim = np.rint(image * 0.5).astype(np.uint8)
    assert sharpness(dim, MIDDLE) == pytest.approx(sharpness(image, MIDDLE), rel=0.05)
    glare = image.copy()
    glare[235:245, 315:325] = 255
    assert sharpness(glare, MIDDLE) == pytest.approx(sharpness(image, MIDDLE), rel=0.15)


def test_light_that_falls_off_across_the_region_leaves_the_sharpness():
    image = photograph(*AIM, noise=0.0)
    shade = np.interp(np.arange(480), (191, 287), (1.0, 0.3))[:, None]
    shaded = np.rint(image * shade).astype(np.uint8)
    assert sharpness(shaded, MIDDLE) == pytest.approx(sharpness(image, MIDDLE), rel=0.1)


@pytest.mark.parametrize(
    ("image", "pixel"),
    [
        (None, MIDDLE),
        (np.zeros((480, 640), np.uint8), MIDDLE),
        (RAMP, (np.nan, 0.0)),
        (RAMP, (5000.0, 0.0)),
    ],
)
def test_nothing_to_see_is_not_a_number(image, pixel):
    assert np.isnan(sharpness(image, pixel))


def test_a_flat_top_with_scatter_gives_the_middle_of_the_curve():
    true, errors, rng = 20e-3, [], np.random.default_rng(1)
    inverse = np.linspace(1.3, 0.7, 9) / true
    for _ in range(100):
        level = -0.1 * (true * inverse - 1) ** 2 / 0.3**2 + 0.02 * rng.standard_normal(9)
        found = peak_of(np.stack([1 / inverse, np.exp(level)], axis=1), true, 5)
        errors.append(found.distance / true - 1)
    assert np.sqrt(np.mean(np.square(errors))) < 0.03
