"""Pan and tilt from pictures of the wall alone, with good pictures and bad ones."""

import math

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from minorloop_head.geometry import Mount
from minorloop_head.twins.camera import LENS, Camera
from minorloop_head.twins.pipe import Pipe
from minorloop_head.vision.calibrated_camera import CalibratedCamera
from minorloop_head.vision.wall_angles import WallAngles
from minorloop_head.vision.wall_patches import SEEN

from .walls import CAMERA, photograph

REST = np.radians([-30.0, -30.0])
CLOSE = math.radians(0.15)

MOST_ALIKE = 170
"""Columns with more than half of them."""


class Seen:
    """A camera in a pipe, and the estimator of its angles."""

    def __init__(self):
        self.camera = Camera(Pipe.draw(1006, length=51.2e-3), Mount(), LENS.scaled(0.5), seed=1)
        self.camera.focus_at(10e-3)
        known = CalibratedCamera(self.camera.calibration, Mount(), self.camera.leds)
        self.eyes = WallAngles(known)
        for _ in range(10):
            frame = self.picture(*REST)
        self.first, self.state = self.eyes.begin(frame.image, REST, frame.t)

    def picture(self, pan, tilt):
        self.camera.look(pan, tilt)
        self.camera.expose(0.01, 0.7 if abs(pan) > 0.4 else 1.2)
        return self.camera.frame()

    def step(self, pan, tilt, spoil=lambda image: image):
        frame = self.picture(pan, tilt)
        sight, self.state = self.eyes.step(self.state, spoil(frame.image), frame.t)
        return sight

    def goes(self, degrees, tilt=REST[1]):
        """Turn to a pan in steps of half a degree."""
        start, end = float(self.state.angles[0]), math.radians(degrees)
        count = math.ceil(abs(end - start) / math.radians(0.5))
        for pan in np.linspace(start, end, count + 1)[1:]:
            sight = self.step(pan, tilt)
        return sight


@pytest.fixture
def seen():
    return Seen()


def error(sight, pan, tilt=REST[1]):
    return float(np.abs(sight.angles - [pan, tilt]).max())


def test_the_angles_of_a_turn_are_followed_and_its_return_has_no_drift(seen):
    there = seen.goes(-8.0)
    assert there.verdict == SEEN
    assert error(there, math.radians(-8.0)) < CLOSE
    back = seen.goes(-30.0)
    assert error(back, *REST) < math.radians(0.03)
    assert (back.sd < math.radians(0.02)).all()


def test_a_still_head_reads_with_little_noise(seen):
    read = np.array([seen.step(*REST).angles for _ in range(10)])
    assert np.degrees(read.std(axis=0)).max() < 0.02


def test_a_jump_that_no_picture_shows_is_found_again(seen):
    seen.goes(-14.0)
    for _ in range(6):
        sight = seen.step(*REST)
        if sight.verdict == SEEN:
            break
    assert error(sight, *REST) < CLOSE


def dirt(seed):
    """A blurred texture on the lens, which stands still in the picture."""
    rough = np.random.default_rng(seed).standard_normal((240, 320))
    smooth = gaussian_filter(rough, 6.0)
    return 60.0 + 25.0 * smooth / smooth.std()


def noisy(level, seed):
    noise = np.random.default_rng(seed).normal(0.0, 1.5, level.shape)
    return np.clip(np.rint(level + noise), 0, 255).astype(np.uint8)


def patchy(picture, columns, seed):
    """Return a picture of which only some columns at the right are seen beside dirt."""
    level = dirt(0)
    level[:, -columns:] = picture[:, -columns:]
    return noisy(level, seed)


def test_dirt_in_which_most_patches_match_elsewhere_stays_on_trial_until_the_lens_is_clean(seen):
    """Half of the picture looks as it did at rest, and goes on so while the head turns."""
    rest = seen.picture(*REST).image
    seen.goes(-14.0)
    found = []
    for n, pan in enumerate(np.radians(np.linspace(-14.0, -20.0, 13))):
        sight = seen.step(pan, REST[1], lambda _, n=n: patchy(rest, MOST_ALIKE, n))
        found += [sight] if sight.verdict == SEEN else []
    assert len(found) > 6
    assert all(each.trial and error(each, *REST) < CLOSE for each in found)
    assert found[-1].reason.startswith(
        "the view found in a search has not turned with the head yet, and "
    )
    clean = [seen.step(math.radians(-20.0), REST[1]) for _ in range(3)][-1]
    assert (clean.trial, clean.reason) == (False, "")
    assert error(clean, math.radians(-20.0)) < CLOSE


