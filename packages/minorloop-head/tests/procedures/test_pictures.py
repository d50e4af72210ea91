import math

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, gaussian_filter1d

from minorloop_head.geometry import Mount, Pinhole, wall_distance
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.pictures import (
    InspectedPicture,
    PicturePose,
    inspect_picture,
    inspect_plate,
    light_in,
    unusable,
)
from minorloop_head.vision.calibrated_camera import CalibratedCamera
from vision.walls import lit_at_the_lens, photograph

LENS = Pinhole(k1=-0.12, k2=0.02)
VIEW = HeadCalibration(lens=LENS, leds=np.zeros((1, 3)), lever=8e-3)
HOLE = (0.1, 20e-3)
GREY = np.full((480, 640), 90, np.uint8)
POSE = PicturePose(pan=math.radians(24.0), advance=1e-3, roll=0.05)
AT = Mount(lever=8e-3, advance=1e-3, roll=0.05)


def with_hole(phi, z):
    """Even metal with a black hole of 1 mm, and a black line of 0.2 mm beside it."""
    off = wall_distance(np.stack([phi, z], axis=-1), HOLE, 10e-3)
    line = (np.abs(phi - 0.4) < 0.01) & (np.abs(z - 19e-3) < 2e-3)
    return np.where((off < 0.5e-3) | line, 0.0, 0.7 + 0.02 * np.sin(9000 * z))


@pytest.fixture(scope="module")
def image():
    camera = CalibratedCamera(LENS, AT, np.zeros((1, 3)))
    return photograph(POSE.pan, POSE.tilt, with_hole, camera=camera)


@pytest.fixture(scope="module")
def picture(image):
    return inspect_picture(image, VIEW, POSE, "a.png", 1.5)


def test_a_hole_and_a_crack_are_found_where_they_are(picture):
    assert picture.verdict == "good"
    hole = next(each for each in picture.findings if each.kind == "hole or pit")
    assert wall_distance((hole.phi, hole.z), HOLE, 10e-3) < 0.1e-3
    assert hole.width == pytest.approx(1e-3, abs=0.1e-3)
    crack = next(each for each in picture.findings if each.kind == "crack")
    assert crack.phi == pytest.approx(0.4, abs=0.03)
    assert crack.length == pytest.approx(4e-3, rel=0.25)


def test_a_bad_picture_has_a_verdict_and_is_counted(image):
    black = inspect_picture(np.zeros_like(image), VIEW, POSE)
    small = inspect_picture(image[::2, ::2], VIEW, POSE)
    assert (black.verdict, black.findings) == ("black", ())
    good = InspectedPicture(name="", t=0.0, verdict="good")
    assert unusable([black, good, small, black]) == {"black": 2, "wrong size": 1}


IDEAL = HeadCalibration(lens=Pinhole(), leds=np.zeros((1, 3)), lever=8e-3)


@pytest.mark.parametrize(("pan", "tilt"), [(14.0, -32.0), (-30.0, -18.0), (6.0, 32.0)])
def test_light_fits_the_right_direction_and_tells_one_that_is_far_off(pan, tilt):
    image = lit_at_the_lens(pan, tilt)
    assert light_in(image, IDEAL, math.radians(pan), math.radians(tilt)).off is None
    off = light_in(image, IDEAL, math.radians(pan + 30.0), math.radians(tilt + 30.0)).off
    assert off == pytest.approx((-30.0, -30.0), abs=6.0)


def rough_plate(seed, cracked):
    """Grains under uneven light, perhaps with a dark wandering line of 3 pixels to row 260."""
    rng = np.random.default_rng(seed)
    grains = gaussian_filter(rng.normal(size=(320, 480)), 1.5)
    grey = 120 + 12 * grains / grains.std() + np.linspace(-20, 20, 480)
    course = 240 + 40 * np.cumsum(gaussian_filter1d(rng.normal(size=320), 8)) / 8
    off = np.abs(np.arange(480) - course[:, None])
    line = (off < 1.5) & (np.arange(320)[:, None] < 260) & cracked
    return np.clip(np.where(line, 0.6 * grey, grey), 0, 255).astype(np.uint8), course


@pytest.mark.parametrize("scale", [1, 2])
def test_a_crack_of_a_rough_plate_is_found_and_none_on_a_bare_one(scale):
    image, course = rough_plate(3, True)
    large = image.repeat(scale, axis=0).repeat(scale, axis=1)
    found = max(inspect_plate(large, 1e-3 / scale).findings, key=lambda each: each.length)
    columns, rows = ((found.outline + 0.5) / scale - 0.5).T
    assert np.abs(columns - course[np.rint(rows).astype(int)]).max() < 6
    assert 0.2 < found.length < 0.4
    assert found.width == pytest.approx(3e-3, abs=1e-3)
    assert not inspect_plate(rough_plate(3, False)[0], 1e-3).findings


def test_a_picture_of_a_plate_that_cannot_be_searched_has_a_verdict():
    found = [inspect_plate(image, 1e-3) for image in (np.zeros((320, 480), np.uint8), GREY[:4, :4])]
    assert unusable(found) == {"black": 1, "wrong size": 1}
