"""Angles of the head from the image of one point."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from minorloop_head.vision.servo import sighted_angles

from .walls import AIM, CAMERA, PLACE

TURN = st.floats(-0.25, 0.25)


@settings(max_examples=30, deadline=None)
@given(TURN, TURN)
def test_the_angles_are_those_that_show_the_point_there(pan, tilt):
    true = AIM + np.array([pan, tilt])
    pixel = CAMERA.pixel(PLACE, *true)
    assert_allclose(sighted_angles(CAMERA, PLACE, pixel, AIM), true, atol=1e-6)


@pytest.mark.parametrize(
    "asked",
    [
        (PLACE, (np.nan, 240.0), AIM),
        (PLACE, (320.0, 240.0), (np.nan, 0.0)),
        (PLACE, (320.0,), AIM),
        ((0.5, -20e-3), (320.0, 240.0), (0.0, 0.0)),
    ],
)
def test_what_cannot_be_seen_gives_none(asked):
    assert sighted_angles(CAMERA, *asked) is None
