import numpy as np
import pytest
from scipy.optimize import lsq_linear

from long_branches import a_record_with_long_branches
from minorloop.identification import prior_system
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec
from minorloop.identification.field_prior import FieldPrior
from minorloop.identification.likelihood import Evidence, likelihood
from minorloop.identification.prior import Hyperparameters, PlanePrior


@pytest.fixture
def sparse(monkeypatch):
    """Use the sparse system for planes of any size."""
    monkeypatch.setattr(prior_system, "_LEAST_SPARSE", 0)
    monkeypatch.setattr(prior_system, "_FILL", np.inf)


def test_samples_determine_as_many_unknowns_as_the_trace_says(sparse):
    model, u, y = a_record_with_long_branches()
    matrix = DesignMatrix(PlaneSpec(model.levels), u, np.ones(u.size, dtype=bool), "negative")
    weight, h = np.ones(u.size), Hyperparameters(noise=0.01)
    system = prior_system.systems(matrix, y, weight, False)(h)
    variance = h.noise**2 + h.discrepancy**2
    precision = FieldPrior(PlanePrior(matrix.spec)).precision(h, variance)
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
        found.append(prior_system.systems(matrix, y, np.ones(u.size), False)(h).likelihood)
        precision = FieldPrior(PlanePrior(matrix.spec)).precision(h, 1.0)
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
    evidence, plane = Evidence.of_many(matrix, y, np.ones(u.size)), PlanePrior(spec)
    for h in (Hyperparameters(), Hyperparameters(nugget=2.0, noise=0.1)):
        found = prior_system.dense_system(plane, evidence, h, False).likelihood
        assert found == pytest.approx(likelihood(plane, evidence, h)[0], rel=1e-10)
