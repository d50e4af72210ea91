import math
from dataclasses import replace

import pytest

from minorloop.errors import ParameterError

from .fakes import CALIBRATION


def test_camera_and_probe_are_where_the_catheter_is():
    there = CALIBRATION.camera_at((4e-3, 0.1))
    assert there.mount.advance == 4e-3
    assert there.mount.roll == pytest.approx(0.4)
    assert CALIBRATION.probe_at((4e-3, 0.1)).mount == there.mount
    assert there.radius == CALIBRATION.probe_at((0.0, 0.0)).radius


@pytest.mark.parametrize("latency", [-0.01, math.nan, 60.0])
def test_a_latency_that_no_camera_has_is_refused(latency):
    with pytest.raises(ParameterError, match=r"latency is .*; give 0 to 5 s"):
        replace(CALIBRATION, latency=latency)
