import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop.lab.holds import find_holds, looks_like_raw_log, turning_points

SEEDS = st.integers(0, 2**32 - 1)


def _steps(seed, count, least):
    """Levels in [-1, 1] of which neighbours differ by at least ``least``."""
    chance, levels = np.random.default_rng(seed), [0.0]
    while len(levels) < count:
        level = chance.uniform(-1, 1)
        if abs(level - levels[-1]) >= least:
            levels.append(level)
    return np.array(levels)


def _log(levels, counts, *, tau=40.0, noise=0.0, input_noise=0.0, seed=0):
    """Samples of a first-order lag behind a staircase."""
    chance = np.random.default_rng(seed)
    u = np.repeat(levels, counts)
    y, last = np.empty(u.size), 0.0
    for k, level in enumerate(u):
        last += (level - last) / tau
        y[k] = last
    return u + input_noise * chance.normal(size=u.size), y + noise * chance.normal(size=u.size)


class TestHolds:
    @given(
        seed=SEEDS,
        noise=st.sampled_from([0.0, 1e-6, 1e-3, 0.01]),
        digit=st.sampled_from([0.0, 1e-3]),
        scale=st.sampled_from([1e-6, 1.0, 1e6]),
    )
    def test_each_level_of_a_staircase_is_one_hold(self, seed, noise, digit, scale):
        chance = np.random.default_rng(seed)
        levels = _steps(seed, 12, 0.15)
        counts = chance.integers(20, 200, levels.size)
        u = np.repeat(levels, counts) + noise * chance.normal(size=counts.sum())
        u = scale * (np.round(u / digit) * digit if digit else u)
        holds = find_holds(u)
        ends = np.cumsum(counts)
        assert len(holds) == levels.size
        for hold, end, count, level in zip(holds, ends, counts, levels, strict=True):
            assert abs(hold.end - end) <= 1
            assert abs(hold.begin - (end - count)) <= 1
            assert abs(hold.level - scale * level) <= scale * (5 * noise / np.sqrt(count) + digit)

    def test_a_slow_step_between_holds_belongs_to_none(self):
        u = np.concatenate([np.zeros(50), np.linspace(0, 1, 40)[1:-1], np.ones(50)])
        first, second = find_holds(u)
        assert (first.begin, second.end) == (0, u.size)
        assert abs(first.end - 50) <= 1
        assert abs(second.begin - 88) <= 1

    @pytest.mark.parametrize("period", [8, 20, 125])
    @pytest.mark.parametrize("amplitude", [0.003, 0.03])
    def test_hum_does_not_hide_holds(self, period, amplitude):
        hum = amplitude * np.sin(np.arange(3000) * 2 * np.pi / period)
        u = np.repeat([0.0, 1.0, 0.3], 1000) + hum
        for tolerance in (None, 5 * amplitude):
            holds = find_holds(u, tolerance=tolerance)
            assert len(holds) == 3
            assert np.abs([hold.begin - k * 1000 for k, hold in enumerate(holds)]).max() <= 9


class TestRawLog:
    @given(
        seed=SEEDS,
        count=st.integers(10, 150),
        noise=st.sampled_from([0.0, 0.001, 0.01]),
        tau=st.floats(0.1, 0.6),
    )
    def test_holds_with_transients_are_noticed(self, seed, count, noise, tau):
        levels = _steps(seed, 9, 0.2)
        u, y = _log(
            levels, count, tau=max(tau * count, 3), noise=noise, input_noise=noise, seed=seed
        )
        said = looks_like_raw_log(None, u, y)
        assert said.startswith(f"this looks like a raw log: {u.size} samples with 9 holds")
        assert "reduce it to settled points first" in said

    def test_holds_without_transients_are_not(self):
        u = np.repeat(_steps(3, 20, 0.1), 50)
        noise = 0.01 * np.random.default_rng(1000).normal(size=u.size)
        assert looks_like_raw_log(None, u, u**3 + noise) == ""
        assert looks_like_raw_log(None, u, np.full(u.size, np.nan)) == ""


class TestTurningPoints:
    def test_reversals_within_the_threshold_are_noise(self):
        values = np.array([0.0, 1.0, 0.95, 2.0, -1.0, -0.98, -2.0, 3.0])
        assert turning_points(values, 0.1).tolist() == [3, 6]
        assert turning_points(values, 0.0).tolist() == [1, 2, 3, 4, 5, 6]
        assert turning_points(values, 10.0).tolist() == []
