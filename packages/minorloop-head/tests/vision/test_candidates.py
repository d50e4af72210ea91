"""Round objects on painted maps."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from minorloop_head.vision.calibrated_camera import Window
from minorloop_head.vision.candidates import FEATURES, Candidate, at_rim, candidates
from minorloop_head.vision.reflectance_map import ReflectanceMap

STEP = 0.05e-3
ROWS, COLUMNS = np.mgrid[:140, :160].astype(float)


def disc(x, y, diameter, depth):
    """Logarithm of the reflectance of a wall of 1 with a round patch of exp(depth)."""
    off = np.hypot(COLUMNS - x, ROWS - y)
    share = np.clip(0.5 + diameter / 2 / STEP - off, 0, 1)
    return np.log(ndimage.gaussian_filter(1 + share * (np.exp(depth) - 1), 0.8))


def wall(levels, *, glow=None, noise=0.03, hidden=None):
    rng = np.random.default_rng(0)
    stack = np.array([level + rng.normal(0, noise, level.shape) for level in levels], np.float32)
    if hidden is not None:
        stack[:, hidden] = np.nan
    middle = np.median(stack, axis=0)
    ground = np.full(middle.shape, np.nanmedian(middle), np.float32)
    ground[np.isnan(middle)] = np.nan
    seen = None if glow is None else glow.astype(np.float32)
    return ReflectanceMap(Window(0, 0, STEP, *middle.shape), stack, middle, seen, ground)


def nearest(found, x, y, kind):
    of_kind = [thing for thing in found if thing.kind == kind]
    return min(of_kind, key=lambda thing: np.hypot(thing.x - x, thing.y - y))


@settings(max_examples=15, deadline=None)
@given(
    x=st.floats(40, 110),
    y=st.floats(40, 100),
    diameter=st.floats(0.85e-3, 1.15e-3),
    depth=st.sampled_from([-2.0, -0.9, 0.7, 1.5]),
)
def test_a_round_patch_is_outlined(x, y, diameter, depth):
    found = candidates(wall([disc(x, y, diameter, depth)] * 3))
    thing = nearest(found, x, y, "dark" if depth < 0 else "bright")
    assert np.hypot(thing.x - x, thing.y - y) < 0.25
    assert thing.diameter == pytest.approx(diameter, rel=0.03)
    features = dict(zip(FEATURES, thing.features, strict=True))
    assert features["oval"] < 0.03
    assert features["share"] > 0.95
    assert features["rim_all"] > 0.9


@pytest.mark.parametrize("fill", [-1.5, 0.0, 0.9])
def test_the_rim_of_a_mouth_is_where_all_that_differs_from_the_wall_ends(fill):
    """What fills it is darker, as bright or brighter, and partly in the shadow of the rim."""
    levels = []
    for light in range(3):
        level = disc(80, 70, 1.1e-3, fill)
        turn = 2 * np.pi * light / 3
        unshaded = np.hypot(COLUMNS - 80 - 4 * np.cos(turn), ROWS - 70 - 4 * np.sin(turn)) < 10
        mouth = np.hypot(COLUMNS - 80, ROWS - 70) < 11
        shadow = ndimage.gaussian_filter((mouth & ~unshaded).astype(float), 0.8)
        levels.append((1 - shadow) * level - 2.0 * shadow)
    painted = wall(levels)
    for x, y, diameter in ((83.0, 68.0, 0.8e-3), (78.0, 73.0, 1.2e-3)):
        start = Candidate(x, y, diameter, "bright", np.empty(0))
        rim = at_rim(start, painted)
        assert np.hypot(rim.x - 80, rim.y - 70) < 0.8
        assert rim.diameter == pytest.approx(1.1e-3, rel=0.08)


def test_a_candidate_stays_where_nothing_ends_about_it():
    start = Candidate(80.0, 70.0, 1e-3, "dark", np.empty(0))
    assert at_rim(start, wall([np.zeros(ROWS.shape)] * 3)) is start
    unseen = wall([disc(80, 70, 1e-3, -1.5)] * 3, hidden=(ROWS > 60) | (COLUMNS > 90))
    assert at_rim(start, unseen) is start


def test_a_hole_half_in_a_shadow_that_moves_is_outlined_by_what_stays():
    levels = []
    for light in range(3):
        level = disc(80, 70, 1e-3, -1.5)
        shadow = np.hypot(COLUMNS - 90 - 8 * light, ROWS - 78 + 9 * light) < 16
        levels.append(level + ndimage.gaussian_filter(np.where(shadow, -1.2, 0.0), 1.5))
    thing = nearest(candidates(wall(levels)), 80, 70, "dark")
    assert np.hypot(thing.x - 80, thing.y - 70) < 0.8
    assert thing.diameter == pytest.approx(1e-3, rel=0.06)


def test_an_even_wall_has_few_round_things_and_none_with_a_rim():
    for thing in candidates(wall([np.zeros(ROWS.shape)] * 3)):
        assert dict(zip(FEATURES, thing.features, strict=True))["rim_all"] < 0.3
