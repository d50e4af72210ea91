import numpy as np
import pytest

from minorloop_head.geometry import Mount
from minorloop_head.twins.camera import Camera
from minorloop_head.twins.catheter import Catheter
from minorloop_head.twins.head import Head
from minorloop_head.twins.pipe import Pipe
from minorloop_head.twins.rig import Rig, SimulatedTip
from minorloop_head.twins.surroundings import FULL, Filling, Sway

PIPE = Pipe.draw(1, length=51.2e-3)


def test_sway_moves_the_picture_and_not_the_sensors():
    frames, readings = [], []
    for sway in (None, Sway(0.035)):
        rig, tip = Rig(Head(seed=1), sway=sway), SimulatedTip(PIPE)
        for _ in range(20):
            readings.append(rig.exchange(np.zeros(4)))
        tip.move_to(rig.stance())
        frames.append(tip.frame().image.astype(float))
    np.testing.assert_array_equal(readings[:20], readings[20:])
    assert np.abs(frames[0] - frames[1]).mean() > 1.0


def test_a_rig_is_a_head_and_a_catheter_on_one_clock():
    both, head, catheter = Rig(Head(), Catheter()), Head(), Catheter()
    for k in range(50):
        u = np.array([0.3, 0.2, 5e-3 if k > 10 else 0.0, 0.35])
        y = both.exchange(u)
        np.testing.assert_allclose(np.degrees(y[:2]), head.exchange(u[:2]), rtol=1e-12)
        place = catheter.exchange(np.array([1e3 * u[2], np.degrees(u[3])]))
        np.testing.assert_allclose([1e3 * y[2], np.degrees(y[3])], place, rtol=1e-9)
    both.safe()


def test_a_tip_has_echoes_in_water_only_and_the_image_of_a_camera_there():
    tip = SimulatedTip(PIPE)
    tip.move_to((0.31, 0.0, 0.0, 0.0, 0.02, 0.0))
    camera = Camera(PIPE, Mount(advance=0.02))
    camera.look(0.31, 0.0)
    np.testing.assert_array_equal(tip.frame().image, camera.frame().image)
    dry = tip.shots(1)[0].trace
    tip.flood(True)
    tip.move_to((-0.35, 0.0, 0.0, 0.0, 0.02, 0.0))
    wet = tip.shots(1)[0].trace
    assert np.abs(wet[600:]).max() > 3 * np.abs(dry[600:]).max()


def test_water_cools_the_wires_and_sways_the_head_until_it_is_drained():
    flooded = Filling(level=FULL * 10e-3, temperature=10.0, sway=Sway())
    rig = Rig(Head(), Catheter(), flooded=flooded)

    def pan(seconds):
        for _ in range(round(seconds / rig.tick)):
            angles = rig.exchange(np.array([0.38, 0.0, 0.0, 0.0]))
        return np.degrees(angles[0])

    warm = pan(25.0)
    rig.flood(True)
    assert rig.sway == flooded.sway
    assert pan(25.0) < warm - 10.0
    rig.flood(False)
    assert rig.sway is None
    assert pan(25.0) == pytest.approx(warm, abs=1.0)


def test_a_tip_tells_the_plant_when_the_pipe_is_flooded():
    rig = Rig(flooded=Filling(level=FULL * 10e-3, temperature=10.0))
    tip = SimulatedTip(PIPE, flow=rig.flood)
    tip.flood(True)
    assert rig.head.surroundings.ambient == 10.0
    tip.flood(False)
    assert rig.head.surroundings.ambient == 20.0
