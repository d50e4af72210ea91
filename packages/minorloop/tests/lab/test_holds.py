import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop.arrays import uniform_levels
from minorloop.errors import ParameterError
from minorloop.identification.excitation import decaying_staircase
from minorloop.lab.holds import find_drift, find_holds, looks_like_raw_log, turning_points
from minorloop.lab.records import Record
from minorloop.lab.reduction import reduce
from minorloop.operators.prandtl_ishlinskii import PrandtlIshlinskii

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

    def test_a_tolerance_below_zero_is_refused(self):
        u = np.arange(30.0)
        with pytest.raises(ParameterError, match="tolerance is -1; give a change"):
            find_holds(u, tolerance=-1)

    def test_too_little_and_a_constant_have_none(self):
        assert find_holds([]) == find_holds([1.0, 2.0]) == find_holds(np.ones(100)) == []


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

    def test_it_names_the_time_of_a_hold(self):
        u, y = _log(_steps(1, 56, 0.1), 200)
        said = looks_like_raw_log(0.5 * np.arange(11_200), u, y)
        assert "11200 samples with 56 holds of about 200 samples (99.5 s)" in said

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

    def test_a_constant_and_a_ramp_have_none(self):
        assert turning_points(np.ones(9), 0.1).size == 0
        assert turning_points(np.arange(9.0), 0.1).size == 0
        assert turning_points(np.ones(1), 0.1).size == 0


# A drift of the sensor.

PLAYS = PrandtlIshlinskii(np.linspace(0, 40, 41), 0.44 * np.exp(-np.linspace(0, 3, 41)) / 13)
LEVELS = decaying_staircase(uniform_levels(0, 100, 7))
INTERVAL = 0.1


def log(drift=0.0, *, hold=20.0, rise=2.0, fall=2.0, creep=0.0, seed=1000):
    """Holds with lags of rises and falls, and creep over 30 s, in seconds."""
    u = np.repeat(LEVELS, round(hold / INTERVAL))
    now = crept = 0.0
    y = np.empty(u.size)
    for k, goal in enumerate(PLAYS.simulate(u)):
        now = goal + np.exp(-INTERVAL / (rise if goal > now else fall)) * (now - goal)
        crept += INTERVAL / 30 * (creep * goal - crept)
        y[k] = now + crept
    t = INTERVAL * np.arange(u.size)
    noise = 0.02 * np.random.default_rng(seed).normal(size=t.size)
    return Record(u, y + drift * t / t[-1] + noise, t, "voltage [V]", "distance [um]")


@pytest.mark.parametrize("size", [-8.0, 5.0, 15.0])
def test_a_drift_is_found_with_its_rate(size):
    record = log(size)
    found = find_drift(record.t, record.y, find_holds(record.u), 0.1)
    assert abs(found.rate - size / record.t[-1]) <= 4 * found.sd
    assert found.share == pytest.approx(size / 44, rel=0.25)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"hold": 6.0},
        {"hold": 6.0, "fall": 0.5},
        {"hold": 8.0, "rise": 0.5},
        {"fall": 6.0},
        {"rise": 6.0},
        {"creep": 0.1},
        {"creep": -0.1},
        {"creep": 0.1, "fall": 0.5},
    ],
)
def test_what_remains_of_transients_is_no_drift(options):
    for seed in (1000, 1001):
        record = log(seed=seed, **options)
        assert find_drift(record.t, record.y, find_holds(record.u), 0.1) is None


def test_holds_that_drift_have_not_settled_unless_it_is_subtracted():
    record, still = log(8.0), reduce(log())
    found = reduce(record)
    assert found.count("settled") == 0
    assert found.count("unsettled") == LEVELS.size
    assert "the sensor drifts by 5" in found.notes[0]
    assert "um per hour, 1" in found.notes[0]
    assert "subtract_drift" in found.remedy
    flat = reduce(record, subtract_drift=True)
    assert flat.count("settled") == LEVELS.size
    assert "it was subtracted" in flat.notes[0]
    error = np.abs(flat.record().y - still.record().y)
    sd = [np.hypot(point.sd, point.common_sd) for point in flat.points]
    assert (error <= 4 * np.array(sd) + 0.02).all()
    assert still.drift is None
    assert still.notes == ()
