import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from minorloop import Actuator, ParameterError, SignalError
from minorloop.twins.fibre import Fibre
from minorloop.twins.ipmc import Ipmc
from minorloop.twins.ipmc_laser import IpmcLaser

HOLD = 200.0


def settled(inputs, *, hold=HOLD, **options):
    """Curvature at the end of each hold, from the state at rest."""
    twin = Ipmc(**options)
    return np.array([twin.apply(u, hold, hold).y[-1] for u in inputs])


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


def test_a_constant_waveform_equals_a_hold():
    twin, held = Ipmc(), Ipmc()
    t = np.linspace(0, 20, 201)
    wave = twin.drive(t + 5, np.full(t.size, 0.8))
    hold = held.apply(0.8, 20.0, 0.1)
    np.testing.assert_allclose(wave.t, t)
    assert wave.y[0] == pytest.approx(0.35)
    np.testing.assert_allclose(wave.y[1:], hold.y, atol=0.15)


def test_exchange_equals_a_hold_of_one_tick():
    loop, bench = Ipmc(tick=0.5), Ipmc()
    y = [loop.exchange(u) for u in (0.3, 0.6, -0.2)]
    expected = [bench.apply(u, 0.5, 0.5).y[0] for u in (0.3, 0.6, -0.2)]
    np.testing.assert_array_equal(y, expected)
    assert isinstance(y[0], float)
    assert isinstance(loop, Actuator)


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


def test_specimens_differ_by_up_to_a_tenth_and_repeat():
    nominal = Ipmc()._parameters
    for specimen in range(20):
        drawn = Ipmc(specimen)._parameters
        ratios = np.array([drawn[name] / nominal[name] for name in nominal])
        assert np.all(np.abs(ratios - 1) <= 0.1)
        assert np.unique(ratios).size == len(nominal)
        assert drawn == Ipmc(specimen)._parameters
    assert settled([1.2], specimen=1)[0] != settled([1.2], specimen=2)[0]


TWINS = pytest.mark.parametrize("kind", [Ipmc, IpmcLaser, Fibre])
HOLDS = st.lists(st.floats(0.2, 0.65), min_size=1, max_size=12)


@TWINS
@given(before=HOLDS, after=HOLDS, specimen=st.integers(0, 20), drift=st.sampled_from([-0.5, 3.0]))
@settings(max_examples=30)
def test_a_twin_restored_at_any_cut_repeats_exactly(kind, before, after, specimen, drift):
    twin, other = (kind(specimen, 0.1, 5, drift=drift) for _ in range(2))
    for u in before:
        twin.apply(u, 300.0, 300.0)
    kept = json.loads(json.dumps(twin.checkpoint()))
    first = [twin.exchange(u) for u in after]
    for again in (twin, other):
        again.restore(kept)
        assert again.checkpoint() == kept
        assert [again.exchange(u) for u in after] == first
    twin.reset()
    assert twin.checkpoint() == kind(specimen, 0.1, 5, drift=drift).checkpoint()


@TWINS
def test_a_waveform_begins_at_the_present_output(kind):
    twin = kind(specimen=1, drift=0.5)
    now = twin.apply(0.5, 30.0, 30.0).y[-1]
    record = twin.drive([0.0, 60.0], [0.5, 0.4])
    assert record.y[0] == pytest.approx(now, rel=1e-12)
    np.testing.assert_allclose(record.t, [30.0, 90.0])


@pytest.mark.parametrize(("kind", "rest"), [(Ipmc, 0.35), (Fibre, 0.0)])
def test_drift_changes_the_gain_per_hour(kind, rest):
    steady, drifting = kind(), kind(drift=0.1)
    y = [twin.apply(0.5, 3600.0, 3600.0).y[-1] - rest for twin in (steady, drifting)]
    assert y[1] / y[0] == pytest.approx(1.1, abs=0.003)


REFUSED = [
    (ParameterError, "duration is 0.0; give a positive", lambda: Ipmc().apply(0.0, 0.0, 1.0)),
    (ParameterError, "sample_interval is 0.0", lambda: Ipmc().apply(0.0, 1.0, 0.0)),
    (ParameterError, "samples, more than", lambda: Ipmc().apply(0.0, 1.0, 1e-12)),
    (SignalError, r"u has shape \(1,\) and t \(2,\)", lambda: Ipmc().drive([0, 1], [0.0])),
    (SignalError, "does not increase at index 2", lambda: Ipmc().drive([0, 1, 1], [0.0, 0, 0])),
    (ParameterError, "specimen", lambda: Ipmc(specimen=-1)),
    (ParameterError, "noise", lambda: Ipmc(noise=-0.1)),
]


@pytest.mark.parametrize(("error", "words", "make"), REFUSED)
def test_says_what_is_wrong(error, words, make):
    with pytest.raises(error, match=words):
        make()