def test_a_view_that_was_found_beside_dirt_is_on_trial_until_it_turns(seen):
    seen.goes(-14.0)
    for _ in range(3):
        seen.step(*REST, dark)
    trials = []
    for n, pan in enumerate(np.radians([-28.0] * 5 + [*np.linspace(-27.5, -24.0, 8)])):
        sight = seen.step(pan, REST[1], lambda image, n=n: patchy(image, MOST_ALIKE, n))
        trials.append(sight.trial)
    assert trials[4]
    assert not sight.trial
    assert error(sight, pan) < CLOSE


def dark(image):
    return np.zeros_like(image)


def fouled(image):
    """Hide the left half behind an even grey."""
    hidden = image.copy()
    hidden[:, : image.shape[1] // 2] = 70 + image[:, : image.shape[1] // 2] // 40
    return hidden


def reflected(image):
    """Add a bright mirror image of an LED that stands still in the picture."""
    v, u = np.mgrid[: image.shape[0], : image.shape[1]]
    spot = 160 * np.exp(-((u - 90) ** 2 + (v - 130) ** 2) / (2 * 14.0**2))
    return np.clip(image + spot, 0, 255).astype(np.uint8)


def doubled(image):
    """Show a piece of the wall twice."""
    twice = image.copy()
    twice[150:210, 200:280] = image[60:120, 60:140]
    return twice


def plain(image):
    """Show wall without detail."""
    noise = np.random.default_rng(int(image.sum())).normal(0.0, 1.0, image.shape)
    v, u = np.mgrid[: image.shape[0], : image.shape[1]]
    return np.clip(120 - 0.2 * u - 0.1 * v + noise, 0, 255).astype(np.uint8)


def white(image, share):
    """The left of a picture is white."""
    image = image.copy()
    image[:, : round(share * image.shape[1])] = 255
    return image


@pytest.mark.parametrize("spoil", [fouled, reflected, doubled])
def test_patches_that_disagree_are_outvoted(seen, spoil):
    for pan in np.linspace(-30.0, -24.0, 13):
        sight = seen.step(math.radians(pan), REST[1], spoil)
    assert sight.verdict == SEEN
    assert error(sight, math.radians(-24.0)) < CLOSE
    assert error(seen.goes(-30.0), *REST) < CLOSE


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (dark, "the picture is black"),
        (plain, "of wall in view agree"),
        (lambda image: image[:100], "wrong size"),
        (lambda image: np.full_like(image, 255), "saturated"),
        (lambda image: white(image, 0.85), "of wall in view agree"),
        (lambda image: image[::-1].copy(), "of wall in view agree"),
    ],
)
def test_without_a_view_it_says_why_and_goes_on_when_it_sees_again(seen, spoil, reason):
    seen.step(*REST)
    for _ in range(3):
        sight = seen.step(*REST, spoil)
        assert np.isnan(sight.angles).all()
        assert reason in sight.reason
    pan = math.radians(-27.0)
    assert error(seen.step(pan, REST[1]), pan) < CLOSE


def test_a_repeated_picture_is_frozen_and_an_old_one_late(seen):
    frame = seen.picture(*REST)
    _, state = seen.eyes.step(seen.state, frame.image, frame.t)
    sight, state = seen.eyes.step(state, frame.image, frame.t + 0.04)
    assert sight.reason == "the picture is frozen"
    later = seen.picture(*REST)
    sight, _ = seen.eyes.step(state, later.image, frame.t - 0.5)
    assert sight.reason == "the picture is late"


def brushed(phi, z):
    """Marks around the pipe that vary little along themselves."""
    ways = np.random.default_rng(3).normal(0.0, (1800.0, 4.0, 9.0), (16, 3)).tolist()
    phi, z = np.float32(phi), np.float32(z)
    return 0.5 + 0.06 * sum(np.cos(way * z + turns * phi + shift) for way, turns, shift in ways)


def test_the_deviations_are_those_of_the_errors_also_on_brushed_metal():
    eyes = WallAngles(CAMERA, readout=0.0)

    def way(n):
        return np.radians([18 + 9 * np.sin(n / 15), 9 * np.cos(n / 15) - 4])

    _, state = eyes.begin(photograph(*way(0), brushed), way(0))
    errors, deviations = [], []
    for n in range(1, 21):
        sight, state = eyes.step(state, photograph(*way(n), brushed, seed=n), 0.04 * n)
        if sight.verdict == SEEN:
            errors.append(sight.angles - way(n))
            deviations.append(sight.sd)
    assert len(errors) > 15
    # The noise of the pictures alone gives 25.
    assert (np.sqrt(np.mean((np.array(errors) / deviations) ** 2, axis=0)) < 6).all()
