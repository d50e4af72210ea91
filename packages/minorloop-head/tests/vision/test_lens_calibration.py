from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest

from minorloop.errors import RecordError
from minorloop_head.distortion import DISTORTION
from minorloop_head.vision.lens_calibration import (
    corners_in_ninths,
    fit_led,
    fit_lens,
    target_pose,
)

from .sighted_targets import LENS, all_over, held, seen

SIZE = (640, 480)


FULL = replace(LENS, k3=0.03, p1=0.004, p2=-0.003, aspect=1.08)


@pytest.mark.parametrize("lens", [LENS, FULL], ids=["square", "full"])
def test_a_lens_is_found_within_its_uncertainty(lens):
    fit = fit_lens(all_over(lens=lens), SIZE)
    true = dict(zip(("fx", "fy", "u", "v"), (*lens.focals, *lens.centre), strict=True))
    true |= {name: getattr(lens, name) for name in DISTORTION}
    for each in fit.measured:
        assert abs(each.value - true[each.name.split()[-1]]) < 4 * each.sd, each.name
    assert max(each.sd for each in fit.measured[:2]) < 2e-3 * lens.focal
    assert abs(fit.rms - np.sqrt(2) * 0.07) < 0.01
    assert fit.rms <= fit.rms_left_out < 1.05 * fit.rms
    assert corners_in_ninths(fit.seen, fit.lens).min() >= 8
    assert not fit.warnings


def test_few_pictures_say_that_they_know_little():
    off = []
    for seed in range(1000, 1010):
        with suppress(RecordError):
            fit = fit_lens(all_over(3, seed=seed, noise=0.3), SIZE)
            off += [abs(each.value - LENS.focal) / each.sd for each in fit.measured[:2]]
    assert len(off) >= 10
    assert max(off) < 4


def test_a_picture_in_which_the_target_moved_is_left_out():
    pictures = all_over()
    skewed = pictures[4].pixels + np.random.default_rng(0).normal(0, 3, pictures[4].pixels.shape)
    pictures[4] = replace(pictures[4], pixels=skewed)
    fit = fit_lens(pictures, SIZE)
    assert list(fit.left_out) == ["4.png"]
    assert "hold the target still" in fit.left_out["4.png"]
    assert abs(fit.lens.focal - LENS.focal) < 4 * fit.measured[0].sd


def upper_left_hidden():
    return [
        replace(each, points=each.points[there], pixels=each.pixels[there])
        for each in all_over(count=20)
        for there in [~((each.pixels < [215, 162]).all(axis=1))]
    ]


@pytest.mark.parametrize(
    ("pictures", "sentence"),
    [
        (all_over(12, axis=1), "no target is tilted up and down; tilt it so"),
        (all_over(12, axis=0), "no target is tilted left and right; tilt it so"),
        (upper_left_hidden(), "hardly any corners in the upper left of the image"),
    ],
    ids=["level", "upright", "uncovered"],
)
def test_thin_coverage_is_said(pictures, sentence):
    fit = fit_lens(pictures, SIZE)
    assert any(sentence in each for each in fit.warnings)
    assert abs(fit.lens.focal - LENS.focal) < 4 * fit.measured[0].sd


@pytest.mark.parametrize(
    ("pictures", "sentence"),
    [
        (all_over(count=2), "2 pictures with a target; give 3 or more"),
        pytest.param(all_over(tilt=0.0), "nowhere tilted by more than", marks=pytest.mark.whole),
        (
            [*all_over(count=8), *all_over(count=6, lens=replace(LENS, focal=600.0), seed=1001)],
            "the pictures are of two cameras, or the zoom was changed: ",
        ),
    ],
    ids=["few", "frontal", "two cameras"],
)
def test_what_nothing_determines_is_refused_with_its_cause(pictures, sentence):
    with pytest.raises(RecordError, match=sentence):
        fit_lens(pictures, SIZE)


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
