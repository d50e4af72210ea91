import numpy as np
import pytest

from minorloop.identification import heavy_tails, prior_system
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec
from minorloop.identification.field_prior import FieldPrior
from minorloop.identification.likelihood import Evidence
from minorloop.identification.prior import Hyperparameters, PlanePrior

LEVELS = np.linspace(-1, 1, 11)


def evidence_of(u, y, levels=LEVELS):
    matrix = DesignMatrix(PlaneSpec(levels), u, np.ones(u.size, dtype=bool), "negative")
    return Evidence.of_many(matrix, y, np.ones(u.size)), matrix.dense()


def test_the_posterior_is_that_of_the_covariance_of_the_outputs():
    rng = np.random.default_rng(0)
    u, y = rng.uniform(-1, 1, 12), rng.normal(size=12)
    evidence, rows = evidence_of(u, y, np.linspace(-1, 1, 5))
    h, spec = Hyperparameters(), evidence.spec
    plane = PlanePrior(spec, independent=rng.uniform(0.1, 10, spec.cells))
    field = FieldPrior(plane)
    found = heavy_tails._posterior(evidence, field, h, plane.nugget_variances(h))
    precision, variances = field.precision(h, 1.0), plane.nugget_variances(h)
    factors = precision.factors.toarray()
    inner = precision.field - factors.T @ (precision.own[: spec.cells, None] * factors)
    prior = np.diag(1 / precision.own)
    prior[: spec.cells, : spec.cells] += factors @ np.linalg.inv(inner) @ factors.T
    outputs = rows @ prior @ rows.T + (h.noise**2 + h.discrepancy**2) * np.eye(12)
    seen = rows[:, : spec.cells] * variances
    mean = seen.T @ np.linalg.solve(outputs, y)
    removed = np.sum(seen * np.linalg.solve(outputs, seen), axis=0)
    likelihood = -0.5 * (y @ np.linalg.solve(outputs, y) + np.linalg.slogdet(outputs)[1])
    assert found.likelihood == pytest.approx(likelihood, rel=1e-6)
    np.testing.assert_allclose(found.determined, removed / variances, rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(found.squares, mean**2 + variances - removed, rtol=1e-5)


def test_the_sparse_system_gives_the_same_posterior(monkeypatch):
    monkeypatch.setattr(prior_system, "_LEAST_SPARSE", 0)
    monkeypatch.setattr(prior_system, "_FILL", np.inf)
    rng, h = np.random.default_rng(0), Hyperparameters(nugget=2.0, discrepancy=0.01, noise=0.0)
    u = np.interp(np.arange(200) / 20, np.arange(11), rng.uniform(-1, 1, 11))
    matrix = DesignMatrix(PlaneSpec(LEVELS), u, np.ones(u.size, dtype=bool), "negative")
    y = matrix.forward(rng.uniform(0, 1, matrix.spec.unknowns))
    y = (y - y.mean()) / np.ptp(y) + 0.01 * rng.normal(size=u.size)
    systems = prior_system.systems(matrix, y, np.ones(u.size), False)
    variances = systems.plane.nugget_variances(h)
    one = heavy_tails._posterior_of(systems.evidence, systems.field, h, variances)
    evidence = Evidence.of_many(matrix, y, np.ones(u.size))
    other = heavy_tails._posterior_of(evidence, systems.field, h, variances)
    assert isinstance(systems.evidence, prior_system.SparseEvidence)
    assert one.likelihood == pytest.approx(other.likelihood, rel=1e-5)
    np.testing.assert_allclose(one.squares, other.squares, rtol=1e-4)
    np.testing.assert_allclose(one.determined, other.determined, atol=1e-5)
