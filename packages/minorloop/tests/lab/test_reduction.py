from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop import ParameterError, Record, RecordError, SignalError, reduce
from minorloop.arrays import uniform_levels
from minorloop.identification.excitation import decaying_staircase
from minorloop.lab.conversion import LaserCurvature
from minorloop.lab.curvature import displacement_from_curvature
from minorloop.lab.records import SAMPLE
from minorloop.twins.ipmc import Ipmc

LASER = LaserCurvature(20.0, 15.0, 0.02, 0.05)
LEVELS = decaying_staircase(uniform_levels(-1.2, 1.2, 4))


@pytest.fixture(scope="module")
def long():
    """A log of the strip through a laser, and the settled curvatures."""
    twin, records, truth = Ipmc(specimen=1000), [], []
    for level in LEVELS:
        records.append(twin.apply(level, 200.0, 0.5))
        state = twin.checkpoint()
        truth.append(twin.apply(level, 6000.0, 6000.0).y[-1])
        twin.restore(state)
    record = Record.joined(records)
    chance = np.random.default_rng(1000)
    d = 1e3 * displacement_from_curvature(record.y, 0.02, 0.015)
    d = d + 2e-3 * chance.normal(size=d.size)
    u = record.u + 2e-3 * chance.normal(size=d.size)
    return Record(u, d, record.t, "voltage [V]", "distance [mm]"), np.array(truth)


def test_a_log_through_a_laser_becomes_settled_curvatures(long):
    log, truth = long
    found = reduce(log, conversion=LASER)
    assert str(found) == f"{LEVELS.size} holds in {len(log)} samples: {LEVELS.size} settled, " + (
        "0 extrapolated, 0 unsettled"
    )
    record = found.record()
    assert [str(record.input), str(record.output)] == ["voltage [V]", "curvature [1/m]"]
    np.testing.assert_allclose(record.u, LEVELS, atol=1e-3)
    error, sd = record.y - truth, np.array([point.sd for point in found.points])
    assert np.sqrt(np.mean(error**2)) <= 0.01
    assert np.mean(np.abs(error) <= 3 * sd) >= 0.95
    common = np.array([point.common_sd for point in found.points])
    assert 0.1 <= common.min() <= common.max() <= 0.3
    assert found.notes == ()


def test_signs_are_flipped_and_time_is_counted(long):
    log, _ = long
    plain = reduce(log, conversion=LASER)
    count = np.arange(len(log))
    other = Record(-log.u, log.y, count, "voltage [V]", "distance [mm]", time=SAMPLE)
    flipped = reduce(other, conversion=LASER, flip="both")
    np.testing.assert_allclose(flipped.record().y, -plain.record().y, atol=0.01)
    np.testing.assert_allclose(flipped.record().u, plain.record().u)
    assert "durations are counted in samples" in flipped.notes[-1]


def test_extremes_between_holds_are_kept_without_outputs():
    before = [np.linspace(0, 1, 31), np.linspace(1, -0.5, 31), np.full(60, 0.2)]
    between = [np.linspace(0.2, 2, 20), np.linspace(2, 0.6, 20), np.full(60, 0.6)]
    after = [np.full(60, -0.3), np.linspace(-0.3, -0.9, 9)]
    u = np.concatenate(before + between + after)
    found = reduce(Record(u, u + 1e-3 * np.sin(np.arange(u.size)), np.arange(u.size)))
    levels = [round(point.input, 6) for point in found.points]
    assert levels == [0.0, 1.0, -0.5, 0.2, 2.0, 0.6, -0.3, -0.9]
    passed = [point.verdict == "passed" for point in found.points]
    assert passed == [True, True, True, False, True, False, False, True]
    assert np.isnan(found.record().y).tolist() == passed
    assert "5 extremes of input between, before or after the holds" in found.notes[-1]


