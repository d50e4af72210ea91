"""Pictures of the simulated pipe, through a lens that is clear, blurred or veiled."""

from dataclasses import replace

import numpy as np
import pytest

from minorloop_head.geometry import Mount
from minorloop_head.procedures.meter import LIMITS
from minorloop_head.twins.camera import Camera, ImageSensor
from minorloop_head.twins.pipe import Pipe
from minorloop_head.vision.clarity import BLURRED, CLEAR, VEILED, clarity


@pytest.fixture(scope="module")
def camera():
    camera = Camera(Pipe.draw(3), Mount())
    camera.look(0.4, 0.0)
    camera.focus_at(20e-3)
    return camera


def picture(camera, **sensor):
    """A picture with a gain for a middle grey."""
    camera.sensor, gain = replace(ImageSensor(), **sensor), 1.0
    for _ in range(5):
        camera.expose(0.01, gain)
        image = camera.frame().image
        gain = LIMITS.gain(gain, image)
    return image


def test_a_picture_in_focus_is_clear(camera):
    assert clarity(picture(camera)) == CLEAR


@pytest.mark.parametrize("pixels", [2.5, 4.0])
def test_a_picture_without_fine_texture_is_blurred(camera, pixels):
    assert clarity(picture(camera, sharpest=pixels)) == BLURRED


def test_a_picture_whose_dark_is_bright_is_veiled(camera):
    image = picture(camera)
    assert clarity((0.4 * image + 60.0).astype(np.uint8)) == VEILED


def test_a_picture_of_which_little_is_lit_says_nothing(camera):
    image = picture(camera, sharpest=4.0)
    assert clarity((0.1 * image).astype(np.uint8)) == CLEAR
