import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop.errors import LimitError, ParameterError, SignalError
from minorloop.lab.actuator import Actuator
from minorloop.lab.records import Record
from minorloop.twins.ipmc import Ipmc

LEVELS = np.linspace(-1.2, 1.2, 11)
HOLD = 200.0


def settled(inputs, *, hold=HOLD, **options):
    """Curvature at the end of each hold, from the state at rest."""
    twin = Ipmc(**options)
    return np.array([twin.apply(u, hold, hold).y[-1] for u in inputs])


def decaying_staircase():
    """Ten bands up, nine down, eight up, ...: 56 inputs."""
    level, inputs = 0, [LEVELS[0]]
    for turn, length in enumerate(range(10, 0, -1)):
        for _ in range(length):
            level += 1 if turn % 2 == 0 else -1
            inputs.append(LEVELS[level])
    return np.array(inputs)


def replay(reference, substeps=1):
    """Follow the input of the reference file; the output at its times."""
    t, u, _ = reference.T
    twin, began, first, pieces = Ipmc(substeps=substeps), 0.0, 0, []
    sine = int(np.searchsorted(t, 5720.05))
    while first < sine:
        interval = round(t[first] - began, 6)
        last = first
        while (
            last + 1 < sine
            and u[last + 1] == u[first]
            and interval == round(t[last + 1] - t[last], 6)
        ):
            last += 1
        pieces.append(twin.apply(u[first], t[last] - began, interval).y)
        began, first = t[last], last + 1
    fine = np.linspace(0.0, 40.0, 4 * 240 + 1)
    wave = twin.drive(fine, 0.7 * np.sin(2 * np.pi * 0.1 * fine))
    return np.concatenate([*pieces, np.interp(t[sine:], wave.t, wave.y)])


@pytest.fixture(scope="module")
def reference(shared_data):
    file = shared_data / "twins" / "ipmc_reference.csv"
    if not file.is_file():
        pytest.skip(f"needs {file.name}, which is not in ../shared/data/twins")
    return np.loadtxt(file, delimiter=",", skiprows=1)


def ends_of_holds(u, upto):
    return np.flatnonzero(np.diff(u[:upto]) != 0)


def test_follows_the_reference(reference):
    _, u, y = reference.T
    error = np.abs(replay(reference) - y) / np.ptp(y)
    assert error.max() < 0.01
    assert error[ends_of_holds(u, 1280)].max() < 0.001


def test_halving_the_step_changes_little(reference):
    _, u, y = reference.T
    change = np.abs(replay(reference, substeps=2) - replay(reference)) / np.ptp(y)
    assert change.max() < 0.01
    assert change[ends_of_holds(u, 1280)].max() < 0.001


def test_the_decaying_staircase_has_the_published_trend():
    u = decaying_staircase()
    y = settled(u)
    assert u.size == 56
    np.testing.assert_allclose(np.polyfit(u, y, 2), [-0.36, 8.20, 0.34], atol=0.006)
    np.testing.assert_allclose([y.min(), y.max()], [-9.5, 9.4], atol=0.05)


def test_the_loop_is_a_fifth_of_the_range_wide():
    up = settled([-1.2, *LEVELS])[1:]
    down = settled([-1.2, *LEVELS, *LEVELS[::-1]])[-11:][::-1]
    assert np.max(down - up) / (down[-1] - up[0]) == pytest.approx(0.2, abs=0.01)


def test_overshoots_then_relaxes_back_and_settles():
    twin = Ipmc()
    twin.apply(-1.2, HOLD, HOLD)
    y = twin.apply(1.2, HOLD, 0.1).y
    assert 17 < y.max() < 18
    assert y[-1] == pytest.approx(9.43, abs=0.02)


def test_little_is_left_to_settle_after_a_hold():
    twin, left = Ipmc(), []
    for u in (-1.2, -0.6, 0.0, 1.2, 0.0):
        y = twin.apply(u, HOLD, HOLD).y[-1]
        left.append(abs(twin.apply(u, 2000.0, 2000.0).y[-1] - y))
    assert 1e-4 < max(left) < 0.003


def test_gain_grows_with_the_amplitude():
    t = np.arange(8 * 240 + 1) / 240 / 0.1
    carrier = np.exp(-2j * np.pi * 0.1 * t)
    gains = []
    for amplitude in (0.7, 1.0):
        y = Ipmc().drive(t, -amplitude * carrier.imag).y
        gains.append(abs(np.mean(y[-960:] * carrier[-960:])) / amplitude)
    assert 20 * np.log10(gains[1] / gains[0]) == pytest.approx(0.75, abs=0.1)


