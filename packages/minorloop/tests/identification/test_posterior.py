from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from fixed_options import Options, Plane, identify
from long_branches import a_record_with_long_branches
from minorloop import Preisach, Record
from minorloop.identification import Gaussian, likelihood, posterior
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec
from minorloop.identification.likelihood import ManyOutputs
from minorloop.identification.posterior import SparsePosterior
from minorloop.identification.prior import Hyperparameters, PlanePrior
from minorloop.identification.prior_fit import posterior_after
from minorloop.operators.densities import GaussianDensity


@pytest.fixture
def sparse(monkeypatch):
    """Use the sparse system for planes of any size."""
    monkeypatch.setattr(posterior, "_LEAST_SPARSE", 0)
    monkeypatch.setattr(posterior, "_FILL", np.inf)


def test_the_sparse_likelihood_is_that_of_the_outputs(sparse):
    model, u, y = a_record_with_long_branches()
    matrix = DesignMatrix(PlaneSpec(model.levels), u, np.ones(u.size, dtype=bool), "negative")
    found, wanted = [], []
    for nugget in (0.01, 3.0):
        h = Hyperparameters(nugget=nugget, noise=0.05)
        found.append(posterior.system_of_many(matrix, y, np.ones(u.size), h, False).likelihood)
        precision = PlanePrior(matrix.spec).precision(h, 1.0)
        prior = np.stack([precision.product(unit) for unit in np.eye(matrix.spec.unknowns)])
        rows = matrix.dense()
        total = rows @ np.linalg.solve(prior, rows.T)
        total += (h.noise**2 + h.discrepancy**2) * np.eye(u.size)
        wanted.append(-0.5 * (y @ np.linalg.solve(total, y) + np.linalg.slogdet(total)[1]))
    assert np.diff(found) == pytest.approx(np.diff(wanted), rel=1e-4)


@pytest.mark.parametrize("least", [0, np.inf])
def test_the_prior_with_a_mean_has_the_optimum_of_its_cost(sparse, least, monkeypatch):
    monkeypatch.setattr(posterior, "_LEAST_SPARSE", least)
    model, u, y = a_record_with_long_branches()
    spec, h = PlaneSpec(model.levels), Hyperparameters(noise=0.05)
    matrix = DesignMatrix(spec, u, np.ones(u.size, dtype=bool), "negative")
    plane, variance = PlanePrior(spec), h.variance
    mean = np.random.default_rng(1000).uniform(-0.2, 1.0, spec.unknowns)
    left, rows = y - matrix.forward(mean), matrix.dense()
    system = posterior.system_of_many(matrix, left, np.ones(u.size), h, False, mean)
    if least == 0:
        precision = plane.precision(h, variance)
        prior = np.stack([precision.product(unit) for unit in np.eye(spec.unknowns)]) / variance
    else:
        scale = plane.scale(h)
        prior = np.linalg.inv(scale[:, None] * plane.covariance(h) * scale)
    root = np.linalg.cholesky(rows.T @ rows / variance + prior)
    target = np.linalg.solve(root, rows.T @ y / variance + prior @ mean)
    bounds = np.append(np.zeros(spec.cells), -np.inf)
    optimum = lsq_linear(root.T, target, (bounds, np.inf), method="bvls", tol=1e-14).x
    deviation, kkt = system.bounded()
    assert kkt < 1e-10
    assert (deviation + mean)[: spec.cells].min() > -1e-12
    np.testing.assert_allclose(matrix.forward(deviation + mean), rows @ optimum, atol=1e-7)


