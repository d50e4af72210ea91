import math

import numpy as np
import pytest

from minorloop_head.geometry import Mount
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.seen_base import SeenBase
from minorloop_head.twins.camera import LENS
from minorloop_head.twins.pipe import Pipe
from minorloop_head.twins.rig import SimulatedTip

AIM = np.radians([-20.0, -15.0])
PLACE = np.array([10e-3, 0.4])


@pytest.fixture(scope="module")
def tip():
    pipe, optics = Pipe.draw(3, length=51.2e-3), LENS.scaled(0.5)
    made = SimulatedTip(pipe, mount=Mount(), specimen=3, seed=3, optics=optics)
    made.expose(0.01, 3.0)
    made.focus_at(20e-3)
    return made


@pytest.fixture
def base(tip):
    view = HeadCalibration(lens=tip.camera.calibration, leds=tip.camera.leds)
    return SeenBase(view)


def picture(tip, joints, turned, place=PLACE):
    tip.move_to((*(joints + turned).tolist(), 0.0, 0.0, *place.tolist()))
    return tip.frame().image


def begun(tip, base):
    for n in range(5):
        base.read(0.04 * n, AIM, PLACE)
    base.begin(picture(tip, AIM, np.zeros(2)), 0.16)
    return base


def test_what_the_joints_do_not_explain_is_the_turn_of_the_base_while_the_catheter_rolls(tip, base):
    begun(tip, base)
    for n in range(4):
        t, place = 1.0 + n, PLACE + np.array([0.0, 0.03 * n])
        joints, turned = AIM + math.radians(1.5) * n, np.radians([(-1.0) ** n, 0.5])
        base.read(t, joints, place)
        base.see(picture(tip, joints, turned, place), t)
        assert np.degrees(base.at(t)) == pytest.approx(np.degrees(turned), abs=0.05)


def test_a_roll_beyond_what_the_first_picture_shows_is_followed(tip, base):
    begun(tip, base)
    for n in range(1, 19):
        t, place = float(n), PLACE + np.radians([0.0, 10.0 * n])
        turned = np.radians([0.7 * (-1.0) ** n, 0.5])
        base.read(t, AIM, place)
        base.see(picture(tip, AIM, turned, place), t)
    assert np.degrees(base.at(18.0)) == pytest.approx(np.degrees(turned), abs=0.3)


def test_the_turn_is_that_of_the_time_of_the_burst(tip, base):
    begun(tip, base)
    for t, turned in ((1.0, 0.0), (1.2, 0.01)):
        base.read(t, AIM, PLACE)
        base.see(picture(tip, AIM, np.array([turned, 0.0])), t)
    assert base.at(1.05)[0] == pytest.approx(0.0025, abs=1e-3)
    assert base.at(1.215)[0] == pytest.approx(0.01, abs=1e-3)
    assert np.isnan(base.at(1.25)).all()
    assert np.isnan(base.at(0.6)).all()


def test_a_picture_that_arrives_late_is_compared_with_the_joints_of_its_time(tip, base):
    begun(tip, base)
    for n in range(6):
        base.read(1.0 + 0.04 * n, AIM + 0.01 * n, PLACE)
    base.see(picture(tip, AIM + 0.025, np.array([0.01, -0.01])), 1.1)
    assert base.at(1.1) == pytest.approx([0.01, -0.01], abs=2e-3)


def test_a_picture_that_does_not_show_the_wall_gives_no_turn_and_says_why(tip, base):
    assert np.isnan(base.at(0.0)).all()
    base.see(picture(tip, AIM, np.zeros(2)), 0.0)
    assert not base.begun
    base.read(0.0, AIM, PLACE)
    base.begin(np.zeros((240, 320), np.uint8), 0.0)
    assert not base.begun
    assert "black" in base.why
    begun(tip, base)
    base.read(1.0, AIM, PLACE)
    base.see(np.zeros((240, 320), np.uint8), 1.0)
    assert np.isnan(base.at(1.0)).all()
    assert "black" in base.why
    base.read(2.0, AIM, PLACE)
    base.see(picture(tip, AIM + math.radians(8.0), np.zeros(2)), 2.0)
    assert np.isnan(base.at(2.0)).all()