def test_readings_beyond_the_range_are_not_used(long):
    log, truth = long
    d = log.y
    limits = (float(np.quantile(d, 0.002)), 100.0)
    found = reduce(log, conversion=LASER, limits=limits)
    (fault,) = found.faults
    assert fault.kind == "range"
    assert np.isnan(found.log.y[list(fault.samples)]).all()
    assert "are beyond the range of the sensor" in fault.text
    np.testing.assert_allclose(found.record().y, truth, atol=0.03)


def test_spikes_of_a_measured_input_are_no_extremes(long):
    log, _ = long
    u, chance = log.u.copy(), np.random.default_rng(1000)
    at = chance.integers(0, u.size, 20)
    u[at] += chance.choice([-1, 1], 20) * chance.uniform(1, 4, 20)
    found = reduce(Record(u, log.y, log.t, "voltage [V]", "distance [mm]"), conversion=LASER)
    assert found.count("passed") == 0
    np.testing.assert_allclose(found.record().u, LEVELS, atol=1e-3)
    assert "20 outliers of voltage [V]" in found.notes[0]
    assert "not used as input" in found.notes[0]


def test_a_gap_shorter_than_half_a_hold_keeps_the_memory(long):
    log, _ = long
    kept = np.ones(len(log), dtype=bool)
    for begin in np.random.default_rng(1001).integers(0, len(log) - 20, 10):
        kept[begin : begin + 10] = False  # 5 s of holds of 200 s
    t, u, y = log.t[kept], log.u[kept], log.y[kept]
    breaks = np.flatnonzero(np.diff(t) > 2.5)
    short = Record(u, y, t, "voltage [V]", "distance [mm]")
    found = reduce(short, conversion=LASER)
    assert all(point.known for point in found.points)
    assert found.count("settled") == LEVELS.size
    said = f"{breaks.size} gaps are shorter than half a usual hold and cannot hide one"
    assert any(note.startswith(said) for note in found.notes)
    later = t + np.where(np.arange(t.size) > breaks[-1], 150.0, 0.0)
    long_gap = Record(u, y, later, "voltage [V]", "distance [mm]")
    assert not all(point.known for point in reduce(long_gap).points)


def staircase_log(count, chance=1000):
    """A log with holds of so many samples at 12 inputs, whose outputs settle at once."""
    rng, levels = np.random.default_rng(chance), 6.0 * (np.arange(12) - 6) * (-1.0) ** np.arange(12)
    u = np.repeat(levels, count)
    t = np.arange(u.size) * 60.0 / count
    noise = rng.normal(size=(2, u.size))
    return t, u + 0.005 * noise[0], u + 0.02 * noise[1]


def test_what_has_not_settled_drives_memory_only():
    t, u, y = staircase_log(60)
    y += np.tile(np.linspace(0, 1, 60), 12) * np.repeat(np.arange(12) % 2, 60)
    found = reduce(Record(u, y, t, "field [A]", "position [um]"))
    assert found.count("unsettled") == 6
    assert np.isnan(found.record().y).tolist() == [False, True] * 6
    assert np.isfinite(found.record(unsettled=True).y).all()
    assert all(np.isnan(p.sd) == (p.verdict == "unsettled") for p in found.points)
    assert "6 of 12 holds did not settle" in found.notes[0]
    assert found.columns()["position [um]"].count("") == 6


def test_a_stuck_sensor_is_noticed_and_its_holds_are_left_out():
    t, u, y = staircase_log(120)
    y[410:620] = y[410]  # the end of hold 4, hold 5, the beginning of hold 6
    found = reduce(Record(u, y, t, "field [A]", "position [um]"))
    assert [point.verdict for point in found.points] == ["settled"] * 3 + ["unread"] * 2 + [
        "settled"
    ] * 7
    assert np.flatnonzero(np.isnan(found.record().y)).tolist() == [3, 4]
    (fault,) = found.faults
    assert (fault.kind, fault.samples) == ("stuck", tuple(range(410, 620)))
    assert "from sample 410 to 619; others scatter" in found.notes[0]
    assert Record(u, y).faults == (fault,)


