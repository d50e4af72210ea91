import numpy as np
import pytest

from minorloop.errors import ParameterError
from minorloop.twins.camera import Camera
from minorloop.twins.head import Head
from minorloop.twins.pipe import Pipe
from minorloop.twins.seeing import STRAIGHT, SeeingHead, Sway


def test_the_camera_looks_along_the_pipe_when_the_joints_are_in_their_middle():
    seeing = SeeingHead(Head(), Camera(Pipe()))
    np.testing.assert_allclose(np.degrees(seeing._line_of_sight()), [-STRAIGHT, -STRAIGHT])


def test_sway_moves_the_picture_and_not_the_sensors():
    frames, readings = [], []
    for sway in (None, Sway(2.0)):
        seeing = SeeingHead(Head(seed=1), Camera(Pipe.draw(1)), sway=sway)
        for _ in range(20):
            readings.append(seeing.exchange(np.zeros(2)))
        frames.append(seeing.frame().image.astype(float))
    np.testing.assert_array_equal(readings[:20], readings[20:])
    assert np.abs(frames[0] - frames[1]).mean() > 1.0


def test_a_sway_beyond_reason_is_refused():
    with pytest.raises(ParameterError, match="give 0 to 10"):
        Sway(30.0)
