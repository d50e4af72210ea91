import pytest

from .fakes import CALIBRATION


def test_camera_and_probe_are_where_the_catheter_is():
    there = CALIBRATION.camera_at((4e-3, 0.1))
    assert there.mount.advance == 4e-3
    assert there.mount.roll == pytest.approx(0.4)
    assert CALIBRATION.probe_at((4e-3, 0.1)).mount == there.mount
    assert there.radius == CALIBRATION.probe_at((0.0, 0.0)).radius
