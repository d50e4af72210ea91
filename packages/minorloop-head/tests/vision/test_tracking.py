"""Tracking a patch of the wall."""

import numpy as np
import pytest

from minorloop.errors import SignalError
from minorloop_head.vision import tracking
from minorloop_head.vision.tracking import PatchTracker

from .walls import AIM, CAMERA, PLACE, photograph, texture

TRACKER = PatchTracker(CAMERA)


def begin(angles=AIM):
    return TRACKER.begin(photograph(*angles), CAMERA.pixel(PLACE, *angles), *angles)


def test_a_turning_head_does_not_lose_it():
    _, state = begin()
    for n in range(1, 9):
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


def test_it_leaves_the_view_and_returns():
    _, state = begin()
    away = AIM + np.array([0.9, 0.0])
    for n in range(3):
        track, state = TRACKER.step(state, photograph(*away, seed=n), *away)
        assert track.verdict == "out of view"
    for n in range(3):
        track, state = TRACKER.step(state, photograph(*AIM, seed=10 + n), *AIM)
    assert track.verdict == "tracked"


def test_a_frozen_frame_and_broken_angles():
    _, state = begin()
    assert TRACKER.step(state, photograph(*AIM), *AIM)[0].verdict == "frozen"
    for seed, pan in enumerate((np.nan, None, "far"), start=1):
        track, after = TRACKER.step(state, photograph(*AIM, seed=seed), pan, 0.0)
        assert track.verdict == "angle unknown"
        assert np.isnan(track.pixel).all()
    assert TRACKER.step(after, photograph(*AIM, seed=9), *AIM)[0].verdict == "tracked"


def test_a_wall_with_detail_that_is_darker_than_its_noise_is_not_picked():
    dim = photograph(*AIM, gain=0.02, noise=3.0)
    dim[:60, :60] = 80  # a reflection: the frame is not black
    with pytest.raises(SignalError, match="too little texture for its noise"):
        TRACKER.begin(dim, CAMERA.pixel(PLACE, *AIM), *AIM)


def distance(track, angles):
    return np.hypot(*(track.pixel - CAMERA.pixel(PLACE, *angles)))


def test_a_jump_that_stays_is_believed():
    _, state = begin()
    told, verdicts = AIM + np.array([0.035, 0.0]), []
    for n in range(1, 4):
        track, state = TRACKER.step(state, photograph(*AIM, seed=n), *told)
        verdicts.append(track.verdict)
    assert verdicts[0] != "tracked"
    assert verdicts[-1] == "tracked"
    assert distance(track, AIM) < 2


@pytest.mark.parametrize("flip", [np.s_[:, ::-1], np.s_[::-1], np.s_[::-1, ::-1]])
def test_a_mirror_image_of_a_round_hole_in_the_middle_is_not_the_hole(flip):
    def hole(phi, z):
        around, along = phi - PLACE[0], z - PLACE[1]
        marks = 0.6 + 0.1 * texture(PLACE[0] + 3 * around, PLACE[1] + 3 * along)
        return np.where(np.hypot(10e-3 * around, along) < 0.5e-3, 0.02, marks)

    _, state = TRACKER.begin(photograph(*AIM, hole), CAMERA.pixel(PLACE, *AIM), *AIM)
    mirrored = np.ascontiguousarray(photograph(*AIM, hole, seed=1)[flip])
    track, state = TRACKER.step(state, mirrored, *AIM)
    assert track.verdict == "lost"
    track, _ = TRACKER.step(state, photograph(*AIM, hole, seed=2), *AIM)
    assert track.verdict == "tracked"
    assert distance(track, AIM) < 0.3


def test_one_of_many_equal_spots_is_never_taken_for_another():
    def spots(phi, z):
        x, y = 10e-3 * phi, np.asarray(z)
        return 0.5 + 0.4 * np.cos(2 * np.pi * x / 1.5e-3) * np.cos(2 * np.pi * y / 1.5e-3)

    _, state = TRACKER.begin(photograph(*AIM, spots), CAMERA.pixel(PLACE, *AIM), *AIM)
    dark = np.zeros((480, 640), np.uint8)
    for n, turn in enumerate((0.0, 0.01, 0.05, 0.06, 0.0), start=1):
        _, state = TRACKER.step(state, dark, *AIM)
        told = AIM + np.array([turn, 0.0])
        track, state = TRACKER.step(state, photograph(*AIM, spots, seed=n), *told)
        assert track.verdict != "tracked" or distance(track, AIM) < 4


def test_a_view_is_kept_only_of_a_patch_whose_surroundings_are_seen(monkeypatch):
    monkeypatch.setattr(tracking, "_FRESH", 1e-9)
    _, state = begin()
    for turn, views in ((0.34, 1), (0.05, 2)):  # at the edge of the frame, and near the middle
        angles = AIM + np.array([turn, 0.0])
        track, after = TRACKER.step(state, photograph(*angles, seed=1), *angles)
        assert track.verdict == "tracked"
        assert len(after.views) == views
