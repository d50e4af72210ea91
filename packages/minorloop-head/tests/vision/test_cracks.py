"""Tracing cracks on painted maps."""

import itertools

import numpy as np
import pytest
from scipy import ndimage

from minorloop_head.vision import _line_kernels as kernels
from minorloop_head.vision.calibrated_camera import Window
from minorloop_head.vision.cracks import TracedCrack, trace_cracks

STEP, RADIUS = 0.05e-3, 10e-3
WINDOW = Window(0.0, 0.0, STEP, 200, 240)
ROWS, COLUMNS = np.mgrid[:200, :240].astype(float)


def bare(seed=0, noise=0.05):
    return np.random.default_rng(seed).normal(0, noise, (200, 240))


def distance(points):
    """Texels from a polyline of (x, y)."""
    best = np.full(COLUMNS.shape, np.inf)
    for (x0, y0), (x1, y1) in itertools.pairwise(points):
        a, b = x1 - x0, y1 - y0
        share = np.clip(((COLUMNS - x0) * a + (ROWS - y0) * b) / (a * a + b * b), 0, 1)
        best = np.minimum(best, np.hypot(COLUMNS - x0 - share * a, ROWS - y0 - share * b))
    return best


def line(points, width, *, gap=None):
    """Reflectance 0.05 within a width in texels of a polyline, blurred as a lens does."""
    dark = np.clip(0.5 + width / 2 - distance(points), 0, 1)
    if gap is not None:
        dark = np.where(np.abs(COLUMNS - gap[0]) < gap[1], 0, dark)
    return np.log(ndimage.gaussian_filter(1 - 0.95 * dark, 0.7))


@pytest.mark.parametrize("width", [2.5, 3.5])
@pytest.mark.parametrize("bend", [0.0, 0.5])
@pytest.mark.parametrize("turn", [0.0, 1.2, 2.4])
def test_course_length_and_width_are_those_of_the_line(turn, bend, width):
    ways = turn + np.array([0.0, bend])
    steps = 45 * np.stack([np.cos(ways), np.sin(ways)], axis=1)
    points = np.array([[120.0, 100.0] - steps[0], [120.0, 100.0], [120.0, 100.0] + steps[1]])
    (crack,) = trace_cracks((bare() + line(points, width)).astype(np.float32), WINDOW, RADIUS)
    x, y = crack.places[:, 0] * RADIUS / STEP, crack.places[:, 1] / STEP
    off = distance(points)[np.rint(y).astype(int), np.rint(x).astype(int)]
    assert off.max() < 3
    assert crack.length == pytest.approx(90 * STEP, rel=0.1)
    assert crack.width == pytest.approx(width * STEP, rel=0.3)


def test_a_width_is_the_surer_the_longer_and_the_more_even_its_course_is():
    def crack(width, length, spread=0.0):
        widths = width + spread * np.tile([-1.0, 1.0], 20)
        return TracedCrack(np.zeros((40, 2)), widths, length, 0.3)

    assert crack(50e-6, 4e-3).width_sd == pytest.approx(np.hypot(6e-6, 5e-6))
    assert crack(200e-6, 4e-3).width_sd == pytest.approx(21e-6, abs=1e-6)
    short, long = (crack(50e-6, length, 20e-6).width_sd for length in (2e-3, 8e-3))
    assert crack(50e-6, 8e-3).width_sd < long < short < 25e-6


def test_noise_spots_and_short_or_faint_lines_are_not_cracks():
    spot = -1.5 * np.exp(-((COLUMNS - 60) ** 2 + (ROWS - 60) ** 2) / 60)
    short = line([(150, 150), (165, 150)], 3.0)
    faint = 0.05 * line([(20, 180), (220, 180)], 3.0)
    level = bare() + spot + short + faint
    assert trace_cracks(level.astype(np.float32), WINDOW, RADIUS) == ()


