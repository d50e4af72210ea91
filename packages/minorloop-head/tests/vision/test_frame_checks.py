"""Verdicts on frames."""

from dataclasses import replace

import numpy as np
import pytest

from minorloop_head.geometry import Mount
from minorloop_head.procedures.meter import LIMITS
from minorloop_head.twins.camera import Camera, ImageSensor
from minorloop_head.twins.pipe import Pipe
from minorloop_head.vision.frame_checks import (
    BLURRED,
    VEILED,
    Brightness,
    check_frame,
    clarity,
    same_light,
)

from .walls import AIM, LENS, photograph


@pytest.fixture(scope="module")
def image():
    return photograph(*AIM)


@pytest.mark.parametrize(
    "image",
    [
        None,
        "frame",
        np.zeros((480, 640)),
        np.zeros((480, 641), np.uint8),
        np.zeros((480, 640, 3), np.uint8),
        np.zeros((0, 0), np.uint8),
    ],
)
def test_what_is_not_a_frame_of_this_camera(image):
    assert check_frame(image, LENS) == "wrong size"


def test_frames_of_a_live_camera_are_good(image):
    assert check_frame(image, LENS) == "good"
    assert check_frame(photograph(*AIM, seed=5), LENS, image) == "good"


def test_a_dark_frame_at_a_high_gain_is_black_and_one_with_a_lit_spot_is_not():
    noise = np.random.default_rng(3).normal(4, 12, (480, 640)).clip(0, 255).astype(np.uint8)
    assert (noise > 12).mean() > 0.2
    assert check_frame(noise, LENS) == "black"
    noise[100:130, 100:130] = 200
    assert check_frame(noise, LENS) == "good"


def test_frames_without_a_picture():
    rng = np.random.default_rng(1)
    noise = rng.integers(0, 256, (480, 640)).astype(np.uint8)
    assert check_frame(noise, LENS) == check_frame(noise, LENS, lit=False) == "no picture"
    assert check_frame(np.full((480, 640), 100, np.uint8), LENS) == "no picture"
    # A bare wall is a picture, though a dull one.
    assert check_frame(rng.normal(95, 1.5, (480, 640)).astype(np.uint8), LENS) == "good"
    assert check_frame(np.zeros((480, 640), np.uint8), LENS, lit=False) == "good"


@pytest.mark.parametrize("row", [40, 200, 401])
def test_two_halves_of_different_frames_are_torn(image, row):
    other = photograph(AIM[0] + 0.2, AIM[1] - 0.1, seed=1)
    torn = np.concatenate([image[:row], other[row:]])
    assert check_frame(torn, LENS) == "torn"
    half = image.copy()
    half[row:] = 0
    assert check_frame(half, LENS) == "torn"


def test_lights_that_cross_over_are_good_and_a_strip_of_the_same_light_is_torn():
    grey = np.full((480, 1), 120.0)
    crossing = grey * (1 + np.linspace(-0.05, 0.05, 480)[:, None])
    strip = np.where(np.arange(480)[:, None] < 160, grey, 0.9 * grey)
    verdicts = [
        same_light(*(Brightness.of(np.tile(level, (1, 640)).astype(np.uint8)) for level in pair))
        for pair in ((grey, crossing), (grey, strip))
    ]
    assert verdicts == ["good", "torn"]


@pytest.fixture(scope="module")
def camera():
    camera = Camera(Pipe.draw(3, length=51.2e-3), Mount())
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


@pytest.mark.parametrize("pixels", [2.5, 4.0])
def test_a_picture_without_fine_texture_is_blurred(camera, pixels):
    assert clarity(picture(camera, sharpest=pixels)) == BLURRED


def test_a_picture_whose_dark_is_bright_is_veiled(camera):
    image = picture(camera)
    assert clarity((0.4 * image + 60.0).astype(np.uint8)) == VEILED
