"""A picked point is put on the outline about it."""

import numpy as np
import pytest

from minorloop_head.geometry import wrapped
from minorloop_head.vision.recentre import outline_about
from minorloop_head.vision.reflectance_map import LitFrame

from .walls import AIM, CAMERA, PLACE, photograph

TRUE = CAMERA.pixel(PLACE, *AIM)


def hole(phi, z, inside=0.1):
    off = np.hypot(10e-3 * wrapped(phi - PLACE[0]), z - PLACE[1])
    return np.where(off < 0.5e-3, inside, 0.5)


@pytest.mark.parametrize("inside", [0.1, 0.95])
def test_a_click_beside_a_hole_is_put_in_its_middle(inside):
    image = photograph(*AIM, lambda phi, z: hole(phi, z, inside), seed=1)
    for off in ((0.0, 0.0), (9.0, -6.0), (-4.0, 11.0)):
        found = outline_about([LitFrame(image, *AIM)], CAMERA, TRUE + off)
        assert np.hypot(*(found.pixel - TRUE)) < 0.6
        assert found.diameter == pytest.approx(1e-3, rel=0.06)


def test_plain_wall_and_frames_without_light_have_no_outline():
    plain = photograph(*AIM, lambda phi, z: 0.5 + 0 * phi, seed=2)
    assert outline_about([LitFrame(plain, *AIM)], CAMERA, TRUE) is None
    dark = LitFrame(plain, *AIM, lights=(False, False, False))
    assert outline_about([dark], CAMERA, TRUE) is None
