import math

import numpy as np
import pytest

from minorloop_head.geometry import Mount, Pinhole
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.picture_light import light_in
from minorloop_head.vision.calibrated_camera import CalibratedCamera
from vision.walls import lit_at_the_lens, photograph

VIEW = HeadCalibration(lens=Pinhole(), leds=np.zeros((1, 3)), lever=8e-3)


@pytest.mark.parametrize(("pan", "tilt"), [(14.0, -32.0), (-30.0, -18.0), (6.0, 32.0)])
def test_light_fits_the_right_direction_and_tells_one_that_is_far_off(pan, tilt):
    image = lit_at_the_lens(pan, tilt)
    assert light_in(image, VIEW, math.radians(pan), math.radians(tilt)).off is None
    off = light_in(image, VIEW, math.radians(pan + 30.0), math.radians(tilt + 30.0)).off
    assert off == pytest.approx((-30.0, -30.0), abs=6.0)


def test_light_that_fits_no_direction_does_not_contradict():
    camera = CalibratedCamera(VIEW.lens, Mount(lever=8e-3), VIEW.leds)
    even = photograph(math.radians(24.0), 0.0, camera=camera)
    assert light_in(even, VIEW, 0.0, math.radians(24.0)).off is None


def test_wall_that_is_too_far_or_too_dark_does_not_count_as_searched():
    pan, tilt = math.radians(14.0), math.radians(-32.0)
    image = lit_at_the_lens(14.0, -32.0)
    searched = light_in(image, VIEW, pan, tilt).searched
    assert 0.4 < searched < 0.95
    assert light_in(np.full_like(image, 7), VIEW, pan, tilt).searched == 0.0
    # Along the pipe most of the wall is too oblique, however bright.
    assert light_in(np.full_like(image, 200), VIEW, 0.0, 0.0).searched < searched
