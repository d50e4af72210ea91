import numpy as np
import pytest
from scipy.optimize import nnls

from benchmarks import optima
from fixed_options import Plane, identify
from minorloop.identification import Smooth, active_set, gram_rows, least_squares
from plane_problems import a_problem, objective


def test_the_solution_is_that_of_scipy():
    rng = np.random.default_rng(0)
    rows, y = rng.normal(size=(40, 12)), rng.normal(size=40)
    rows /= np.linalg.norm(rows, axis=0)
    gram = rows.T @ rows
    found = active_set.solve(
        np.tril(gram),
        lambda z: rows.T @ (rows @ z - y),
        lambda z: gram @ z,
        np.ones(12, dtype=bool),
        float(np.linalg.norm(y)),
    )
    np.testing.assert_allclose(found.z, nnls(rows, y)[0], atol=1e-10)
    assert found.kkt <= active_set.TOLERANCE


def test_the_optimality_is_the_largest_violation():
    bounded = np.array([True, True, True, False])
    z, gradient = np.array([0.0, 0.0, -0.5, 1.0]), np.array([-0.2, 3.0, 0.0, 0.1])
    assert active_set.optimality(z, gradient, bounded, 2.0) == 0.25
    assert active_set.optimality(np.maximum(z, 0), gradient, bounded, 2.0) == 0.1


@pytest.mark.parametrize("strength", [0.0, 1e-4])
def test_conjugate_gradients_reach_the_same_objective(strength, monkeypatch):
    problem = a_problem(14, 500)
    usual = problem.fit(strength)
    monkeypatch.setattr(active_set, "_FACTORISED", 10)
    monkeypatch.setattr(least_squares, "_LARGE", 20)
    other = problem.fit(strength)
    assert objective(problem, other.x) == pytest.approx(objective(problem, usual.x), rel=1e-7)
    assert other.kkt < 1e-6


@pytest.mark.parametrize("strength", [0.0, 1e-4])
def test_rows_of_the_gram_matrix_are_found_where_they_are_needed(strength, monkeypatch):
    problem = a_problem(14, 500)
    usual = problem.fit(strength)
    monkeypatch.setattr(least_squares, "_LARGE", 20)
    monkeypatch.setattr(type(problem.matrix), "gram", None)
    monkeypatch.setattr(gram_rows, "_SHARE", 1.0)
    monkeypatch.setattr(least_squares._System, "_coarse_guess", lambda self, strength: usual.x / 2)
    other = problem.fit(strength)
    assert objective(problem, other.x) == pytest.approx(objective(problem, usual.x), rel=1e-9)
    assert other.kkt <= 1e-10


def test_the_whole_gram_matrix_is_computed_where_most_of_it_is_needed(monkeypatch):
    problem = a_problem(14, 500)
    usual = problem.fit(1e-4)
    monkeypatch.setattr(least_squares, "_LARGE", 20)
    monkeypatch.setattr(type(problem.matrix), "gram_rows", lambda *_: pytest.fail("single rows"))
    other = problem.fit(1e-4)
    assert objective(problem, other.x) == pytest.approx(objective(problem, usual.x), rel=1e-9)


def test_large_signed_fits_reach_it_or_say_that_they_do_not(monkeypatch):
    monkeypatch.setattr(active_set, "_FACTORISED", 10)
    for seed in (82, 97, 111, 123, 204, 274):
        problem, smoothness = optima.a_problem(seed)
        fit = problem.fit(smoothness)
        close = optima.excess(problem, smoothness, fit) <= optima.CLOSE
        assert close or not fit.converged, seed


def test_a_fit_that_did_not_converge_says_so(monkeypatch):
    monkeypatch.setattr(active_set, "refine", lambda rows, z, scaling: (z, False))
    problem, _ = optima.a_problem(70)
    found = identify(
        problem.matrix.u,
        problem.y,
        Plane(problem.matrix.spec.levels, signed=True),
        prior=Smooth(0.0),
    )
    assert not found.converged
    assert any("did not converge" in text for text in found.advice)
    assert "not converged" in str(found)