@pytest.mark.parametrize("what", ["empty", "saturated"])
def test_a_hold_without_readings_is_not_told_to_be_longer(what):
    t, u, y = staircase_log(60)
    if what == "empty":
        y[120:180] = np.nan
    else:
        y = np.minimum(y, 20.0)
    found = reduce(Record(u, y, t, "field [A]", "position [um]"))
    assert found.count("unsettled") == 0
    assert found.count("unread") == np.isnan(found.record().y).sum() > 0
    assert f", {found.count('unread')} unread" in str(found)
    assert ("unread", str(found.count("unread"))) in found.summary()
    assert "no reading of the end of" in found.notes[-1]
    assert not any("longer" in note for note in found.notes)


def test_the_standard_deviation_contains_the_resolution_of_the_sensor(long):
    log, truth = long
    step = 0.05
    coarse = Record(log.u, step * np.round(log.y / step), log.t, log.inputs, log.outputs)
    found = reduce(coarse, conversion=LASER)
    assert "whole steps of 0.05, the resolution of the sensor" in " ".join(found.notes)
    settled = [(p.value, p.sd, t) for p, t in zip(found.points, truth, strict=True)]
    value, sd, true = np.array(settled).T
    assert (np.abs(value - true) <= 3 * sd)[np.isfinite(value)].mean() > 0.95
    assert not any("resolution" in note for note in reduce(log, conversion=LASER).notes)


def test_after_a_break_outputs_wait_until_the_memory_is_known():
    levels = [-1.0, 1.0, -1.0, 0.0, -0.5, 0.5, 1.0, 0.2]
    u = np.repeat(levels, 20)
    noise = 1e-3 * np.random.default_rng(1000).normal(size=u.size)
    t = np.arange(u.size)
    t[71:] -= 50  # the clock was set back within the fourth hold
    found = reduce(Record(u, u + noise, t))
    assert np.isnan(found.record().y).tolist() == [False] * 3 + [True] * 3 + [False] * 2
    assert "3 of 8 holds came after a break in time" in found.notes[0]


def test_what_is_no_record_or_too_large_is_refused(long):
    with pytest.raises(ParameterError, match="record is 3; give a Record"):
        reduce(3)
    log, _ = long
    for u, y in ((1e307 * log.u, log.y), (log.u, 4e307 * np.sin(log.t))):
        with pytest.raises(SignalError, match=r"put reaches .*e\+307; scale it to below 1e\+150"):
            reduce(Record(u, y, log.t))


@given(data=st.data())
def test_any_record_is_reduced_or_refused(data):
    count = data.draw(st.integers(1, 60))
    levels = st.sampled_from([0.0, 1.0, -1.0, 1e-300, 1e100, 0.1]) | st.floats(-1, 1)
    u = np.repeat(data.draw(st.lists(levels, min_size=1, max_size=8)), count)
    steps = data.draw(st.sampled_from([0.0, 1e-9, 1.0, 1e6]))
    numbers = st.sampled_from([0.0, 1e100, 5.0, np.nan]) | st.floats(-1, 1)
    y = np.resize(data.draw(st.lists(numbers, min_size=1, max_size=30)), u.size)
    record = Record(u, y, steps * np.arange(u.size), "u", "distance [mm]")
    with suppress(RecordError):
        found = reduce(record, conversion=data.draw(st.sampled_from([None, LASER])), flip="output")
        assert len(found.columns()["verdict"]) == len(found)
        assert found.record().u.size >= 3
        assert [line for line, _ in found.summary()]


def test_an_input_that_never_rests_is_refused_in_one_sentence_without_warnings():
    """Warnings are errors here; holds of three samples are looked for, to name them."""
    t = 0.01 * np.arange(2000)
    u = np.sin(20 * t) * np.exp(-t / 20)
    with pytest.raises(RecordError, match="if the input never rests, identify the record as it"):
        reduce(Record(u, u, t))
