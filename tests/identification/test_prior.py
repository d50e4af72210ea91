import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop.connect import connect
from minorloop.errors import ParameterError
from minorloop.identification import excitation, identify, prior
from minorloop.identification.design import design
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec
from minorloop.operators.memory import Memory
from minorloop.operators.preisach import Preisach
from minorloop.studies.holds import hold_each

LEVELS = np.linspace(-1.2, 1.2, 21)
SEQUENCE = -1.2 + 2.4 * np.array([0, 0.85, 0.3, 0.5, 0.95, 0.55, 0.1, 0.35, 0.65, 0.5, 1, 0.75])


def measured(u, noise=0.0, specimen=1, seed=0):
    twin = connect("twin:ipmc", specimen=specimen, noise=noise, seed=seed)
    return hold_each(twin, u, 200.0, 200.0)[1]


@given(st.integers(0, 10_000), st.sampled_from(["uniform", "reversible"]))
def test_rows_are_those_of_the_tree(seed, diagonal):
    rng = np.random.default_rng(seed)
    relay = ["bipolar", "unipolar"][seed % 2]
    spec = PlaneSpec(np.sort(rng.uniform(-1, 1, 7)), relay, diagonal, slope=bool(seed % 3))
    u = rng.choice([rng.uniform(-1.3, 1.3, 30), rng.choice(spec.levels, 30)])
    seen = rng.random(30) < 0.6
    start = ["negative", "positive", Memory([spec.levels[0], spec.levels[4], spec.levels[2]])]
    begin = start[seed % 3]
    rows, _ = prior.regressors(spec, u, seen, begin)
    np.testing.assert_allclose(rows, DesignMatrix(spec, u, seen, begin).dense(), atol=1e-12)


def test_features_are_the_input_and_the_last_extrema():
    spec = PlaneSpec(np.linspace(0, 1, 5))
    u = np.array([0.2, 0.9, 0.4, 0.6])
    _, features = prior.regressors(spec, u, np.ones(4, dtype=bool), "negative")
    np.testing.assert_allclose(features, [[0.2, 0, 0], [0.9, 0, 0], [0.4, 0.9, 0], [0.6, 0.4, 0.9]])


def test_the_posterior_is_that_of_a_gaussian_process():
    """Against the textbook formula, on dense matrices: Rasmussen and Williams, eq. 2.26."""
    spec = PlaneSpec(np.linspace(0, 1, 5), diagonal="reversible")
    rng = np.random.default_rng(0)
    u, new = rng.uniform(0, 1, 9), rng.uniform(0, 1, 6)
    rows, features = prior.regressors(spec, u, np.ones(9, dtype=bool), "negative")
    h = prior.Hyperparameters()
    posterior = prior.posterior_after(spec, h, (rows, features))
    plane = prior.PlanePrior(spec)
    scale = plane.scale(h)
    whole = scale[:, None] * plane.covariance(h) * scale
    gain = whole @ rows.T @ np.linalg.inv(rows @ whole @ rows.T + prior.disturbance(features, h))
    covariance = whole - gain @ rows @ whole
    np.testing.assert_allclose(posterior.factor @ posterior.factor.T, covariance, atol=1e-10)
    at, _ = prior.regressors(spec, new, np.ones(6, dtype=bool), "negative")
    expected = np.sqrt(np.einsum("ij,jk,ik->i", at, covariance, at) + h.discrepancy**2)
    np.testing.assert_allclose(posterior.deviation(new, "negative"), expected, rtol=1e-6)


def test_likelihood_is_that_of_the_outputs():
    spec = PlaneSpec(np.linspace(0, 1, 4), diagonal="reversible")
    rng = np.random.default_rng(1)
    u, y = rng.uniform(0, 1, 8), rng.normal(size=8)
    relative = rng.uniform(0.1, 3, 8)
    dense = (*prior.regressors(spec, u, np.ones(8, dtype=bool), "negative"), relative)
    h = prior.Hyperparameters(noise=0.02)
    plane = prior.PlanePrior(spec)
    whole = plane.scale(h)[:, None] * plane.covariance(h) * plane.scale(h)
    total = dense[0] @ whole @ dense[0].T + prior.disturbance(dense[1], h)
    total += h.noise**2 * np.diag(relative - 1)
    expected = -0.5 * (y @ np.linalg.solve(total, y) + np.linalg.slogdet(total)[1])
    found = prior.likelihood(plane, prior.Evidence(spec, y, *dense), h)[0]
    assert found == pytest.approx(expected, rel=1e-9)
    gram, slope = dense[0].T @ dense[0], dense[0].T @ y
    summed = prior.Evidence(spec, y, gram=gram, slope=slope)
    variance = h.noise**2 + h.discrepancy**2
    total = dense[0] @ whole @ dense[0].T + variance * np.eye(8)
    expected = -0.5 * (y @ np.linalg.solve(total, y) + np.linalg.slogdet(total)[1])
    assert prior.likelihood(plane, summed, h)[0] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("slope", [False, True])
