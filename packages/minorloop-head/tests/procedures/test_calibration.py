import pytest

from minorloop.errors import ParameterError
from minorloop_head.procedures.calibration import HeadCalibration

from .fakes import CALIBRATION


def test_camera_and_probe_are_where_the_catheter_is():
    there = CALIBRATION.camera_at((4e-3, 0.1))
    assert there.mount.advance == 4e-3
    assert there.mount.roll == pytest.approx(0.4)
    assert CALIBRATION.probe_at((4e-3, 0.1)).mount == there.mount
    assert there.radius == CALIBRATION.probe_at((0.0, 0.0)).radius


@pytest.mark.parametrize("part", [(), ("lens",)])
def test_unknown_keys_are_refused(part):
    values = CALIBRATION.to_dict()
    inner = values["lens"] if part else values
    inner["leaver"] = 8e-3
    with pytest.raises(ParameterError, match="unknown key 'leaver'; there are"):
        HeadCalibration.from_dict(values)
