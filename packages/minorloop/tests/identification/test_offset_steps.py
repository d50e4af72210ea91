import numpy as np
import pytest

from fixed_options import identify
from minorloop.arrays import uniform_levels
from minorloop.identification.excitation import decaying_staircase
from minorloop.identification.offset_steps import find_drift, find_offset_step
from minorloop.operators.prandtl_ishlinskii import PrandtlIshlinskii

PLAYS = PrandtlIshlinskii(np.linspace(0, 40, 41), np.exp(-np.linspace(0, 3, 41)) / 13)


def moved(rows, noise=0.04, seed=1000):
    """Loops of decreasing amplitude, which visit each part of the plane once."""
    share = np.linspace(0, 1, rows)
    u = 50 - 50 * np.cos(12 * np.pi * share) * (1 - 0.8 * share)
    return u, PLAYS.simulate(u) + noise * np.random.default_rng(seed).normal(size=rows)


@pytest.mark.parametrize("rows", [250, 8000])
def test_a_step_that_the_fit_absorbs_is_found(rows):
    u, y = moved(rows)
    assert identify(u, y).residual.step is None
    size, at = 0.03 * np.ptp(y), int(0.6 * rows)
    found = identify(u, y + np.where(np.arange(rows) >= at, size, 0)).residual.step
    assert abs(found.sample - at) <= max(2, rows // 500)
    assert found.size * np.ptp(y) == pytest.approx(size, rel=0.15)


def test_a_raw_log_has_no_step():
    levels = np.repeat(decaying_staircase(uniform_levels(0, 100, 6)), 40)
    w, y = PLAYS.simulate(levels), np.empty(levels.size)
    now = w[0]
    for k, x in enumerate(w):
        now = y[k] = x + np.exp(-1 / 8) * (now - x)
    y += 0.04 * np.random.default_rng(1000).normal(size=y.size)
    assert identify(levels, y).residual.step is None


SHAPES = {
    "decaying": lambda share: 1 - 0.9 * share,
    "swelling": lambda share: 0.1 + 0.9 * share,
    "both": lambda share: 0.1 + 0.9 * np.sin(np.pi * share),
}


def loops(shape, rows=400, noise=0.0005, seed=1000):
    """Loops whose amplitude changes, in ranges of the output."""
    share = np.linspace(0, 1, rows)
    u = 50 - 50 * np.cos(16 * np.pi * share) * SHAPES[shape](share)
    y = PLAYS.simulate(u)
    return u, y / np.ptp(y) + noise * np.random.default_rng(seed).normal(size=rows)


@pytest.mark.parametrize("shape", SHAPES)
def test_noise_that_is_alike_in_neighbours_is_no_drift(shape):
    u, y = loops(shape)
    white = 0.003 * np.random.default_rng(1001).normal(size=y.size + 60)
    y += np.convolve(white, 0.9 ** np.arange(61), mode="valid")
    assert identify(u, y).residual.drift == 0


def test_few_rows_and_exact_outputs_have_none():
    one, flat = np.ones((40, 1)), np.ones(40)
    assert find_offset_step(one[:20], flat[:20], np.arange(20.0)) is None
    assert find_offset_step(one, flat, flat) is None
    shifted = np.repeat([0.0, 1.0], 20)
    assert find_offset_step(one, flat, shifted) == (20, pytest.approx(1.0))
    assert find_drift(one, flat) == 0
    assert find_drift(one[:20], np.arange(20.0)) == 0
    assert find_drift(one, np.linspace(0, 2, 40)) == pytest.approx(2.0)