def test_the_independent_part_is_that_of_the_covariance_of_the_outputs():
    rng = np.random.default_rng(0)
    u, y = rng.uniform(-1, 1, 12), rng.normal(size=12)
    h, spec = Hyperparameters(), PlaneSpec(np.linspace(-1, 1, 5))
    matrix = DesignMatrix(spec, u, np.ones(u.size, dtype=bool), "negative")
    evidence, rows = ManyOutputs.of(matrix, y, np.ones(u.size)), matrix.dense()
    plane = PlanePrior(spec).varied(independent=rng.uniform(0.1, 10, spec.cells))
    found = posterior.DenseSystem(evidence, plane, h).independent_part()
    precision, variances = plane.precision(h, 1.0), plane.nugget_variances(h)
    factors = precision.factors.toarray()
    inner = precision.field - factors.T @ (precision.own[: spec.cells, None] * factors)
    prior = np.diag(1 / precision.own)
    prior[: spec.cells, : spec.cells] += factors @ np.linalg.inv(inner) @ factors.T
    outputs = rows @ prior @ rows.T + h.variance * np.eye(12)
    seen = rows[:, : spec.cells] * variances
    mean = seen.T @ np.linalg.solve(outputs, y)
    removed = np.sum(seen * np.linalg.solve(outputs, seen), axis=0)
    likelihood = -0.5 * (y @ np.linalg.solve(outputs, y) + np.linalg.slogdet(outputs)[1])
    assert found.likelihood == pytest.approx(likelihood, rel=1e-6)
    np.testing.assert_allclose(found.determined, removed / variances, rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(found.squares, mean**2 + variances - removed, rtol=1e-5)


def test_the_posterior_is_that_of_a_gaussian_process():
    """Against the textbook formula, on dense matrices: Rasmussen and Williams, eq. 2.26."""
    spec = PlaneSpec(np.linspace(0, 1, 5), diagonal="reversible")
    rng = np.random.default_rng(0)
    u, new = rng.uniform(0, 1, 9), rng.uniform(0, 1, 6)
    rows, features = likelihood.regressors(spec, u, np.ones(9, dtype=bool), "negative")
    h = Hyperparameters()
    found = posterior_after(spec, h, (rows, features))
    plane = PlanePrior(spec)
    scale = plane.scale(h)
    whole = scale[:, None] * plane.covariance(h) * scale
    gain = (
        whole @ rows.T @ np.linalg.inv(rows @ whole @ rows.T + likelihood.disturbance(features, h))
    )
    covariance = whole - gain @ rows @ whole
    np.testing.assert_allclose(found.factor @ found.factor.T, covariance, atol=1e-10)
    assert found.determined == pytest.approx(np.trace(rows @ gain))
    at, _ = likelihood.regressors(spec, new, np.ones(6, dtype=bool), "negative")
    expected = np.sqrt(np.einsum("ij,jk,ik->i", at, covariance, at) + h.discrepancy**2)
    np.testing.assert_allclose(found.deviation(new, "negative"), expected, rtol=1e-6)


def test_a_sparse_posterior_has_the_factor_of_its_variances(sparse):
    model, u, y = a_record_with_long_branches(each=40)
    found = identify(u, y, Plane(model.levels, slope=True), prior=Gaussian()).posterior
    assert isinstance(found, SparsePosterior)
    new, every = np.random.default_rng(0).uniform(-1, 1, 20), np.ones(20, dtype=bool)
    rows = DesignMatrix(found.spec, new, every, "negative").dense()
    known = ((rows @ found.factor) ** 2).sum(axis=1)
    np.testing.assert_allclose(known, found.variances(new, every, "negative"), rtol=1e-6)
    wide = replace(found.hyperparameters, discrepancy=2 * found.hyperparameters.discrepancy)
    wider = replace(found, hyperparameters=wide)
    np.testing.assert_allclose(
        wider.variances(new, every, "negative"), found.variances(new, every, "negative")
    )
    assert found.deviation(new, "negative", every & (new > 0)) == pytest.approx(
        found.deviation(new, "negative")[new > 0]
    )


@pytest.mark.parametrize("least", [0, np.inf])
def test_a_coarse_plane_has_the_variances_of_what_it_can_describe(sparse, least, monkeypatch):
    """On its levels regressors of both planes are the same."""
    monkeypatch.setattr(posterior, "_LEAST_SPARSE", least)
    model, u, y = a_record_with_long_branches(each=40)
    found = identify(u, y, Plane(model.levels, slope=True), prior=Gaussian()).posterior
    apart = np.linspace(0, 0.1, found.spec.unknowns)
    found = replace(found, apart=apart)
    assert isinstance(found, SparsePosterior) == (least == 0)
    coarse = found.coarse(6)
    assert coarse.spec.bands == 6
    np.testing.assert_array_equal(coarse.dense, np.tril(coarse.dense))
    new = np.random.default_rng(0).choice(coarse.spec.levels, 40)
    plain = replace(found, hyperparameters=replace(found.hyperparameters, discrepancy=0.0))
    share = plain.coarse(6).deviation(new, "negative") / plain.deviation(new, "negative")
    np.testing.assert_allclose(share, share[0], rtol=1e-5)
    every = np.random.default_rng(1).uniform(-1, 1, 4000)
    means = [np.mean(one.deviation(every, "negative") ** 2) for one in (plain, plain.coarse(6))]
    assert means[1] == pytest.approx(means[0], rel=0.1)


LEVELS = np.linspace(-1, 1, 25)
MAGNET = Preisach.from_density(LEVELS, GaussianDensity(0.3, 0.25, 0.2))


def curves(ends):
    """Inputs of reversal curves, each from positive saturation."""
    return np.concatenate([np.r_[1.0, np.linspace(end, 1, 30)] for end in ends])


def fitted(levels, **options):
    u = curves(np.linspace(0.9, -0.1, 12))
    y = MAGNET.simulate(u, "positive")
    y += 1e-3 * np.ptp(y) * np.random.default_rng(1000).normal(size=u.size)
    return Options.of({"levels": levels, "start": "positive", **options}).identify(Record(u, y))


@pytest.mark.parametrize("levels", [LEVELS[::2], 12], ids=["over all inputs", "over the record"])
def test_curves_deeper_than_those_fitted_lie_in_their_bands(levels):
    found, deep = fitted(levels), curves([-0.4, -0.6])
    assert found.predict(deep, bands=0.9).covers(MAGNET.simulate(deep, "positive")) >= 0.85


@pytest.mark.parametrize("count", [31, 372], ids=["few samples", "many samples"])
def test_bands_within_the_record_stay_narrow(count):
    found, seen = fitted(LEVELS[::2]), curves([0.5, 0.2])
    u, y = found.u[-count:], found.y[-count:]
    part = identify(Record(u, y, start="positive"), Plane(LEVELS[::2]), prior=Gaussian())
    beyond = part.predict(curves([-0.5]), bands=0.9).half_width.max()
    assert part.predict(seen, bands=0.9).half_width.max() < 0.3 * beyond


def test_what_an_input_beyond_the_levels_switched_is_switched_back_on_the_way_to_the_other_end():
    found = fitted(12)
    low, high = found.model.levels[[0, -1]]
    u = np.array([high, low, high, low - 0.3, 0.4, 0.8, high, 0.4])
    wide = found.predict(u, bands=0.9).half_width
    assert (np.diff(wide[3:7]) < 0).all()
    assert wide[4] > 5 * wide[7]
    assert wide[6] == pytest.approx(wide[2])
