import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from minorloop_head.vision.defects import find_holes
from minorloop_head.vision.recentre import outline_about
from minorloop_head.vision.reflectance_map import LitFrame, aligned, lay_flat

from .test_defects import taken
from .walls import AIM, CAMERA, photograph

ALONE = tuple(tuple(bool(n == led) for n in range(3)) for led in range(3))


def frames(gains=(1.0, 1.0, 1.0)):
    """A frame for each light, of a wall that is evenly bright."""
    return [
        LitFrame(photograph(*AIM, seed=n, gain=gain), *AIM, lights)
        for n, (lights, gain) in enumerate(zip(ALONE, gains, strict=True))
    ]


def test_the_map_is_unknown_where_a_frame_does_not_show_the_wall():
    found = lay_flat(frames(), CAMERA)
    seen = np.isfinite(found.stack)
    assert (seen == seen[0]).all()
    assert 0 < seen[0].mean() < 1
    assert found.glow is None
    assert (found.brightest >= found.darkest)[seen[0]].all()


def test_light_from_behind_is_no_reflectance():
    window = np.zeros((CAMERA.lens.height, CAMERA.lens.width), np.uint8)
    window[:, 200:400] = 40
    plain = frames()
    lit = [LitFrame(look.image + window, *AIM, look.lights) for look in plain]
    found = lay_flat([*lit, LitFrame(window, *AIM, (False,) * 3)], CAMERA)
    np.testing.assert_allclose(found.stack, lay_flat(plain, CAMERA).stack, atol=0.15)
    assert np.nanmax(found.glow) == pytest.approx(np.log(11))
    off = np.abs(lay_flat(lit, CAMERA).stack - found.stack)
    assert np.nanmax(off) > 0.3  # without the frame that shows it, it is not known


SD = math.radians(0.15)
"""Error of an angle: that of a poor sensor."""


@cache
def scene():
    """A view, its camera and an acquisition with the true angles."""
    return taken(21, hole=True, inside="dark")


def mistaken(seed):
    """The frames with wrong angles."""
    wrong = np.random.default_rng(seed).normal(0.0, SD, (5, 2))
    return [
        replace(frame, pan=frame.pan + a, tilt=frame.tilt + b)
        for frame, (a, b) in zip(scene()[2], wrong, strict=True)
    ]


def angles(frames):
    return np.array([(frame.pan, frame.tilt) for frame in frames if any(frame.lights)])


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_angles_of_frames_agree_and_keep_their_mean(seed):
    wrong = mistaken(seed)
    right = aligned(wrong, scene()[1])
    truth, before, after = (angles(frames) for frames in (scene()[2], wrong, right))
    np.testing.assert_allclose(after.mean(axis=0), before.mean(axis=0), atol=1e-12)
    left = after - truth
    assert (left - left.mean(axis=0)).std() < 0.15 * SD
    assert (right[3].pan, right[3].tilt) == (wrong[3].pan, wrong[3].tilt)  # without light


def test_an_outline_in_frames_with_wrong_angles_is_where_it_was():
    _, camera, looks = scene()
    hole = find_holes(looks, camera).holes[0]
    clicked = camera.pixel(hole.place, looks[-1].pan, looks[-1].tilt) + np.array([6.0, -5.0])
    right, wrong = (outline_about(frames, camera, clicked) for frames in (looks, mistaken(6)))
    assert math.dist(right.pixel, wrong.pixel) < 0.5


def test_a_single_frame_and_pictures_of_other_places_keep_their_angles():
    frames, camera = mistaken(9), scene()[1]
    assert aligned(frames[4:], camera) == tuple(frames[4:])
    torn = [replace(frame, image=np.roll(frame.image, 60 * n, 1)) for n, frame in enumerate(frames)]
    assert np.abs(angles(aligned(torn, camera)) - angles(frames)).max() < 2 * math.radians(1.0)