@pytest.mark.parametrize("many", [False, True])
def test_slopes_of_the_likelihood_are_those_of_finite_differences(slope, many):
    spec = PlaneSpec(np.linspace(0, 1, 6), diagonal="reversible", slope=slope)
    rng = np.random.default_rng(3)
    u, y = rng.uniform(0, 1, 20), rng.normal(size=20)
    rows, features = prior.regressors(spec, u, np.ones(20, dtype=bool), "negative")
    apart = {"rows": rows, "features": features, "relative": rng.uniform(0.1, 3, 20)}
    summed = {"gram": rows.T @ rows, "slope": rows.T @ y}
    evidence = prior.Evidence(spec, y, **(summed if many else apart))
    plane = prior.PlanePrior(spec)
    logs = rng.normal(-1.5, 0.5, 8)

    def at(theta):
        return prior.likelihood(plane, evidence, prior.Hyperparameters(*np.exp(theta)))

    steps = 1e-5 * np.eye(8)
    wanted = [(at(logs + step)[0] - at(logs - step)[0]) / 2e-5 for step in steps]
    np.testing.assert_allclose(at(logs)[1], wanted, rtol=1e-5, atol=1e-6)


def test_covariances_are_positive_on_uneven_planes():
    rng = np.random.default_rng(2)
    for _ in range(20):
        spec = PlaneSpec(np.sort(rng.uniform(0, 1, 9)), slope=True)
        values = np.exp(rng.normal(size=7)) * [0.3, 0.3, 0.4, 0.15, 0.3, 0.006, 0.003]
        plane, h = prior.PlanePrior(spec), prior.Hyperparameters(*values)
        assert np.linalg.eigvalsh(plane.covariance(h)).min() > 0
        assert (plane.scale(h) > 0).all()


def test_weights_are_not_negative_and_the_model_is_monotone():
    found = identify(SEQUENCE, measured(SEQUENCE, 0.5), levels=LEVELS, prior="gaussian")
    assert (found.model.weights >= 0).all()
    assert found.kkt < 1e-8
    found.model.invert([0.0])


def test_twelve_holds_predict_better_than_without_the_prior():
    y = measured(SEQUENCE, 0.1)
    unseen = np.append(-1.2, np.random.default_rng(5).uniform(-1.2, 1.2, 40))
    truth = measured(unseen)
    errors = {}
    for name in ("gaussian", "none"):
        options = {"smoothness": 0.0} if name == "none" else {"noise": 0.1}
        fit = identify(SEQUENCE, y, levels=LEVELS, prior=name, diagonal="reversible", **options)
        errors[name] = np.sqrt(np.mean((fit.model.simulate(unseen) - truth) ** 2)) / 19
    assert errors["gaussian"] < 0.01
    assert errors["gaussian"] < 0.4 * errors["none"]


def test_bands_cover_what_was_not_seen():
    covered = []
    for specimen in range(4):
        y = measured(SEQUENCE, 0.1, specimen, specimen)
        fit = identify(
            SEQUENCE, y, levels=LEVELS, prior="gaussian", noise=0.1, diagonal="reversible"
        )
        unseen = np.append(-1.2, np.random.default_rng(specimen).uniform(-1.2, 1.2, 40))
        covered.append(fit.predict(unseen, bands=0.9).covers(measured(unseen, 0, specimen)))
    assert 0.8 <= np.mean(covered) <= 1.0


def test_more_measurements_narrow_the_bands():
    widths = []
    for count in (4, 8, 12):
        u = SEQUENCE[:count]
        fit = identify(u, measured(u, 0.1), levels=LEVELS, prior="gaussian", noise=0.1)
        widths.append(np.mean(fit.posterior.deviation(SEQUENCE, "negative")))
    assert widths[0] > widths[1] > widths[2]


def test_three_holds_give_a_model_with_wide_bands():
    u = SEQUENCE[:3]
    fit = identify(u, measured(u), levels=LEVELS, diagonal="reversible")
    unseen = np.append(-1.2, np.random.default_rng(3).uniform(-1.2, 1.2, 40))
    shown = fit.predict(unseen, bands=0.9)
    assert np.mean(shown.sd) > 0.02 * np.ptp(measured(u))
    assert shown.covers(measured(unseen)) >= 0.8


