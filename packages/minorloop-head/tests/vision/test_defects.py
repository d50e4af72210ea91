"""Holes beside glints, and verdicts on bad frames."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from minorloop.errors import ParameterError
from minorloop_head.geometry import wrapped
from minorloop_head.procedures.meter import acquire
from minorloop_head.vision.calibrated_camera import CalibratedCamera
from minorloop_head.vision.defects import Hole, find_holes, strongest
from papers.catheter.scene_view import draw_view


def taken(seed, **options):
    view = draw_view(seed, **options)
    camera = CalibratedCamera(view.camera.calibration, view.mount, view.camera.leds)
    return view, camera, acquire(view.camera, (view.pan, view.tilt), gain=view.gain)


@cache
def scene():
    return taken(1, hole=True, inside="backlit")


def lens():
    return scene()[1]


def shots():
    return scene()[2]


NOISE = np.random.default_rng(5)


@pytest.mark.parametrize("inside", ["dark", "white", "backlit"])
def test_a_hole_beside_a_glint_is_found_and_measured(inside):
    view, camera, looks = taken(21, hole=True, inside=inside)
    findings = find_holes(looks, camera)
    assert findings.verdict == "good"
    place = camera.place(view.camera._pixel(*view.place), view.pan, view.tilt)
    first = findings.holes[0]
    turn = 10e-3 * float(wrapped(first.place[0] - place[0]))
    assert np.hypot(turn, first.place[1] - place[1]) < 0.1e-3
    assert first.diameter == pytest.approx(view.hole.diameter, rel=0.12)
    assert "diameter" in str(findings)
    around = 10e-3 * wrapped(first.rim[:, 0] - first.place[0])
    radius = np.hypot(around, first.rim[:, 1] - first.place[1])
    assert radius.mean() == pytest.approx(first.diameter / 2, rel=0.02)


def spoilt(index, image):
    looks = list(shots())
    looks[index] = replace(looks[index], image=image)
    return looks


@pytest.mark.parametrize(
    ("looks", "verdict"),
    [
        (lambda: spoilt(0, np.zeros((480, 640), np.uint8)), "black"),
        (lambda: spoilt(4, np.full((480, 640), 255, np.uint8)), "saturated"),
        (lambda: spoilt(2, np.zeros((240, 320), np.uint8)), "wrong size"),
        (lambda: spoilt(2, [[1, 2], [3]]), "wrong size"),
        (lambda: [replace(shots()[0], pan=np.nan), *shots()[1:]], "angle unknown"),
        (lambda: [*shots()[:2], replace(shots()[2], tilt=np.inf), *shots()[3:]], "angle unknown"),
        (lambda: [*shots()[:4], replace(shots()[4], pan=3.0)], "angle unknown"),
        (lambda: spoilt(1, shots()[0].image), "frozen"),
        (lambda: spoilt(4, np.roll(shots()[4].image, 240, axis=0)), "torn"),
        (lambda: spoilt(2, np.full((480, 640), 100, np.uint8)), "no picture"),
        (lambda: spoilt(3, NOISE.integers(0, 256, (480, 640)).astype(np.uint8)), "no picture"),
        (lambda: spoilt(4, shots()[3].image + NOISE.integers(0, 2, (480, 640), np.uint8)), "black"),
    ],
)
def test_bad_frames_have_a_verdict_and_no_holes(looks, verdict):
    findings = find_holes(looks(), lens())
    assert findings.verdict == verdict
    assert findings.holes == ()
    assert findings.wall is None


def again(index):
    """The frame as it would be taken once more: another noise."""
    off = NOISE.integers(-1, 2, (480, 640))
    return np.clip(shots()[index].image.astype(int) + off, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("row", [80, 400])
@pytest.mark.parametrize("index", [1, 4])
@pytest.mark.parametrize("old", [lambda index: shots()[index].image, again])
def test_a_frame_that_holds_rows_of_the_one_before_is_torn(index, row, old):
    halves = [shots()[index].image[:row], old(index - 1)[row:]]
    assert find_holes(spoilt(index, np.vstack(halves)), lens()).verdict == "torn"
    upside = [old(index - 1)[:row], shots()[index].image[row:]]
    assert find_holes(spoilt(index, np.vstack(upside)), lens()).verdict == "torn"


def test_a_lens_that_would_be_outside_the_pipe_has_a_verdict():
    camera = lens()
    mount = replace(camera.mount, lever=6e-3)
    narrow = CalibratedCamera(camera.lens, mount, camera.leds, radius=4e-3)
    aside = [replace(look, pan=1.2) for look in shots()]
    assert find_holes(aside, narrow).verdict == "angle unknown"


@pytest.mark.parametrize("lights", [(), (True,), (True, False, False, True)])
def test_a_look_says_of_each_light_whether_it_was_on(lights):
    with pytest.raises(ParameterError, match="frame 1 has"):
        find_holes([shots()[0], replace(shots()[1], lights=lights), *shots()[2:]], lens())


def test_a_hole_on_the_seam_of_phi_counts_once():
    one, other = (
        Hole(np.array([phi, 20e-3]), 1e-3, evidence, "dark", np.empty((0, 2)))
        for phi, evidence in ((3.14, 2.0), (-3.14, 1.0))
    )
    assert strongest([other, one], 10e-3, 0.0) == (one,)