def test_is_no_preisach_operator_loops_are_not_congruent():
    heights = []
    for past in ([-1.2], [-1.2, 1.2], [1.2, -1.2, 0.9, -0.9]):
        y = settled([*past, -0.24, 0.24, -0.24, 0.24])
        heights.append(y[-1] - y[-2])
    assert np.ptp(heights) / np.mean(heights) > 0.03


def test_is_no_preisach_operator_excursions_are_not_wiped_out():
    straight = settled([-1.2, 0.24])[-1]
    around = settled([-1.2, 0.24, -0.24, 0.24])[-1]
    later = settled([-1.2, 0.24, 0.96])[-1] - settled([-1.2, 0.24, -0.24, 0.24, 0.96])[-1]
    assert 0.01 < abs(around - straight) / 19 < 0.05
    assert abs(later) / 19 > 0.002


def test_a_hold_does_not_depend_on_how_it_is_sampled():
    whole, fine, pieces = Ipmc(), Ipmc(), Ipmc()
    expected = whole.apply(1.0, 200.0, 200.0).y[-1]
    assert fine.apply(1.0, 200.0, 0.5).y[-1] == pytest.approx(expected, abs=2e-3)
    for _ in range(20):
        last = pieces.apply(1.0, 10.0, 10.0).y[-1]
    assert last == pytest.approx(expected, abs=2e-3)
    assert pieces.clock == pytest.approx(200.0)


@pytest.mark.parametrize(
    ("duration", "interval", "times"),
    [
        (1.0, 0.25, [0.25, 0.5, 0.75, 1.0]),
        (1.0, 0.4, [0.4, 0.8, 1.0]),
        (0.3, 0.1, [0.1, 0.2, 0.3]),
        (1.0, 5.0, [1.0]),
    ],
)
def test_samples_come_at_each_interval_and_at_the_end(duration, interval, times):
    twin = Ipmc()
    record = twin.apply(0.5, duration, interval)
    np.testing.assert_allclose(record.t, times, rtol=1e-12)
    again = twin.apply(0.5, duration, interval)
    np.testing.assert_allclose(again.t, duration + np.array(times), rtol=1e-12)
    np.testing.assert_array_equal(record.u, 0.5)
    assert (str(record.input), str(record.output)) == ("voltage [V]", "curvature [1/m]")


def test_a_waveform_that_rests_is_a_hold():
    twin, held = Ipmc(), Ipmc()
    t = np.linspace(0, 20, 201)
    wave = twin.drive(t + 5, np.full(t.size, 0.8))
    hold = held.apply(0.8, 20.0, 0.1)
    np.testing.assert_allclose(wave.t, t)
    assert wave.y[0] == pytest.approx(0.35)
    np.testing.assert_allclose(wave.y[1:], hold.y, atol=0.15)


def test_exchange_is_a_hold_of_one_tick():
    loop, bench = Ipmc(tick=0.5), Ipmc()
    y = [loop.exchange(u) for u in (0.3, 0.6, -0.2)]
    expected = [bench.apply(u, 0.5, 0.5).y[0] for u in (0.3, 0.6, -0.2)]
    np.testing.assert_array_equal(y, expected)
    assert isinstance(y[0], float)
    assert isinstance(loop, Actuator)


@given(st.integers(0, 30), st.integers(1, 30), st.integers(0, 5))
def test_a_restored_twin_repeats_exactly(before, after, seed):
    twin = Ipmc(specimen=2, noise=0.1, seed=seed, drift=0.2)
    for k in range(before):
        twin.exchange(np.sin(k))
    kept = json.loads(json.dumps(twin.checkpoint()))
    first = [twin.exchange(np.cos(k)) for k in range(after)]
    other = Ipmc(specimen=2, noise=0.1, seed=seed, drift=0.2)
    for again in (twin, other):
        again.restore(kept)
        assert [again.exchange(np.cos(k)) for k in range(after)] == first


