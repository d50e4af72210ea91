import numpy as np
import pytest

import fixed_options
from long_branches import a_record_with_long_branches
from minorloop import (
    Gaussian,
    ParameterError,
    Plane,
    Preisach,
    Record,
    Smooth,
    connect,
    excitation,
    identify,
)
from minorloop.identification import condensing, fitting, posterior, prior_fit
from minorloop.identification.bands import PER_DEVIATION
from minorloop.identification.pipeline import Options
from minorloop.identification.posterior import DensePosterior, SparsePosterior
from minorloop.lab.settled_holds import hold_each

LEVELS = np.linspace(-1.2, 1.2, 21)


@pytest.fixture
def sparse(monkeypatch):
    """Use the sparse system for planes of any size."""
    monkeypatch.setattr(posterior, "_LEAST_SPARSE", 0)
    monkeypatch.setattr(posterior, "_FILL", np.inf)
    monkeypatch.setattr(prior_fit, "MOST_CORRELATED", 0)


def measured(u, noise=0.0, specimen=1, seed=0):
    twin = connect("twin:ipmc", specimen=specimen, noise=noise, seed=seed)
    return hold_each(twin, u, 200.0, 200.0)[1]


@pytest.mark.parametrize("place", [5, 9, 30])
def test_an_outlier_is_left_out_and_named(place):
    stairs = excitation.decaying_staircase(np.linspace(-1.2, 1.2, 11))
    y = measured(stairs, 0.05)
    y[place] += 3.0
    fit = identify(stairs, y, Plane(LEVELS, diagonal="reversible"), prior=Gaussian())
    assert fit.suspects == (place,)
    assert f"sample {place} " in fit.advice[0]
    assert "and repeat, or empty" in fit.advice[0]
    assert not fit.fitted[place]


def test_auto_takes_the_prior_for_few_samples_only_where_it_is_slow(monkeypatch):
    monkeypatch.setattr(posterior, "_MOST_CHEAP_CELLS", 10)
    rng = np.random.default_rng(0)
    model = Preisach(np.linspace(0, 1, 6), np.tril(np.ones((5, 5))))
    u = rng.uniform(0, 1, 400)
    y = model.simulate(u) + rng.normal(0, 0.05, u.size)
    assert identify(u, y, Plane(5)).posterior is None
    assert identify(u[:30], y[:30], Plane(5)).posterior is not None
    assert identify(u[:30], y[:30], Plane(5), prior=Smooth(0.0)).posterior is None
    assert identify(u[:30], y[:30], Plane(5), prior=Smooth()).posterior is None


@pytest.mark.parametrize("options", [{}, {"slope": True}, {"offset": False}, {"signed": True}])
def test_the_sparse_system_gives_the_fit_and_the_bands_of_dense_matrices(
    sparse, options, monkeypatch
):
    model, u, y = a_record_with_long_branches()
    options = {"levels": model.levels, "prior": "gaussian", **options}
    fast = Options.of(options).identify(Record(u, y))
    monkeypatch.setattr(posterior, "_LEAST_SPARSE", np.inf)
    slow = Options.of(options).identify(Record(u, y))
    assert isinstance(fast.posterior, SparsePosterior)
    assert isinstance(slow.posterior, DensePosterior)
    assert fast.kkt < 1e-10
    new = np.random.default_rng(1).uniform(-1, 1, 20)
    one, other = fast.predict(new, bands=0.9), slow.predict(new, bands=0.9)
    np.testing.assert_allclose(one.y, other.y, atol=2e-3 * np.ptp(y))
    np.testing.assert_allclose(one.sd, other.sd, rtol=0.1)


def test_a_condensed_record_is_fitted_like_the_long_one(sparse, monkeypatch):
    model, u, y = a_record_with_long_branches(each=40)
    options = {"levels": model.levels, "prior": "gaussian"}
    long = Options.of(options).identify(Record(u, y))
    for module in (condensing, fitting):
        monkeypatch.setattr(module, "LONG", 100)
    short = Options.of(options).identify(Record(u, y))
    assert short.matrix.samples < u.size / 2
    np.testing.assert_allclose(short.prediction, long.prediction, atol=2e-4 * np.ptp(y))
    some = np.arange(u.size) % 20 == 0
    one, other = (each.posterior.deviation(u, "negative", some) for each in (short, long))
    np.testing.assert_allclose(one, other, rtol=0.01)


