"""Tracking a patch of the wall."""

from dataclasses import replace

import numpy as np
import pytest

from minorloop.errors import ParameterError, SignalError
from minorloop.head.geometry import wall_point
from minorloop.head.vision.calibrated_camera import CalibratedCamera
from minorloop.head.vision.tracking import PatchTracker

from .walls import CAMERA, photograph

PLACE = np.array([0.5, 20e-3])
AIM = np.array(CAMERA.mount.aim(wall_point(*PLACE, 10e-3)))
TRACKER = PatchTracker(CAMERA)


def begin(angles=AIM):
    return TRACKER.begin(photograph(*angles), CAMERA.pixel(PLACE, *angles), *angles)


def test_a_turning_head_does_not_lose_it():
    _, state = begin()
    for n in range(1, 16):
        angles = AIM + 0.012 * n * np.array([np.cos(n / 3), np.sin(n / 3)])
        track, state = TRACKER.step(state, photograph(*angles, seed=n), *angles)
        assert track.verdict == "tracked"
        assert np.hypot(*(track.pixel - CAMERA.pixel(PLACE, *angles))) < 0.3
        assert track.score > 0.9


def test_angles_that_are_off_are_made_up_for():
    _, state = begin()
    told = AIM + np.array([0.02, -0.015])
    track, _ = TRACKER.step(state, photograph(*AIM, seed=1), *told)
    assert track.verdict == "tracked"
    # By 1.4 degrees: the wall looks a little different then.
    assert np.hypot(*(track.pixel - CAMERA.pixel(PLACE, *AIM))) < 1


def test_brighter_or_darker_light_does_not_matter():
    _, state = begin()
    for seed, gain in enumerate((0.4, 1.4), start=1):
        track, state = TRACKER.step(state, photograph(*AIM, gain=gain, seed=seed), *AIM)
        assert track.verdict == "tracked"
        assert np.hypot(*(track.pixel - CAMERA.pixel(PLACE, *AIM))) < 0.3


def test_a_hidden_patch_is_found_again():
    _, state = begin()
    for n in range(5):
        hidden = photograph(*AIM, lambda phi, z: 0.5 + 0 * phi, seed=n)
        track, state = TRACKER.step(state, hidden, *AIM)
        assert track.verdict == "lost"
    told, verdicts = AIM + np.array([0.04, 0.03]), []
    for n in range(10):
        track, state = TRACKER.step(state, photograph(*AIM, seed=50 + n), *told)
        verdicts.append(track.verdict)
        if track.verdict == "tracked":
            break
    assert verdicts[-1] == "tracked"
    assert np.hypot(*(track.pixel - CAMERA.pixel(PLACE, *AIM))) < 2


def test_it_leaves_the_view_and_returns():
    _, state = begin()
    away = AIM + np.array([0.9, 0.0])
    for n in range(3):
        track, state = TRACKER.step(state, photograph(*away, seed=n), *away)
        assert track.verdict == "out of view"
    for n in range(3):
        track, state = TRACKER.step(state, photograph(*AIM, seed=10 + n), *AIM)
    assert track.verdict == "tracked"


@pytest.mark.parametrize(
    ("frame", "verdict"),
    [
        (np.zeros((480, 640), np.uint8), "black"),
        (np.full((480, 640), 255, np.uint8), "saturated"),
        (np.zeros((240, 320), np.uint8), "wrong size"),
        (None, "wrong size"),
        (np.full((480, 640), np.nan), "wrong size"),
        (np.roll(photograph(*AIM), 240, axis=0), "torn"),
    ],
)
def test_a_bad_frame_is_said_to_be_bad_and_passed_over(frame, verdict):
    _, state = begin()
    track, state = TRACKER.step(state, frame, *AIM)
    assert track.verdict == verdict
    np.testing.assert_allclose(track.pixel, CAMERA.pixel(PLACE, *AIM), atol=1e-6)
    for n in range(2):
        track, state = TRACKER.step(state, photograph(*AIM, seed=n + 1), *AIM)
    assert track.verdict == "tracked"


def test_a_frozen_frame_and_broken_angles():
    _, state = begin()
    assert TRACKER.step(state, photograph(*AIM), *AIM)[0].verdict == "frozen"
    for seed, pan in enumerate((np.nan, None, "far"), start=1):
        track, after = TRACKER.step(state, photograph(*AIM, seed=seed), pan, 0.0)
        assert track.verdict == "angle unknown"
        assert np.isnan(track.pixel).all()
    assert TRACKER.step(after, photograph(*AIM, seed=9), *AIM)[0].verdict == "tracked"


def test_what_cannot_be_picked_is_refused():
    with pytest.raises(SignalError, match="does not show"):
        TRACKER.begin(photograph(*AIM), (2.0, 2.0), *AIM)
    with pytest.raises(SignalError, match="this camera"):
        TRACKER.begin(np.zeros((4, 4), np.uint8), (2.0, 2.0), *AIM)


@pytest.mark.parametrize("options", [{"size": 0.0}, {"least": 1.0}, {"size": 1e-3}])
def test_options_out_of_range_are_refused(options):
    with pytest.raises(ParameterError):
        PatchTracker(CAMERA, **options)


@pytest.mark.parametrize("level", [0, 128])
def test_nothing_is_picked_where_there_is_nothing_to_see(level):
    with pytest.raises(SignalError, match=r"black|one grey"):
        TRACKER.begin(np.full((480, 640), level, np.uint8), CAMERA.pixel(PLACE, *AIM), *AIM)


def test_a_repeated_frame_is_frozen():
    _, state = begin()
    first, second = (photograph(*AIM, seed=n) for n in (1, 2))
    for image, verdict in ((first, "tracked"), (second, "tracked"), (first, "frozen")):
        track, state = TRACKER.step(state, image, *AIM)
        assert track.verdict == verdict


def test_angles_that_no_head_in_the_pipe_has_lose_the_piece():
    camera = CalibratedCamera(CAMERA.lens, replace(CAMERA.mount, lever=11e-3), CAMERA.leds)
    _, state = begin()
    track, _ = replace(TRACKER, camera=camera).step(state, photograph(*AIM, seed=3), 1.5, 0.0)
    assert track.verdict == "lost"
