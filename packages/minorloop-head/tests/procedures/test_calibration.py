import math
from dataclasses import replace

import numpy as np
import pytest

from minorloop.errors import ParameterError
from minorloop_head.geometry import Pinhole
from minorloop_head.procedures.calibration import HeadCalibration

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


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"leds": np.array([[0.0, 2.5, 0.0]])}, "an LED is 2.5 m from the lens; .* within 0.05 m"),
        ({"radius": 10.0}, "radius is 10 m; give 0.0001 to 1 m"),
        ({"lever": 8.0}, "lever is 8 m; give 0 to 1 m"),
        ({"length": 0.0}, "length is 0 m; give more than 0"),
        ({"lens": Pinhole(centre=(5000.0, 5000.0))}, "principal point .* 640 by 480 pixels"),
    ],
)
def test_numbers_that_no_head_has_are_refused(values, sentence):
    with pytest.raises(ParameterError, match=sentence):
        replace(CALIBRATION, **values)


@pytest.mark.parametrize("part", [(), ("lens",)])
def test_unknown_keys_are_refused(part):
    values = CALIBRATION.to_dict()
    inner = values["lens"] if part else values
    inner["leaver"] = 8e-3
    with pytest.raises(ParameterError, match="unknown key 'leaver'; there are"):
        HeadCalibration.from_dict(values)