def test_the_prior_does_not_depend_on_the_unit_of_the_input():
    model, u, y = a_record_with_long_branches(each=3)
    found = [
        identify(k * u, y, Plane(k * model.levels, slope=True), prior=Gaussian()).prediction
        for k in (1.0, 1e-4)
    ]
    np.testing.assert_allclose(found[1], found[0], atol=1e-4 * np.ptp(y))


def test_planes_too_fine_for_dense_matrices_are_smoothed_where_the_input_reverses_often(
    monkeypatch,
):
    for name in ("MOST_DENSE_CELLS", "_MOST_CHEAP_CELLS"):
        monkeypatch.setattr(posterior, name, 10)
    monkeypatch.setattr(prior_fit, "MOST_DENSE_CELLS", 10)
    monkeypatch.setattr(posterior, "_MOST_CELLS", 20)
    rng = np.random.default_rng(0)
    u = rng.uniform(0, 1, 60)
    assert identify(u, u**2, Plane(8)).posterior is None
    with pytest.raises(ParameterError, match=r"reverses \d+ times and the plane has 8 bands"):
        identify(u, u**2, Plane(8), prior=Gaussian())


@pytest.mark.parametrize("given", ["one", "each", "none"])
def test_bands_of_as_many_unknowns_as_readings_are_no_narrower_than_the_noise(given):
    """A decaying staircase over all six levels determines the plane exactly."""
    model = Preisach(np.linspace(-10, 10, 7), np.tril(np.ones((6, 6))), diagonal="reversible")
    u, noise, shares = excitation.decaying_staircase(model.levels), 0.05, []
    future = np.random.default_rng(1000).choice(model.levels, 30)
    for seed in range(1000, 1010):
        rng = np.random.default_rng(seed)
        sd = {"one": noise, "each": np.full(u.size, noise), "none": None}[given]
        y = model.simulate(u) + noise * rng.normal(size=u.size)
        found = fixed_options.identify(
            Record(u, y, sd=sd),
            fixed_options.Plane(6, diagonal="reversible", signed=True),
            prior=Smooth(0.0),
        )
        assert found.rmse < 1e-6 * np.ptp(y)
        truth, bands = model.simulate(future), found.predict(future, bands=0.9)
        reading = truth + noise * rng.normal(size=truth.size)
        of_reading = np.hypot(bands.sd, 0.0 if sd is None else noise)
        shares.append(
            [bands.covers(truth), np.mean(np.abs(reading - bands.y) <= PER_DEVIATION * of_reading)]
        )
        assert found.band_sd >= 0.5 * noise
    assert np.mean(shares, axis=0).min() >= 0.85


def test_an_exact_fit_to_readings_without_noise_has_narrow_bands():
    model = Preisach(np.linspace(-10, 10, 7), np.tril(np.ones((6, 6))), diagonal="reversible")
    u = excitation.decaying_staircase(model.levels)
    y = model.simulate(u)
    found = fixed_options.identify(
        Record(u, y, sd=0.0), fixed_options.Plane(6, diagonal="reversible")
    )
    assert found.band_sd < 1e-3 * np.ptp(y)


def test_a_fit_is_optimal_where_far_weights_have_hardly_any_variance():
    # The likelihood of this record is greatest at a decay of 0.08: deviations fall to 2e-8.
    rng, bands, samples = np.random.default_rng([584216, 100, 1000]), 100, 1000
    rough, grid = 0.7 + 0.6 * rng.uniform(0, 1, (bands, bands)), np.linspace(-1, 1, bands)
    _, near, far = rng.random(), rng.uniform(1, 8), rng.uniform(0, 2)
    across, along = near * (grid[:, None] - grid) ** 2, far * (grid[:, None] + grid) ** 2
    density = np.tril(np.exp(-across - along) * rough)
    model = Preisach.from_density(np.linspace(-1, 1, bands + 1), density)
    walk = np.cumsum(rng.normal(size=samples))
    u = walk / np.abs(walk).max()
    y = model.simulate(u)
    y = y + 0.005 * np.ptp(y) * rng.normal(size=samples)
    assert identify(Record(u, y), Plane(levels=model.levels)).kkt < 1e-12
