import numpy as np
import pytest

from minorloop.errors import RecordError
from minorloop_head.vision.led_calibration import find_reflection, fit_led
from minorloop_head.vision.lens_calibration import target_pose

from .sighted_targets import LENS, held, seen

LED = np.array([1.2e-3, -2.2e-3, 0.3e-3])


def reflected(count=8, noise=0.1):
    """Poses of a glossy target, and pixels of the LED in it."""
    rng, poses, pixels = np.random.default_rng(1000), [], []
    for number in range(count):
        pose = held((0.0, 0.0), rng.uniform(0.015, 0.03), [*rng.uniform(-6, 6, 2), 0.0])
        poses.append(target_pose(LENS, seen(f"{number}.png", *pose), 0.07))
        normal = pose[0][:, 2]
        mirrored = LED - 2 * (normal @ (LED - pose[1])) * normal
        pixels.append(LENS.project(mirrored) + rng.normal(0, noise, 2))
    return poses, np.array(pixels)


def test_an_led_is_found_within_its_uncertainty():
    place, sd = fit_led(LENS, *reflected(), "LED 1")
    assert (np.abs(place - LED) < 4 * sd).all()
    assert (sd[:2] < 0.1e-3).all()


def test_refuses_few_reflections_and_those_of_several_leds():
    poses, pixels = reflected()
    with pytest.raises(RecordError, match="3 pictures with one reflection of LED 2; give 4"):
        fit_led(LENS, poses[:3], pixels[:3], "LED 2")
    with pytest.raises(RecordError, match="not those of one LED"):
        fit_led(LENS, poses, pixels[::-1] + 40.0, "LED 2")
    with pytest.raises(RecordError, match="all alike; hold the target at other distances"):
        fit_led(LENS, poses[:1] * 5, np.tile(pixels[0], (5, 1)), "LED 2")


def test_one_saturated_spot_is_a_reflection():
    image = np.full((40, 60), 80, np.uint8)
    assert find_reflection(image) is None
    image[10:13, 20:25] = 255
    assert find_reflection(image).tolist() == [22.0, 11.0]
    image[30:33, 40:44] = 255
    assert find_reflection(image) is None
