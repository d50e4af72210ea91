"""Bringing a region into focus."""

import itertools

import numpy as np
import pytest
from scipy import ndimage

from minorloop_head.procedures.focus import focus, peak_of, sharpness
from minorloop_head.procedures.values import Reading, Running
from minorloop_head.sources import Frame
from vision.walls import AIM, CAMERA, photograph

MIDDLE = (319.5, 239.5)


def autofocus(lens, camera, pixel, guess):
    """Run a sweep to its end."""

    def carry_out(request):
        if request.focus is not None:
            lens.focus_at(request.focus)

    running, image = Running(focus(camera.lens, pixel, guess), carry_out), None
    for tick in range(1000):
        asked = running.advance(Reading(t=0.04 * tick, angles=np.zeros(2), image=image))
        if running.done:
            return running.result
        image = lens.frame().image if asked.frame else None
    raise AssertionError("the sweep did not end")


class Lens:
    """A camera whose blur grows with the error of its focus, and whose frames may be spoiled."""

    def __init__(self, best, spoil=lambda image: image, blur=0.08):
        self.best, self.spoil, self.now, self.count = best, spoil, 10e-3, 0
        self.blur = blur
        self.plain = photograph(*AIM, noise=0.0).astype(float)

    def focus_at(self, distance):
        self.now = distance

    def frame(self):
        self.count += 1
        off = self.blur * abs(1 / self.now - 1 / self.best)
        image = self.plain.copy()
        image[160:320, 240:400] = ndimage.gaussian_filter(image[160:320, 240:400], 0.5 + off)
        image += np.random.default_rng(self.count).normal(0, 1.0, image.shape)
        image = np.clip(np.rint(image), 0, 255).astype(np.uint8)
        return Frame(0.04 * self.count, self.spoil(image))


@pytest.mark.parametrize(("best", "guess"), [(10e-3, 9e-3), (14e-3, 10e-3), (8e-3, 12e-3)])
def test_the_sharpest_distance_is_found_from_a_poor_guess(best, guess):
    lens = Lens(best)
    found = autofocus(lens, CAMERA, MIDDLE, guess)
    assert found.verdict == "sharp"
    assert 1 / found.distance == pytest.approx(1 / best, abs=4)
    assert lens.now == found.distance
    assert (np.diff(found.curve[:, 0]) > 0).all()


def test_a_wall_nearer_than_the_focus_is_reported():
    found = autofocus(Lens(3e-3), CAMERA, MIDDLE, 5e-3)
    assert found.verdict == "at the end"
    assert found.distance == pytest.approx(4e-3, rel=0.05)


def test_an_even_wall_has_nothing_to_focus_on():
    """Of 60 walls of noise, 2 are called sharp."""
    seeds = itertools.count()

    def even(image):
        return np.random.default_rng(next(seeds)).normal(100, 1, image.shape).astype(np.uint8)

    found = autofocus(Lens(10e-3, even), CAMERA, MIDDLE, 9e-3)
    assert found.verdict == "nothing to focus on"
    assert found.distance == 9e-3


def test_sharpness_does_not_depend_on_the_gain_and_is_blind_to_glare():
    image = photograph(*AIM, noise=0.0)
    dim = np.rint(image * 0.5).astype(np.uint8)
    assert sharpness(dim, MIDDLE) == pytest.approx(sharpness(image, MIDDLE), rel=0.05)
    glare = image.copy()
    glare[235:245, 315:325] = 255
    assert sharpness(glare, MIDDLE) == pytest.approx(sharpness(image, MIDDLE), rel=0.15)


def test_a_flat_top_with_scatter_gives_the_middle_of_the_curve():
    true, errors, rng = 20e-3, [], np.random.default_rng(1)
    inverse = np.linspace(1.3, 0.7, 9) / true
    for _ in range(100):
        level = -0.1 * (true * inverse - 1) ** 2 / 0.3**2 + 0.02 * rng.standard_normal(9)
        found = peak_of(np.stack([1 / inverse, np.exp(level)], axis=1), true, 5)
        errors.append(found.distance / true - 1)
    assert np.sqrt(np.mean(np.square(errors))) < 0.03
