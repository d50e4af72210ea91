from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from later import Later
from minorloop.arrays import uniform_levels
from minorloop.connect import connect
from minorloop.identification.excitation import decaying_staircase
from minorloop.lab.settling import extrapolate, is_still, judge, trend

T = np.arange(1, 201) * 1.0
SEEDS = st.integers(0, 2**32 - 1)

signal = Later("scipy.signal")


def _noise(seed, count=T.size):
    return np.random.default_rng(seed).normal(size=count)


def _decay(tau, amplitude=1.0):
    return amplitude * np.exp(-T / tau)


def _judged(y, *, tolerance=1e-4, window=20.0):
    return judge(T, y, tolerance=tolerance, window=window)


class TestTrend:
    @given(slope=st.floats(-1e3, 1e3), end=st.floats(-1e6, 1e6), window=st.floats(4, 200))
    def test_a_line_is_found_exactly(self, slope, end, window):
        line = trend(T, end + slope * (T - T[-1]), window)
        size = 1 + abs(end) + 200 * abs(slope)
        assert line.value == pytest.approx(end, abs=1e-11 * size)
        assert line.slope == pytest.approx(slope, abs=1e-11 * size)
        assert line.sd <= 1e-11 * size

    def test_a_window_that_a_slow_meter_leaves_empty_takes_the_last_four(self):
        t, y = np.arange(1.0, 9.0), np.array([9.0, 9.0, 9.0, 9.0, 1.0, 2.0, 3.0, 4.0])
        assert trend(t, y, 0.5) == trend(t[4:], y[4:], 100.0)
        assert trend(t, y, 0.5).slope == pytest.approx(1.0)

    @pytest.mark.parametrize(
        ("t", "y"),
        [
            ([], []),
            ([1.0], [2.0]),
            ([1.0, 2.0, 3.0], [1.0, 2.0, 3.0]),
            (np.arange(9.0), np.full(9, np.nan)),
            (np.arange(9.0), [*np.full(6, np.nan), 1.0, 2.0, 3.0]),
            (np.ones(9), np.arange(9.0)),
        ],
    )
    def test_too_little_has_no_trend_and_no_end(self, t, y):
        assert trend(t, y, 100.0) is None
        assert extrapolate(t, y) is None
        end = judge(t, y, tolerance=1.0, window=100.0)
        assert end.verdict == "unsettled"
        assert np.isnan([end.sd, end.slope, end.slope_sd]).all()
        measured = np.asarray(y)[np.isfinite(y)]
        np.testing.assert_equal(end.value, measured[-1] if measured.size else np.nan)


class TestExtrapolation:
    @pytest.mark.parametrize("tau", [10.0, 30.0, 80.0])
    @pytest.mark.parametrize("goal", [0.0, -3.0, 1e4])
    def test_a_decay_is_carried_to_its_end(self, tau, goal):
        end = extrapolate(T, goal + _decay(tau))
        assert end.trusted
        assert abs(end.value - goal) <= 3 * end.sd <= 0.1
        assert abs(end.value - goal) <= 0.4 * np.exp(-200 / tau) + 2e-5

    @pytest.mark.parametrize("tau", [300.0, 400.0, 600.0])
    def test_what_a_slower_decay_leaves_is_in_the_uncertainty(self, tau):
        end = extrapolate(T, _decay(100.0, 0.8) + _decay(tau, 0.2) + 1e-3 * _noise(3))
        assert abs(end.value) <= 2.5 * end.sd <= 0.5

    @pytest.mark.parametrize(
        "y",
        [T / 200, np.sqrt(T / 200), np.log(T), _decay(200.0), np.cumsum(_noise(1)), np.sin(T / 30)],
        ids=["ramp", "root", "logarithm", "too slow", "random walk", "swing"],
    )
    def test_what_does_not_fade_within_the_hold_is_not_trusted(self, y):
        assert not extrapolate(T, y).trusted
        end = _judged(y)
        assert end.verdict == "unsettled"
        assert end.value == trend(T, y, 20.0).value
        assert end.sd >= 0.4 * 200 * abs(end.slope)

    @given(
        seed=SEEDS,
        tau=st.floats(12, 80),
        shift=st.floats(-1e3, 1e3),
        scale=st.floats(1e-6, 1e6),
        stretch=st.floats(1e-6, 1e6),
    )
    def test_units_do_not_matter(self, seed, tau, shift, scale, stretch):
        y = _decay(tau) + 0.03 * _noise(seed)
        one = extrapolate(T, y)
        other = extrapolate(stretch * T, scale * (y + shift))
        close = {"rel": 1e-6, "abs": 1e-8}
        assert other.value / scale - shift == pytest.approx(one.value, **close)
        assert other.sd / scale == pytest.approx(one.sd, **close)
        assert other.remaining / scale == pytest.approx(one.remaining, **close)


class TestStandingStill:
    @pytest.mark.parametrize("count", [8, 13, 200])
    @pytest.mark.parametrize("kind", ["noise", "last digit"])
    def test_a_constant_in_noise_is_not_unsettled(self, count, kind):
        chance = np.random.default_rng(count)
        t = np.cumsum(chance.uniform(0.5, 1.5, count))
        for _ in range(15):
            noise = chance.normal(size=count) if kind == "noise" else chance.random(count) < 0.5
            end = judge(t, 5.0 + 0.01 * noise, tolerance=1e-9, window=max(9, count / 10))
            assert end.verdict in ("settled", "extrapolated")
            assert abs(end.value - 5.0) <= 0.05

    @pytest.mark.parametrize(
        ("count", "shape"),
        [(8, 1.0), *((count, shape) for count in (10, 200) for shape in (0.5, 2.0))],
    )
    def test_what_moves_is_not_still(self, count, shape):
        """A ramp and two bent ones, with a little noise."""
        x = np.linspace(0, 1, count)
        for seed in range(20):
            y = x**shape + 0.01 * _noise(seed, count)
            assert not is_still(x, y, 1.0)