@pytest.mark.parametrize("place", [5, 9, 30])
def test_an_outlier_is_left_out_and_named(place):
    stairs = excitation.decaying_staircase(np.linspace(-1.2, 1.2, 11))
    y = measured(stairs, 0.05)
    y[place] += 3.0
    fit = identify(stairs, y, levels=LEVELS, prior="gaussian", diagonal="reversible")
    assert fit.suspects == (place,)
    assert f"sample {place} " in fit.advice[0]
    assert "repeat it" in fit.advice[0]
    assert not fit.fitted[place]


def test_no_sound_reading_is_left_out():
    for specimen in range(3):
        stairs = excitation.decaying_staircase(np.linspace(-1.2, 1.2, 11))
        y = measured(stairs, 0.1, specimen, specimen)
        fit = identify(stairs, y, levels=LEVELS, prior="gaussian", diagonal="reversible")
        assert fit.suspects == ()


def test_many_samples_are_summed_and_agree_with_few():
    """What is kept of few and of many samples gives the same where the discrepancy is small."""
    rng = np.random.default_rng(0)
    plane = np.tril(np.exp(-np.subtract.outer(np.arange(8), np.arange(8)) / 3.0))
    model = Preisach(np.linspace(0, 1, 9), plane)
    u = rng.uniform(0, 1, 900)
    y = model.simulate(u) + rng.normal(0, 0.02, u.size)
    many = identify(u, y, levels=8, prior="gaussian")
    few = identify(u[:390], y[:390], levels=8, prior="gaussian")
    truth = np.ptp(model.range)
    check = rng.uniform(0, 1, 200)
    for fit in (many, few):
        error = fit.model.simulate(check) - model.simulate(check)
        assert np.sqrt(np.mean(error**2)) < 0.004 * truth
    assert many.posterior is not None


def test_auto_takes_the_prior_for_few_samples_only():
    rng = np.random.default_rng(0)
    model = Preisach(np.linspace(0, 1, 6), np.tril(np.ones((5, 5))))
    u = rng.uniform(0, 1, 400)
    y = model.simulate(u) + rng.normal(0, 0.05, u.size)
    assert identify(u, y, levels=5).posterior is None
    assert identify(u[:30], y[:30], levels=5).posterior is not None
    assert identify(u[:30], y[:30], levels=5, smoothness=0.0).posterior is None
    assert identify(u[:30], y[:30], levels=5, prior="none").posterior is None


def test_data_that_determine_the_plane_are_reproduced():
    rng = np.random.default_rng(1)
    levels = np.linspace(0, 1, 11)
    model = Preisach(levels, np.tril(rng.uniform(size=(10, 10))))
    stairs = excitation.decaying_staircase(levels)
    found = identify(stairs, model.simulate(stairs), levels=levels)
    np.testing.assert_allclose(found.model.weights, model.weights, atol=1e-10)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"prior": "flat"}, "prior is 'flat'; give one of"),
        ({"prior": "gaussian", "smoothness": 0.1}, "give one of them"),
        ({"noise": -1.0}, "noise is -1.0; give a standard deviation >= 0"),
        ({"noise": np.nan}, "noise is nan"),
    ],
)
def test_refuses(options, says):
    with pytest.raises(ParameterError, match=says):
        identify(SEQUENCE, measured(SEQUENCE), **options)


@pytest.mark.parametrize("noise", [1.0, 3.0])
def test_bands_hold_for_a_sensor_far_worse_than_usual(noise):
    levels = np.linspace(-1.2, 1.2, 21)
    u = design(levels, 12)
    plant = Preisach(levels, np.tril(np.ones((20, 20))) / 21)
    covered = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        y = plant.simulate(u) + noise * rng.standard_normal(u.size)
        fit = identify(u, y, levels=levels, diagonal="reversible", prior="gaussian")
        grid = np.r_[-1.2, rng.uniform(-1.2, 1.2, 20)]
        covered.append(fit.predict(grid, bands=0.9).covers(plant.simulate(grid)))
    assert np.mean(covered) > 0.75


def test_hyperparameters_of_few_samples_on_a_fine_plane_are_searched_on_a_coarse_one(monkeypatch):
    searched, search = [], prior.search

    def seen(evidence, *args):
        searched.append(evidence.spec.bands)
        return search(evidence, *args)

    monkeypatch.setattr(prior, "search", seen)
    u = np.linspace(0, 1, 7) ** 2 * np.array([1, 0, 1, 0, 1, 0, 1])
    fit = identify(u, u, levels=48, prior="gaussian")
    assert set(searched) == {24}
    assert fit.posterior.spec.bands == 48