@given(st.lists(st.integers(1, 40), min_size=1, max_size=6))
def test_noise_depends_on_the_seed_and_the_sample_number_alone(pieces):
    clean = Ipmc()
    noisy, whole = Ipmc(noise=0.2, seed=7), Ipmc(noise=0.2, seed=7)
    parts = [noisy.apply(0.5, float(n), 1.0).y - clean.apply(0.5, float(n), 1.0).y for n in pieces]
    total = float(sum(pieces))
    at_once = whole.apply(-1.0, total, 1.0).y - Ipmc().apply(-1.0, total, 1.0).y
    np.testing.assert_allclose(np.concatenate(parts), at_once, atol=1e-12)


def test_noise_is_gaussian_and_independent():
    options = {"noise": 0.3, "seed": 3}
    noise = Ipmc(**options).apply(0.0, 20_000.0, 1.0).y - Ipmc().apply(0.0, 20_000.0, 1.0).y
    assert np.std(noise) == pytest.approx(0.3, rel=0.03)
    assert abs(np.mean(noise)) < 0.01
    assert np.mean(np.abs(noise) < 0.3) == pytest.approx(0.6827, abs=0.015)
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.03


def test_reset_goes_back_to_the_start():
    twin = Ipmc(noise=0.1)
    first = twin.apply(1.0, 10.0, 1.0)
    twin.reset()
    again = twin.apply(1.0, 10.0, 1.0)
    np.testing.assert_array_equal(again.y, first.y)
    np.testing.assert_array_equal(again.t, first.t)


def test_safe_takes_the_voltage_off():
    twin, other = Ipmc(), Ipmc()
    for each in (twin, other):
        each.apply(1.0, 10.0, 10.0)
    twin.safe()
    assert twin.clock == other.clock
    assert twin.apply(0.0, 5.0, 5.0).y[-1] == other.apply(0.0, 5.0, 5.0).y[-1]


def test_specimens_differ_by_up_to_a_tenth_and_repeat():
    nominal = Ipmc()._parameters
    for specimen in range(20):
        drawn = Ipmc(specimen)._parameters
        ratios = np.array([drawn[name] / nominal[name] for name in nominal])
        assert np.all(np.abs(ratios - 1) <= 0.1)
        assert np.unique(ratios).size == len(nominal)
        assert drawn == Ipmc(specimen)._parameters
    assert settled([1.2], specimen=1)[0] != settled([1.2], specimen=2)[0]


@pytest.mark.parametrize("specimen", range(20))
def test_every_specimen_bends_with_the_voltage(specimen):
    assert np.all(np.diff(settled([-1.2, *LEVELS], specimen=specimen)[1:]) > 0)


def test_a_waveform_begins_at_the_output_of_now():
    twin = Ipmc(specimen=1, drift=0.5)
    now = twin.apply(1.0, 1000.0, 1000.0).y[-1]
    assert twin.drive([0.0, 1.0], [-1.0, -1.0]).y[0] == pytest.approx(now, rel=1e-12)


def test_drift_changes_the_gain_by_so_much_an_hour():
    steady, drifting = (
        settled([0.9] * 19, drift=drift) - Ipmc()._parameters["set"] for drift in (0.0, -0.05)
    )
    ratio = drifting[-1] / steady[-1]
    assert ratio == pytest.approx(0.95 ** (19 * HOLD / 3600), abs=0.003)


@pytest.mark.parametrize("u", [1.3, -1.2001, np.nan, np.inf])
def test_refuses_an_input_beyond_its_limits_and_stays_where_it_is(u):
    twin = Ipmc()
    twin.exchange(0.5)
    before = twin.checkpoint()
    for attempt in (
        lambda: twin.apply(u, 1.0, 1.0),
        lambda: twin.exchange(u),
    ):
        with pytest.raises(LimitError, match="beyond the limits"):
            attempt()
    with pytest.raises((LimitError, SignalError)):
        twin.drive([0.0, 1.0, 2.0], [0.0, u, 0.0])
    assert twin.checkpoint() == before


@pytest.mark.parametrize(
    ("duration", "interval", "complaint"),
    [
        (0.0, 1.0, "duration is 0.0; give a positive"),
        (-1.0, 1.0, "duration is -1.0"),
        (np.inf, 1.0, "duration is inf"),
        (1.0, 0.0, "sample_interval is 0.0"),
        (1.0, np.nan, "sample_interval is nan"),
        (1.0, 1e-12, "samples, more than"),
        (1e15, 1e15, "steps, more than"),
    ],
)
def test_refuses_times_that_are_none(duration, interval, complaint):
    with pytest.raises(ParameterError, match=complaint):
        Ipmc().apply(0.0, duration, interval)


