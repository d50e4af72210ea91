from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from fixed_options import Plane, identify
from long_branches import a_record_with_long_branches
from minorloop.identification import Gaussian, likelihood, posterior
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec
from minorloop.identification.likelihood import ManyOutputs
from minorloop.identification.posterior import SparsePosterior
from minorloop.identification.prior import Hyperparameters, PlanePrior
from minorloop.identification.prior_fit import posterior_after


@pytest.fixture
def sparse(monkeypatch):
    """Use the sparse system for planes of any size."""
    monkeypatch.setattr(posterior, "_LEAST_SPARSE", 0)
    monkeypatch.setattr(posterior, "_FILL", np.inf)


def test_samples_determine_as_many_unknowns_as_the_trace_says(sparse):
    model, u, y = a_record_with_long_branches()
    matrix = DesignMatrix(PlaneSpec(model.levels), u, np.ones(u.size, dtype=bool), "negative")
    weight, h = np.ones(u.size), Hyperparameters(noise=0.01)
    system = posterior.system_of_many(matrix, y, weight, h, False)
    precision = PlanePrior(matrix.spec).precision(h, h.variance)
    prior = np.stack([precision.product(unit) for unit in np.eye(matrix.spec.unknowns)], axis=1)
    gram = matrix.dense().T @ matrix.dense()
    determined = np.trace(np.linalg.solve(gram + prior, gram))
    assert system.determined == pytest.approx(determined, rel=0.01)
    mean = np.linalg.solve(gram + prior, matrix.dense().T @ y)
    np.testing.assert_allclose(matrix.forward(system.mean), matrix.forward(mean), atol=1e-8)
    bounds = np.append(np.zeros(matrix.spec.cells), -np.inf)
    root = np.linalg.cholesky(gram + prior)
    target = np.linalg.solve(root, matrix.dense().T @ y)
    optimum = lsq_linear(root.T, target, (bounds, np.inf), method="bvls", tol=1e-14).x
    x, kkt = system.bounded()
    assert kkt < 1e-10
    np.testing.assert_allclose(matrix.forward(x), matrix.forward(optimum), atol=1e-8)


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


def test_the_dense_likelihood_is_that_of_the_search():
    model, u, y = a_record_with_long_branches(each=3)
    spec = PlaneSpec(model.levels, slope=True)
    matrix = DesignMatrix(spec, u, np.ones(u.size, dtype=bool), "negative")
    evidence, plane = ManyOutputs.of(matrix, y, np.ones(u.size)), PlanePrior(spec)
    for h in (Hyperparameters(), Hyperparameters(nugget=2.0, noise=0.1)):
        found = posterior.DenseSystem(evidence, plane, h).likelihood
        assert found == pytest.approx(likelihood.likelihood(plane, evidence, h)[0], rel=1e-10)


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


def test_the_sparse_system_gives_the_same_independent_part(sparse):
    rng, h = np.random.default_rng(0), Hyperparameters(nugget=2.0, discrepancy=0.01, noise=0.0)
    u = np.interp(np.arange(200) / 20, np.arange(11), rng.uniform(-1, 1, 11))
    spec = PlaneSpec(np.linspace(-1, 1, 11))
    matrix = DesignMatrix(spec, u, np.ones(u.size, dtype=bool), "negative")
    y = matrix.forward(rng.uniform(0, 1, matrix.spec.unknowns))
    y = (y - y.mean()) / np.ptp(y) + 0.01 * rng.normal(size=u.size)
    fast = posterior.system_of_many(matrix, y, np.ones(u.size), h, False)
    slow = posterior.DenseSystem(ManyOutputs.of(matrix, y, np.ones(u.size)), fast.plane, h)
    one, other = fast.independent_part(), slow.independent_part()
    assert isinstance(fast, posterior.SparseSystem)
    assert one.likelihood == pytest.approx(other.likelihood, rel=1e-5)
    np.testing.assert_allclose(one.squares, other.squares, rtol=1e-4)
    np.testing.assert_allclose(one.determined, other.determined, atol=1e-5)


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


def test_deviations_of_many_outputs_are_computed_in_parts(monkeypatch):
    spec, u = PlaneSpec(np.linspace(0, 1, 5)), np.random.default_rng(0).uniform(0, 1, 30)
    measured = u > 0.4
    found = posterior_after(
        spec, Hyperparameters(), likelihood.regressors(spec, u, ~measured, "negative")
    )
    whole = found.deviation(u, "negative", measured)
    monkeypatch.setattr(posterior, "_TOGETHER", 7)
    np.testing.assert_allclose(found.deviation(u, "negative", measured), whole, rtol=1e-12)


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
