import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop.errors import ParameterError, RecordError
from minorloop.lab.timebase import check_times, delayed, parse_lag, resample, time_column

SEEDS = st.integers(0, 2**32 - 1)


class TestColumn:
    @pytest.mark.parametrize(
        ("headers", "found"),
        [
            (["time [s]", "u", "y"], "time [s]"),
            (["Time (ms)", "u"], "Time (ms)"),
            (["u [V]", "elapsed [min]"], "elapsed [min]"),
            (["timestamp", "held [s]"], "timestamp"),
            (["t [s]", "held [s]", "rise [ms]"], "t [s]"),
            (["u [V]", "y [m]"], None),
            (["t_ms", "u_V"], "t_ms"),
        ],
    )
    def test_it_is_recognised_by_name_or_unit(self, headers, found):
        assert time_column(headers) == found


class TestChecks:
    @given(seed=SEEDS, lost=st.integers(10, 300), interval=st.sampled_from([1e-3, 1.0, 60.0]))
    def test_missing_rows_are_a_gap(self, seed, lost, interval):
        place = int(np.random.default_rng(seed).integers(50, 900))
        t = interval * np.delete(np.arange(1300.0), slice(place, place + lost))
        found = check_times(t)
        assert found.gaps.tolist() == [place - 1]
        assert f"about {lost} samples are missing" in found.notes[0]
        np.testing.assert_array_equal(found.t, t)

    @given(seed=SEEDS, back=st.floats(0.2, 3500))
    def test_a_clock_that_was_set_back_is_put_right(self, seed, back):
        place = int(np.random.default_rng(seed).integers(1, 999))
        t = 0.1 * np.arange(1000)
        t[place:] -= back
        found = check_times(t)
        np.testing.assert_allclose(found.t, 0.1 * np.arange(1000), atol=1e-9)
        assert found.breaks.tolist() == [place - 1]
        assert "the clock was set back 1 time" in found.notes[0]

    @pytest.mark.parametrize(
        ("by", "how"),
        [
            (3600.0, "summer time"),
            (-3600.0, "summer time"),
            (-86400.0, "a time of day at midnight"),
            (1.7e9, "the date"),
        ],
    )
    @pytest.mark.parametrize("interval", [0.1, 10.0])
    def test_a_clock_that_was_changed_does_not_break_the_record(self, by, how, interval):
        t = interval * np.arange(1000)
        found = check_times(t + by * (t >= t[300]))
        np.testing.assert_allclose(found.t, t, atol=1e-5)
        assert found.breaks.size == 0
        (said,) = found.notes
        assert f"the clock was set 1 time, first by {by:.10g} s after sample 299" in said
        assert how in said
        assert check_times(t + (by + 20 * interval) * (t >= t[300])).breaks.size == (by < 1e9)

    @pytest.mark.parametrize(
        ("t", "message"),
        [
            ([1.0], "time has 1 sample;"),
            ([1.0, np.inf, 2.0], "time is inf at sample 1"),
            (np.sin(np.arange(100.0)), "it cannot be the time of this record"),
            (np.repeat(np.arange(3.0), 100), "stands still or runs backwards at 297 of 299 steps"),
        ],
    )
    def test_what_is_no_clock_is_refused(self, t, message):
        with pytest.raises(RecordError, match=message):
            check_times(t)

    def test_a_wrong_unit_is_noticed_where_no_log_has_such_an_interval(self):
        (note,) = check_times(1e-9 * np.arange(100.0), name="clock", unit="ns").notes
        assert "interval is 1e-09 s with clock in ns" in note
        assert "correct the unit in the header" in note


class TestLag:
    @pytest.mark.parametrize(
        ("text", "seconds"),
        [
            *(("3 ms", 3e-3), ("0.5s", 0.5), ("2e1 us", 2e-5), ("1 min", 60.0)),
            *(("3", None), ("auto", None), ("-2", None)),
        ],
    )
    def test_a_lag_with_a_unit_is_in_seconds(self, text, seconds):
        assert parse_lag(text) == (None if seconds is None else pytest.approx(seconds))

    @pytest.mark.parametrize(
        ("text", "message"), [("3 rows", "in one of s, ms"), ("-3 ms", "give a lag >= 0")]
    )
    def test_what_is_no_lag_is_refused(self, text, message):
        with pytest.raises(ParameterError, match=message):
            parse_lag(text)

    @given(seed=SEEDS, lag=st.floats(0, 3))
    def test_the_output_is_that_after_the_lag(self, seed, lag):
        t = np.cumsum(np.random.default_rng(seed).uniform(0.1, 0.3, 200))
        found = delayed(t, 2 * t, lag)
        inside = t + lag <= t[-1]
        np.testing.assert_allclose(found[inside], 2 * (t + lag)[inside])
        assert np.isnan(found[~inside]).all() or lag < 1e-6

    def test_nothing_is_known_within_a_gap_or_beside_a_missing_sample(self):
        t, y = np.array([0.0, 1, 2, 9, 10]), np.array([0.0, 1, np.nan, 9, 10])
        np.testing.assert_array_equal(delayed(t, y, 1.0, gap=3.0), [1, np.nan, np.nan, 10, np.nan])
        np.testing.assert_array_equal(delayed(t, y, 0.0), y)
        with pytest.raises(ParameterError, match="lag is -1"):
            delayed(t, y, -1.0)

    def test_even_samples_lie_on_the_lines_between_uneven_ones(self):
        t = np.array([0.0, 1.0, 3.0, 9.0, 10.0])
        even, u, y = resample(t, t, -t, 1.0, gap=4.0)
        np.testing.assert_array_equal(even, np.arange(11.0))
        np.testing.assert_array_equal(u, even)
        np.testing.assert_array_equal(y, [0, -1, -2, -3, *[np.nan] * 5, -9, -10])
        with pytest.raises(ParameterError, match="interval is 0"):
            resample(t, t, t, 0.0)
        with pytest.raises(ParameterError, match="give one of at least 2e-07 s"):
            resample(t, t, t, 1e-9)


@pytest.mark.parametrize(("unit", "said"), [("s", True), ("", True), ("min", False)])
def test_seconds_that_may_be_milliseconds_are_named(unit, said):
    notes = check_times(10.0 * np.arange(30_000), unit=unit).notes
    assert any("if it is in ms, correct the unit" in note for note in notes) == said
    assert not check_times(0.01 * np.arange(30_000), unit=unit).notes


def test_times_that_repeat_are_named_as_rounded():
    (note,) = check_times(np.floor(0.6 * np.arange(100))).notes
    assert "repeats itself at 40 of 99 steps" in note
    assert "rounded to 1 s" in note
    with pytest.raises(RecordError, match=r"times that repeat are rounded, here to 1 s: write"):
        check_times(np.floor(0.1 * np.arange(100)))
