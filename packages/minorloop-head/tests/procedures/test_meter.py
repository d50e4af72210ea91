import numpy as np
import pytest

from minorloop_head.procedures.meter import LIMITS, Light, acquisition, meter
from minorloop_head.procedures.values import Reading, Running
from minorloop_head.vision.defects import SEQUENCE
from minorloop_head.vision.reflectance_map import ALONE

from .fakes import CALIBRATION, TICK, Loop


def metered(light):
    """Requests to a camera whose grey is light times gain, and the grey at the end."""
    asked, gain = [], Light()
    running = Running(meter(CALIBRATION, gain), asked.append)
    for k in range(1000):
        grey = np.clip(light * gain.gain, 0, 255)
        image = np.full((8, 8), grey, np.uint8)
        running.advance(Reading(t=k * TICK, angles=np.zeros(2), image=image))
        if running.done:
            return asked, light * gain.gain
    raise AssertionError("it never ended")


@pytest.mark.parametrize("light", [15.0, 60.0, 250.0])
def test_the_gain_comes_to_a_middle_grey(light):
    asked, grey = metered(light)
    assert grey == pytest.approx(LIMITS.grey, rel=0.05)
    assert len(asked) == pytest.approx(1 / TICK, abs=3)


def test_a_place_is_exposed_for_though_the_rest_of_the_picture_is_dark():
    lens = CALIBRATION.lens
    angles = np.array([0.4, 0.0])
    camera = CALIBRATION.camera_at(np.zeros(2))
    place = camera.place(np.add(lens.centre, (0.2 * lens.width, 0.0)), *angles)
    image = np.full((lens.height, lens.width), 10, np.uint8)
    image[:, lens.width // 2 :] = 200
    reading = Reading(t=0.0, angles=angles, image=image)
    lights = Light(), Light(place=place), Light(place=np.add(place, (np.pi, 0.0)))
    for light in lights:
        Running(meter(CALIBRATION, light), lambda request: None).advance(reading)
    whole, near, away = (light.gain for light in lights)
    assert near == pytest.approx((LIMITS.grey / 200) ** 0.7)
    assert away == whole > 1.5 * near


def test_each_frame_is_under_its_lights_and_all_are_on_afterwards():
    loop = Loop(sees=True)
    frames = loop.run(acquisition(3.0))
    assert [frame.lights for frame in frames] == list(SEQUENCE)
    asked = [request for request in loop.asked if request.lights is not None]
    assert [request.lights for request in asked] == list(SEQUENCE)
    longer = [request.exposure[0] / loop.asked[-1].exposure[0] for request in asked]
    np.testing.assert_allclose(longer, [ALONE] * 4 + [1.0])
    assert {request.exposure[1] for request in asked} == {3.0}
