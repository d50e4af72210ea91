from dataclasses import replace

import numpy as np
import pytest

from fixed_options import Plane, identify
from long_branches import a_record_with_long_branches
from minorloop.identification import Gaussian, likelihood, posterior, prior_system
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec
from minorloop.identification.posterior import SparsePosterior
from minorloop.identification.prior import Hyperparameters, PlanePrior
from minorloop.identification.prior_fit import posterior_after


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


def test_a_sparse_posterior_has_the_factor_of_its_variances(monkeypatch):
    for name, value in (("_LEAST_SPARSE", 0), ("_FILL", np.inf)):
        monkeypatch.setattr(prior_system, name, value)
    model, u, y = a_record_with_long_branches(each=40)
    found = identify(u, y, Plane(model.levels, slope=True), prior=Gaussian()).posterior
    assert isinstance(found, SparsePosterior)
    new, every = np.random.default_rng(0).uniform(-1, 1, 20), np.ones(20, dtype=bool)
    rows = DesignMatrix(found.spec, new, every, "negative").dense()
    np.testing.assert_allclose(
        found.row_deviation(rows), found.deviation(new, "negative"), rtol=1e-6
    )
    wide = replace(found.hyperparameters, discrepancy=2 * found.hyperparameters.discrepancy)
    wider = replace(found, hyperparameters=wide)
    np.testing.assert_allclose(
        wider.variances(new, every, "negative"), found.variances(new, every, "negative")
    )
    assert found.deviation(new, "negative", every & (new > 0)) == pytest.approx(
        found.deviation(new, "negative")[new > 0]
    )


@pytest.mark.parametrize("sparse", [False, True])
def test_a_coarse_plane_has_the_variances_of_what_it_can_describe(sparse, monkeypatch):
    """On its levels regressors of both planes are the same."""
    if sparse:
        for name, value in (("_LEAST_SPARSE", 0), ("_FILL", np.inf)):
            monkeypatch.setattr(prior_system, name, value)
    model, u, y = a_record_with_long_branches(each=40)
    found = identify(u, y, Plane(model.levels, slope=True), prior=Gaussian()).posterior
    apart = np.linspace(0, 0.1, found.spec.unknowns)
    found = replace(found, apart=apart)
    assert isinstance(found, SparsePosterior) == sparse
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
