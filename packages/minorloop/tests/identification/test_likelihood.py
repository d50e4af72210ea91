import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop.identification import likelihood
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec
from minorloop.identification.likelihood import FewOutputs, ManyOutputs, regressors
from minorloop.identification.prior import Hyperparameters, PlanePrior
from minorloop.operators.memory import Memory


@given(st.integers(0, 10_000), st.sampled_from(["uniform", "reversible"]))
def test_rows_are_those_of_the_tree(seed, diagonal):
    rng = np.random.default_rng(seed)
    relay = ["bipolar", "unipolar"][seed % 2]
    spec = PlaneSpec(np.sort(rng.uniform(-1, 1, 7)), relay, diagonal, slope=bool(seed % 3))
    u = rng.choice([rng.uniform(-1.3, 1.3, 30), rng.choice(spec.levels, 30)])
    seen = rng.random(30) < 0.6
    start = ["negative", "positive", Memory([spec.levels[0], spec.levels[4], spec.levels[2]])]
    begin = start[seed % 3]
    rows, _ = regressors(spec, u, seen, begin)
    np.testing.assert_allclose(rows, DesignMatrix(spec, u, seen, begin).dense(), atol=1e-12)


def evidence_of(kind, spec, u, y):
    """Evidence, regressors, and the covariance of the disturbance at some hyperparameters."""
    every = np.ones(u.size, dtype=bool)
    dense = regressors(spec, u, every, "negative")
    if kind == "few":
        evidence = FewOutputs.of(spec, y, dense)
        return evidence, dense[0], lambda h: likelihood.disturbance(dense[1], h)
    evidence = ManyOutputs.of(DesignMatrix(spec, u, every, "negative"), y, np.ones(u.size))
    return evidence, dense[0], lambda h: (h.noise**2 + h.discrepancy**2) * np.eye(u.size)


@pytest.mark.parametrize("kind", ["few", "many"])
@pytest.mark.parametrize("samples", [5, 30])
def test_likelihood_is_that_of_the_outputs(kind, samples):
    """Both with fewer and with more samples than unknowns."""
    spec = PlaneSpec(np.linspace(0, 1, 4), diagonal="reversible")
    rng = np.random.default_rng(1)
    u, y = rng.uniform(0, 1, samples), rng.normal(size=samples)
    evidence, rows, disturbance = evidence_of(kind, spec, u, y)
    h = Hyperparameters(noise=0.02)
    plane = PlanePrior(spec)
    whole = plane.scale(h)[:, None] * plane.covariance(h) * plane.scale(h)
    total = rows @ whole @ rows.T + disturbance(h)
    expected = -0.5 * (y @ np.linalg.solve(total, y) + np.linalg.slogdet(total)[1])
    assert likelihood.likelihood(plane, evidence, h)[0] == pytest.approx(expected, rel=1e-9)
    if kind == "few":
        assert likelihood.likelihood_of_few(plane, evidence, h) == pytest.approx(expected, rel=1e-9)


def test_likelihood_with_hardly_any_noise():
    """Squares of what is known have lost the unit matrix that the prior adds to them."""
    spec, rng = PlaneSpec(np.linspace(0, 1, 11)), np.random.default_rng(1)
    u, y = rng.uniform(0, 1, 8), 1e-9 * rng.normal(size=8)
    evidence, rows, _ = evidence_of("many", spec, u, y)
    h = Hyperparameters(noise=1e-9, discrepancy=1e-9)
    plane = PlanePrior(spec)
    root = np.linalg.cholesky(plane.covariance(h)) * plane.scale(h)[:, None]
    total = rows @ root @ root.T @ rows.T + 2e-18 * np.eye(8)
    expected = -0.5 * (y @ np.linalg.solve(total, y) + np.linalg.slogdet(total)[1])
    value, slopes = likelihood.likelihood(plane, evidence, h)
    assert value == pytest.approx(expected, rel=1e-6)
    assert np.isfinite(slopes).all()


@pytest.mark.parametrize("slope", [False, True])
@pytest.mark.parametrize(("kind", "samples"), [("few", 12), ("few", 30), ("many", 20)])
def test_slopes_of_the_likelihood_are_those_of_finite_differences(slope, kind, samples):
    spec = PlaneSpec(np.linspace(0, 1, 6), diagonal="reversible", slope=slope)
    rng = np.random.default_rng(3)
    u, y = rng.uniform(0, 1, samples), rng.normal(size=samples)
    evidence, _, _ = evidence_of(kind, spec, u, y)
    plane = PlanePrior(spec)
    logs = rng.normal(-1.5, 0.5, 8)

    def at(theta):
        return likelihood.likelihood(plane, evidence, Hyperparameters(*np.exp(theta)))

    steps = 1e-5 * np.eye(8)
    wanted = [(at(logs + step)[0] - at(logs - step)[0]) / 2e-5 for step in steps]
    np.testing.assert_allclose(at(logs)[1], wanted, rtol=1e-5, atol=1e-6)


def test_the_search_finds_white_noise_where_a_correlated_discrepancy_is_a_local_optimum():
    """A search from the usual values alone ends there, with 19 % of discrepancy and no noise."""
    rng = np.random.default_rng(1000)
    spec = PlaneSpec(np.linspace(-1, 1, 11))
    u = rng.uniform(-1, 1, 60)
    dense = regressors(spec, u, np.ones(60, dtype=bool), "negative")
    y = np.tanh(2 * u) / 2 + 0.1 * rng.normal(size=60)
    found = likelihood.search(FewOutputs.of(spec, y - y.mean(), dense), None)
    assert found.noise == pytest.approx(0.1, rel=0.3)
    assert found.discrepancy < 0.03
