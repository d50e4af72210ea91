import numpy as np
import pytest

from fixed_options import Plane, identify
from minorloop import Preisach
from minorloop.identification import prior_fit
from minorloop.identification.bands import Prediction

MODEL = Preisach(np.linspace(0, 1, 6), np.tril(np.ones((5, 5))))
U = np.random.default_rng(0).uniform(0, 1, 25)


@pytest.fixture(scope="module")
def fit():
    y = MODEL.simulate(U) + np.random.default_rng(1).normal(0, 0.1, 25)
    return identify(U, y, Plane(8))


def test_bands_cover_their_share():
    rng = np.random.default_rng(2)
    y, sd = rng.normal(size=20_000), np.full(20_000, 0.5)
    shown = Prediction(y, y, sd, 0.9)
    assert shown.covers(y + sd * rng.normal(size=y.size)) == pytest.approx(0.9, abs=0.01)
    np.testing.assert_allclose((shown.upper + shown.lower) / 2, y)


def test_missing_outputs_are_not_counted():
    shown = Prediction(np.zeros(3), np.zeros(3), np.ones(3), 0.5)
    assert shown.covers(np.array([0.0, np.nan, 9.0])) == 0.5
    assert np.isnan(shown.covers(np.full(3, np.nan)))


def many_plays(u):
    """Output of plays with widths from a continuous distribution."""
    rng = np.random.default_rng(1000)
    width, middle = rng.gamma(2.0, 0.15, 200), rng.normal(0, 0.3, 200)
    place, y = -1 - width, np.empty(u.size)
    for k, value in enumerate(u):
        place = np.clip(place, value - width, value + width)
        y[k] = np.tanh(4 * (place - middle)).mean()
    return y / np.ptp(y)


def readings_in_bands(samples, levels, noise):
    rng = np.random.default_rng(1000)
    u = rng.uniform(-1, 1, samples + 200)
    y = many_plays(u) + noise * rng.normal(size=u.size)
    found = identify(u[:samples], y[:samples], Plane(np.linspace(-1, 1, levels + 1)))
    shown = found.predict(u, bands=0.9)
    return np.mean((np.abs(shown.y - y) <= shown.half_width)[samples:])


@pytest.mark.parametrize("noise", [0.03, 0.1])
def test_bands_hold_readings_at_the_limit_of_few_samples(noise):
    for samples in (prior_fit.MOST_CORRELATED, prior_fit.MOST_CORRELATED + 1):
        assert 0.85 <= readings_in_bands(samples, 25, noise) <= 0.96


def test_bands_of_true_outputs_are_those_without_the_noise(fit):
    shown = fit.predict(U, bands=0.9)
    assert shown.noise > 0
    np.testing.assert_allclose(np.hypot(shown.without_noise().sd, shown.noise), shown.sd)
