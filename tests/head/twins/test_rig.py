import numpy as np
import pytest

from minorloop.errors import LimitError, ParameterError
from minorloop.head.geometry import Mount
from minorloop.head.twins.camera import Camera
from minorloop.head.twins.catheter import Catheter
from minorloop.head.twins.head import Head
from minorloop.head.twins.pipe import Pipe
from minorloop.head.twins.rig import STRAIGHT, Rig, SimulatedTip, Sway


def test_the_camera_looks_along_the_pipe_when_the_joints_are_in_their_middle():
    np.testing.assert_allclose(np.degrees(Rig().stance()[:2]), [-STRAIGHT, -STRAIGHT])


def test_sway_moves_the_picture_and_not_the_sensors():
    frames, readings = [], []
    for sway in (None, Sway(2.0)):
        rig, tip = Rig(Head(seed=1), sway=sway), SimulatedTip(Pipe.draw(1))
        for _ in range(20):
            readings.append(rig.exchange(np.zeros(4)))
        tip.stand(rig.stance())
        frames.append(tip.frame().image.astype(float))
    np.testing.assert_array_equal(readings[:20], readings[20:])
    assert np.abs(frames[0] - frames[1]).mean() > 1.0


def test_a_sway_beyond_reason_is_refused():
    with pytest.raises(ParameterError, match="give 0 to 10"):
        Sway(30.0)


def test_a_rig_is_a_head_and_a_catheter_on_one_clock():
    both, head, catheter = Rig(Head(), Catheter()), Head(), Catheter()
    for k in range(50):
        u = np.array([0.3, 0.2, 5.0 if k > 10 else 0.0, 20.0])
        y = both.exchange(u)
        np.testing.assert_array_equal(y[:2], head.exchange(u[:2]))
        np.testing.assert_array_equal(y[2:], catheter.exchange(u[2:]))
    both.safe()


def test_a_stance_is_where_the_rig_is():
    rig = Rig(Head(), Catheter())
    assert rig.stance() == pytest.approx((np.radians(-30), np.radians(-30), 0.0, 0.0, 0.0, 0.0))
    for _ in range(100):
        y = rig.exchange(np.array([0.35, 0.0, 10.0, 30.0]))
    pan, tilt, faster, _, advance, roll = rig.stance()
    assert (pan, tilt) == pytest.approx(np.radians(y[:2] - STRAIGHT), abs=1e-9)
    assert faster > 0
    assert (advance, roll) == pytest.approx((1e-3 * y[2], np.radians(y[3])))


def test_limits_of_a_rig_are_kept():
    for u in ([0.5, 0.0, 0.0, 0.0], [0.1, 0.0, 30.0, 0.0]):
        with pytest.raises(LimitError):
            Rig().exchange(np.array(u))


def test_a_tip_has_echoes_in_water_only_and_the_image_of_a_camera_there():
    tip = SimulatedTip(Pipe.draw(1))
    tip.stand((0.31, 0.0, 0.0, 0.0, 0.02, 0.0))
    camera = Camera(Pipe.draw(1), Mount(advance=0.02))
    camera.look(0.31, 0.0)
    np.testing.assert_array_equal(tip.frame().image, camera.frame().image)
    dry = tip.shots(1)[0].trace
    tip.flood(True)
    tip.stand((0.31, 0.0, 0.0, 0.0, 0.02, 0.0))
    wet = tip.shots(1)[0].trace
    assert np.abs(wet[600:]).max() > 3 * np.abs(dry[600:]).max()
