import numpy as np
import pytest

from minorloop.lab.gaps import between, crossed

T = 0.01 * np.arange(1000)
SINE = np.cos(2 * np.pi * 0.5 * T)


def _cut(u, begin, count):
    """Times and inputs without some samples, and the sample after which they are missing."""
    kept = np.delete(np.arange(u.size), slice(begin, begin + count))
    return T[kept], u[kept], [begin - 1]


@pytest.mark.parametrize("seed", [1000, 1001])
@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_a_gap_is_crossed_on_a_smooth_slope_only(seed, noise):
    """The sine turns at every hundredth sample."""
    u = SINE + noise * np.random.default_rng(seed).normal(size=T.size)
    assert crossed(*_cut(u, 345, 10)).all()
    assert crossed(*_cut(u, 340, 20)).all()
    assert not crossed(*_cut(u, 395, 10)).any()  # it turned
    assert not crossed(*_cut(u, 380, 15)).any()  # it may have turned
    assert not crossed(*_cut(u, 350, 200)).any()  # a whole period
    assert not crossed(*_cut(u, 2, 10)).any()  # hardly anything before


def test_a_jump_in_a_gap_is_not_crossed_and_a_rest_is():
    steps = np.repeat([0.0, 1.0, -1.0, 0.5], 250)
    assert not crossed(*_cut(steps, 245, 10)).any()
    assert crossed(*_cut(steps, 345, 30)).all()
    assert not crossed(*_cut(steps, 250, 250)).any()  # a whole hold


def test_a_tooth_in_a_gap_is_not_crossed():
    """A triangle whose two turns are in the gap goes on with the same slope."""
    u = np.abs((0.1 * np.arange(1000.0)) % 2 - 1)
    assert not crossed(*_cut(u, 505, 20)).any()


def test_inputs_between_lie_on_the_curve():
    t, u, gaps = _cut(SINE, 330, 20)
    found = between(t, u, T, np.array(gaps))
    inside = np.isfinite(found)
    assert np.flatnonzero(inside).tolist() == list(range(330, 350))
    line = np.interp(T, t, u)
    wrong = np.abs(found - SINE)[inside].max()
    assert wrong < 0.5 * np.abs(line - SINE)[inside].max()
    assert ((found[inside] < u[329]) == (found[inside] > u[330])).all()
