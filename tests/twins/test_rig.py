import numpy as np
import pytest

from minorloop.errors import LimitError
from minorloop.lab.actuator import Frame, FrameSource
from minorloop.teleop.plant import Plant
from minorloop.twins.catheter import Catheter
from minorloop.twins.head import Head
from minorloop.twins.rig import Rig


class Watching:
    """A camera that keeps what it is told."""

    def __init__(self):
        self.told = {}

    def look(self, pan, tilt, *, rates):
        self.told["look"] = (pan, tilt, *rates)

    def place(self, advance, roll):
        self.told["place"] = advance, roll

    def focus_at(self, distance):
        self.told["focus"] = distance

    def frame(self):
        return Frame(0.0, np.zeros((2, 2), np.uint8))


def rig(camera):
    return Rig(camera, Head(), Catheter())


def test_it_is_a_head_and_a_catheter_on_one_clock():
    camera = Watching()
    both, head, catheter = rig(camera), Head(), Catheter()
    for k in range(50):
        u = np.array([0.3, 0.2, 5.0 if k > 10 else 0.0, 20.0])
        y = both.exchange(u)
        np.testing.assert_array_equal(y[:2], head.exchange(u[:2]))
        np.testing.assert_array_equal(y[2:], catheter.exchange(u[2:]))


def test_the_camera_is_told_where_it_is():
    camera = Watching()
    both = rig(camera)
    assert isinstance(both, FrameSource)
    assert isinstance(both, Plant)
    both.frame()
    assert camera.told["look"] == pytest.approx((np.radians(-30),) * 2 + (0.0, 0.0))
    for _ in range(100):
        y = both.exchange(np.array([0.35, 0.0, 10.0, 30.0]))
        both.frame()
    pan, tilt, faster, _ = camera.told["look"]
    assert (pan, tilt) == pytest.approx(np.radians(y[:2] - 30), abs=1e-9)
    assert faster > 0
    assert camera.told["place"] == pytest.approx((1e-3 * y[2], np.radians(y[3])))
    both.focus_at(0.02)
    assert camera.told["focus"] == 0.02


def test_limits_are_kept_and_safe_lets_it_cool():
    both = rig(Watching())
    with pytest.raises(LimitError):
        both.exchange(np.array([0.5, 0.0, 0.0, 0.0]))
    with pytest.raises(LimitError):
        both.exchange(np.array([0.1, 0.0, 30.0, 0.0]))
    both.safe()