@pytest.mark.parametrize(
    ("t", "u", "complaint"),
    [
        ([0, 1], [0.0], r"t has shape \(2,\) and u \(1,\)"),
        ([0], [0.0], "T at least 2"),
        ([0, 1, 1], [0.0, 0, 0], "does not increase at index 2"),
        ([0, np.nan], [0.0, 0.0], "t is nan"),
    ],
)
def test_refuses_waveforms_that_are_none(t, u, complaint):
    with pytest.raises(SignalError, match=complaint):
        Ipmc().drive(t, u)
    with pytest.raises(SignalError, match=complaint):
        Ipmc().sense(t, u)


@pytest.mark.parametrize(
    "options",
    [
        {"specimen": -1},
        {"specimen": 1.5},
        {"seed": True},
        {"seed": 2**64},
        {"noise": -0.1},
        {"noise": np.nan},
        {"tick": 0.0},
        {"drift": -1.0},
        {"substeps": 0},
    ],
)
def test_refuses_options_out_of_range(options):
    with pytest.raises(ParameterError, match=next(iter(options))):
        Ipmc(**options)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"twin": "fibre"}, "has twin 'fibre' and this twin 'ipmc'"),
        ({"specimen": 4}, "has specimen 4"),
        ({"seed": 4}, "has seed 4"),
        ({"state": [0.0]}, "damaged"),
        ({"state": "x"}, "damaged"),
        ({"state": [np.nan] * 6}, "damaged"),
        ({"clock": -1.0}, "damaged"),
        ({"held": None}, "damaged"),
        ({"held": 5.0}, "damaged: held is 5"),
        ({"samples": np.inf}, "damaged: samples is inf"),
        ({"input": 10**400}, "damaged: input is not made of numbers"),
        ({"input": 3.0}, "damaged: voltage is 3"),
        ({"state": [2.4, 0, 0, 0, 0, 0]}, r"damaged: state \[0\] is 2\.4"),
        ({"state": [0, 0, 0, -0.2, 0, 0]}, r"damaged: state \[3\] is -0\.2"),
        ({"tick": 0.5}, r"has tick 0\.5 and this twin 0\.1"),
        ({"substeps": 2}, "has substeps 2 and this twin 1"),
    ],
)
def test_refuses_a_checkpoint_of_another_or_a_damaged_one(change, complaint):
    twin = Ipmc()
    with pytest.raises(ParameterError, match=complaint):
        twin.restore(twin.checkpoint() | change)
    with pytest.raises(ParameterError, match="twin None"):
        twin.restore({})
    for nothing in (None, [], 3):
        with pytest.raises(ParameterError, match="give the dict that checkpoint"):
            twin.restore(nothing)


@given(st.lists(st.floats(-1.2, 1.2), min_size=1, max_size=12), st.sampled_from([-0.5, 0.0, 3.0]))
def test_whatever_is_done_to_a_strip_is_restored(voltages, drift):
    twin = Ipmc(3, drift=drift)
    for voltage in voltages:
        twin.apply(voltage, 100.0, 100.0)
        kept = twin.checkpoint()
        twin.restore(kept)
        assert twin.checkpoint() == kept


def test_senses_bending_and_forgets_it():
    t = np.linspace(0, 40, 401)
    record = Ipmc().sense(t, np.minimum(t / 0.5, 1.0) * 10.0)
    assert (str(record.input), str(record.output)) == ("curvature [1/m]", "voltage [mV]")
    assert 2.0 < record.y.max() < 2.5
    assert abs(record.y[-1]) < 1e-3
    tau = -1 / np.polyfit(t[20:200], np.log(record.y[20:200]), 1)[0]
    assert tau == pytest.approx(4.0, rel=1e-6)
    assert isinstance(record, Record)


def test_sensing_is_linear_and_needs_no_fine_samples():
    t = np.linspace(0, 10, 11)
    bend = np.abs(t - 5.0)
    coarse = Ipmc().sense(t, bend)
    fine = Ipmc().sense(np.linspace(0, 10, 1001), np.interp(np.linspace(0, 10, 1001), t, bend))
    np.testing.assert_allclose(fine.y[::100], coarse.y, atol=1e-12)
    np.testing.assert_allclose(Ipmc().sense(t, -2 * bend).y, -2 * coarse.y, atol=1e-12)
