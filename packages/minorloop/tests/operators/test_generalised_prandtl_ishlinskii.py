import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop import GeneralisedPrandtlIshlinskii, PrandtlIshlinskii
from minorloop.operators.generalised_prandtl_ishlinskii import DeadZones

signals = st.lists(st.floats(-10, 10), min_size=1, max_size=60).map(np.array)
MODEL = GeneralisedPrandtlIshlinskii(
    PrandtlIshlinskii([0.0, 0.5, 1.5], [1.0, 0.5, 0.25], 0.3),
    DeadZones.from_slopes([-4.0, -1.0, 2.0], [0.2, 0.7, 1.0, 0.4]),
    offset=7.0,
)


def saturating_plant(u):
    """A system outside the fitted family: uneven plays and a shifted hyperbolic tangent."""
    radii = np.array([0.0, 0.13, 0.29, 0.52, 0.81])
    weights = np.array([0.4, 0.25, 0.2, 0.2, 0.15])
    position, outputs = np.zeros(5), []
    for sample in u:
        position = np.clip(position, sample - radii, sample + radii)
        outputs.append(5.0 + 2.0 * np.tanh(1.8 * position @ weights - 0.4))
    return np.array(outputs)


def nrmse(model, u, y):
    return np.sqrt(np.mean((model.simulate(u, "relaxed") - y) ** 2)) / np.ptp(y)


@given(signals)
def test_equals_the_curve_applied_to_the_plays(u):
    expected = 7.0 + MODEL.zones(MODEL.plays.simulate(u, "relaxed"))
    np.testing.assert_array_equal(MODEL.simulate(u, "relaxed"), expected)


def test_fit_is_ten_times_better_than_plays_alone_on_unseen_saturating_loops():
    time = np.linspace(0, 1, 2000)
    u = np.sin(2 * np.pi * 6 * time) * (1.2 - 1.1 * time)
    levels = np.random.default_rng(5).uniform(-1.15, 1.15, 25)
    unseen = np.interp(time, np.linspace(0, 1, 25), levels)
    bent = GeneralisedPrandtlIshlinskii.fit(u, saturating_plant(u), start="relaxed")
    plain = GeneralisedPrandtlIshlinskii.fit(u, saturating_plant(u), thresholds=0, start="relaxed")
    wanted = saturating_plant(unseen)
    assert nrmse(bent, unseen, wanted) < 0.005
    assert nrmse(bent, unseen, wanted) < 0.1 * nrmse(plain, unseen, wanted)
    assert bent.invert(wanted, "relaxed").worst <= 1e-12 * np.ptp(wanted)


def test_fit_finds_a_member_of_the_family():
    u = np.random.default_rng(6).uniform(-6, 6, 600)
    y = MODEL.simulate(u, "relaxed")
    knots = MODEL.offset + MODEL.zones(MODEL.zones.knots)
    found = GeneralisedPrandtlIshlinskii.fit(
        u, y, radii=MODEL.plays.radii, thresholds=knots, start="relaxed"
    )
    assert nrmse(found, u, y) < 1e-9
    np.testing.assert_allclose(found.zones.slopes, MODEL.zones.slopes, rtol=1e-6)


def test_without_thresholds_a_fit_finds_the_plays_that_made_the_record():
    truth = PrandtlIshlinskii([0.0, 0.25, 0.7, 1.5], [0.4, 0.0, 1.2, 0.3], 4.0)
    u = np.random.default_rng(3).uniform(-2, 2, 400)
    y = truth.simulate(u, "relaxed")
    y[::7] = np.nan
    found = GeneralisedPrandtlIshlinskii.fit(u, y, radii=truth.radii, thresholds=0, start="relaxed")
    np.testing.assert_allclose(found.plays.weights, truth.weights, atol=1e-9)
    assert found.simulate([0.0], "relaxed") == pytest.approx(truth.simulate([0.0], "relaxed"))


@pytest.mark.parametrize("thresholds", [0, 3])
def test_a_fit_can_always_be_inverted(thresholds):
    u = np.sin(np.linspace(0, 12, 300))
    clockwise = -np.random.default_rng(4).normal(size=300)
    model = GeneralisedPrandtlIshlinskii.fit(u, clockwise, radii=6, thresholds=thresholds)
    assert model.invertible
    assert model.plays.radii.size == 6
    assert (model.plays.weights >= 0).all()
    assert model.invert(clockwise).worst <= 1e-12 * np.ptp(clockwise)


points = st.lists(st.floats(-20, 20), min_size=1, max_size=40).map(np.array)


@st.composite
def curves(draw):
    below = draw(st.lists(st.floats(0.05, 3), max_size=4))
    above = draw(st.lists(st.floats(0.05, 3), max_size=4))
    knots = np.concatenate([-np.cumsum(below)[::-1], np.cumsum(above)])
    count = knots.size + 1
    slopes = draw(st.lists(st.floats(0.05, 5), min_size=count, max_size=count))
    return DeadZones.from_slopes(knots, slopes)


def by_definition(zones, x):
    total = np.zeros_like(x)
    for threshold, weight in zip(zones.thresholds, zones.weights, strict=True):
        if threshold > 0:
            total += weight * np.maximum(x - threshold, 0)
        elif threshold < 0:
            total += weight * np.minimum(x - threshold, 0)
        else:
            total += weight * x
    return total


@given(curves(), points)
def test_is_the_weighted_sum_of_dead_zones(zones, x):
    np.testing.assert_allclose(zones(x), by_definition(zones, x), atol=1e-11)


@given(curves(), points)
def test_inverse_undoes_and_is_undone(zones, x):
    np.testing.assert_allclose(zones.invert(zones(x)), x, atol=1e-10)
    np.testing.assert_allclose(zones(zones.invert(x)), x, atol=1e-12)