class TestVerdict:
    def test_between_settled_and_not_lies_the_tolerance(self):
        y = 2.0 + _decay(30.0)
        line = trend(T, y, 20.0)
        slope = abs(line.slope) + 2 * line.slope_sd
        settled = _judged(y, tolerance=1.01 * slope)
        assert settled.verdict == "settled"
        assert settled.value == trend(T, y, 20.0).value
        assert abs(settled.value - 2.0) <= 3 * settled.sd
        end = extrapolate(T, y)
        least = max(abs(end.remaining), end.sd) / 199
        for share, verdict in ((1.01, "settled"), (0.99, "extrapolated")):
            assert share * least < slope
            found = _judged(y, tolerance=share * least)
            assert (found.verdict, found.value) == (verdict, end.value)
        assert abs(end.value - 2.0) < abs(settled.value - 2.0) / 2

    @given(seed=SEEDS)
    def test_what_was_not_measured_is_left_out(self, seed):
        y = 1.0 + _decay(40.0) + 0.01 * _noise(seed)
        gaps = np.random.default_rng(seed).random(200) < 0.3
        kept = judge(T[~gaps], y[~gaps], tolerance=1e-4, window=20.0)
        # The last of the gaps may be at the end, where the window begins then is the same.
        assert judge(T, np.where(gaps, np.nan, y), tolerance=1e-4, window=20.0).value == kept.value

    @given(data=st.data())
    def test_there_is_a_verdict_on_anything(self, data):
        count = data.draw(st.integers(0, 40))
        steps = st.sampled_from([0.0, 1e-9, 0.1, 1.0, 1e6])
        t = np.cumsum(data.draw(st.lists(steps, min_size=count, max_size=count)))
        numbers = st.sampled_from([0.0, 1.0, -1.0, 1e-300, 1e100, 1e6, np.nan]) | st.floats(-1, 1)
        y = np.array(data.draw(st.lists(numbers, min_size=count, max_size=count)))
        end = judge(t, y, tolerance=data.draw(st.floats(1e-9, 1e9)), window=1.0)
        assert end.verdict in ("settled", "extrapolated", "unsettled")
        assert np.isfinite(end.value) == np.isfinite(y).any()
        assert not end.sd < 0
        if end.verdict != "unsettled":
            assert np.isfinite(end.sd)


class TestHonesty:
    """|value - truth| is within three standard deviations, whatever the verdict."""

    @pytest.mark.parametrize("tau", [20.0, 65.0])
    @pytest.mark.parametrize("noise", [0.001, 0.3])
    @pytest.mark.parametrize("tolerance", [1e-4, 5e-3])
    def test_of_decays_in_noise(self, tau, noise, tolerance):
        ends = [
            _judged(_decay(tau) + noise * _noise(seed), tolerance=tolerance) for seed in range(40)
        ]
        assert np.mean([abs(end.value) <= 3 * end.sd for end in ends]) >= 0.95
        # Nor is it bought with uncertainties that say nothing.
        assert (
            np.sqrt(np.mean([end.value**2 for end in ends]))
            >= np.median([end.sd for end in ends]) / 10
        )

    @pytest.mark.parametrize(("address", "hold"), [("ipmc", 100.0), ("fibre", 300.0)])
    def test_of_the_twins(self, address, hold):
        chance = np.random.default_rng(0)
        for share in (0.0005, 0.005, 0.02):
            inside, verdicts, worst, left = [], set(), 0.0, []
            for t, y, truth, span, _ in _holds(address, hold):
                for tolerance in (0.002 * span / hold, 0.04 * span / hold):
                    noisy = y + share * span * chance.normal(size=y.size)
                    end = judge(t, noisy, tolerance=tolerance, window=hold / 10)
                    inside.append(abs(end.value - truth) <= 3 * end.sd)
                    verdicts.add(end.verdict)
                    worst = max(worst, end.sd / span)
                    if end.verdict == "settled" and abs(end.slope) + 2 * end.slope_sd > tolerance:
                        allowed = max(share * span, tolerance * hold)
                        left.append(abs(y[-1] - truth) / allowed)
            assert len(inside) >= 88
            assert np.mean(inside) >= 0.95
            assert "settled" in verdicts
            assert share > 0.0005 or "extrapolated" in verdicts
            # What is left is no more than noise, or than the tolerance allows.
            assert len(left) >= 20
            assert np.quantile(left, 0.95) <= 1.5
            assert worst <= 0.015 + 2 * share  # nor is it bought with doubts that say nothing


@cache
def _holds(address, hold, *, interval=None, specimens=4):
    """Holds of some specimens of a twin without noise: times, outputs, settled value, span, and by
    how much another such hold moves the output."""
    interval, holds = interval or hold / 200, []
    low, high = {"ipmc": (-1.2, 1.2), "fibre": (0.2, 0.65)}[address]
    for specimen in range(specimens):
        twin = connect(f"twin:{address}", specimen=specimen)
        found = []
        for level in decaying_staircase(uniform_levels(low, high, 4)):
            record = twin.apply(level, hold, interval)
            state = twin.checkpoint()
            moved = twin.apply(level, hold, hold).y[-1] - record.y[-1]
            truth = twin.apply(level, 6000.0, 6000.0).y[-1]
            twin.restore(state)
            found.append((interval + record.t - record.t[0], record.y, truth, moved))
        span = np.ptp([truth for _, _, truth, _ in found])
        holds += [(t, y, truth, span, moved) for t, y, truth, moved in found]
    return holds