def test_the_rim_of_a_hole_that_is_known_is_left_out():
    off = np.hypot(COLUMNS - 120, ROWS - 100)
    ring = np.where(np.abs(off - 15) < 1.5, -2.0, 0.0)
    level = (bare() + ndimage.gaussian_filter(ring, 0.7)).astype(np.float32)
    hole = (120 * STEP / RADIUS, 100 * STEP, 30 * STEP)
    assert trace_cracks(level, WINDOW, RADIUS, apart=[hole]) == ()


def test_a_map_that_is_not_seen_has_no_cracks():
    nothing = np.full((200, 240), np.nan, np.float32)
    assert trace_cracks(nothing, WINDOW, RADIUS) == ()
    half = (bare() + line([(40, 60), (200, 60)], 3.0)).astype(np.float32)
    half[100:] = np.nan
    assert len(trace_cracks(half, WINDOW, RADIUS)) == 1


def test_a_straight_groove_with_a_bright_flank_and_a_wide_soft_line_are_no_cracks():
    points = [(40, 60), (200, 150)]
    off = distance(points)
    side = np.sign((ROWS - 60) * 160 - (COLUMNS - 40) * 90)
    groove = 0.6 * side * off / 2 * np.exp(0.5 - off**2 / 8)
    soft = -0.25 * np.exp(-(off**2) / 18)
    for mark in (groove, soft):
        levels = np.stack([bare(seed) + mark for seed in range(3)]).astype(np.float32)
        assert trace_cracks(levels, WINDOW, RADIUS) == ()
    levels = np.stack([bare(seed) + line(points, 2.0) for seed in range(3)]).astype(np.float32)
    (crack,) = trace_cracks(levels, WINDOW, RADIUS)
    assert crack.width == pytest.approx(2.0 * STEP, rel=0.15)


def test_a_wandering_groove_whose_flanks_return_light_is_a_crack():
    points = [(40, 60), (80, 85), (110, 78), (150, 120), (200, 130)]
    off = distance(points)
    above = np.sign(ROWS - np.interp(COLUMNS, *np.transpose(points)))
    flanks = np.clip(2.5 - off, 0, 1)
    for lit, level in (((0.5, -0.2, 0.3), 0.5), ((0.5, -0.2, 0.3), 0.2), ((0.0, 0.0, 0.0), 0.5)):
        marks = [flanks * (level + turned * above) for turned in lit]
        levels = [bare(n) + ndimage.gaussian_filter(mark, 0.7) for n, mark in enumerate(marks)]
        (crack,) = trace_cracks(np.float32(levels), WINDOW, RADIUS)
        assert crack.length == pytest.approx(190 * STEP, rel=0.15)
        assert crack.width == pytest.approx(4 * STEP, rel=0.3)


def test_odds_of_places_are_those_of_the_classifier_they_were_taken_from():
    from sklearn.ensemble import HistGradientBoostingClassifier

    from benchmarks.cracks import odds_of

    rng = np.random.default_rng(4)
    rows = rng.normal(size=(600, 5))
    right = rows[:, 0] * rows[:, 1] + 0.3 * rng.normal(size=600) > 0
    model = HistGradientBoostingClassifier(max_iter=20, max_depth=4).fit(rows, right)
    odds = odds_of(model)
    each = odds.base + kernels.sum_of_trees(
        rows, odds.first, odds.feature, odds.threshold, odds.branches, odds.value
    )
    np.testing.assert_allclose(each, model.decision_function(rows), atol=1e-5)


def test_of_two_faint_lines_the_bent_one_is_surer_a_crack():
    straight = line([(40, 60), (200, 120)], 1.5)
    bent = line([(40, 60), (70, 80), (100, 75), (130, 100), (160, 95), (200, 120)], 1.5)
    (one,), (other,) = (
        trace_cracks(np.float32(bare(0, 0.02) + mark), WINDOW, RADIUS, least=-np.inf)
        for mark in (straight, bent)
    )
    assert other.evidence > one.evidence + 2
