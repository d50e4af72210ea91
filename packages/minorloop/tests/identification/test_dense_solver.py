import numpy as np
import pytest
from scipy.linalg import lapack
from scipy.optimize import nnls

from benchmarks import optima
from fixed_options import Plane, identify
from minorloop.identification import Smooth, active_set, dense_solver, least_squares
from minorloop.identification.dense_solver import GramRows, Quadratic, UpdatedFactor
from plane_problems import a_problem, objective


def test_the_solution_is_that_of_scipy():
    rng = np.random.default_rng(0)
    rows, y = rng.normal(size=(40, 12)), rng.normal(size=40)
    rows /= np.linalg.norm(rows, axis=0)
    gram = rows.T @ rows
    found = dense_solver.solve(
        Quadratic(GramRows.of(gram), rows.T @ y), np.ones(12, dtype=bool), float(np.linalg.norm(y))
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
    monkeypatch.setattr(dense_solver, "_FACTORISED", 10)
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
    monkeypatch.setattr(dense_solver, "_SHARE", 1.0)
    monkeypatch.setattr(least_squares._System, "_coarse_guess", lambda self, strength: usual.x / 2)
    other = problem.fit(strength)
    assert objective(problem, other.x) == pytest.approx(objective(problem, usual.x), rel=1e-9)
    assert other.kkt <= 1e-10


def test_unknowns_that_become_free_a_few_at_a_time_reach_the_same_optimum(monkeypatch):
    problem = a_problem(14, 500)
    usual = problem.fit(0.0)
    monkeypatch.setattr(active_set, "_FEW", 2)
    other = problem.fit(0.0)
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
    monkeypatch.setattr(dense_solver, "_FACTORISED", 10)
    for seed in (82, 97, 111, 123, 204, 274):
        problem, smoothness = optima.a_problem(seed)
        fit = problem.fit(smoothness)
        close = optima.excess(problem, smoothness, fit) <= optima.CLOSE
        assert close or not fit.converged, seed


def test_a_fit_that_did_not_converge_says_so(monkeypatch):
    monkeypatch.setattr(dense_solver, "refine", lambda rows, z, scaling: (z, False))
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


UNKNOWNS = 40


def a_factor(free):
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(60, UNKNOWNS))
    matrix = rows.T @ rows
    picked = matrix[np.ix_(free, free)]
    factor, _ = lapack.dpotrf(picked, lower=0)
    return matrix, UpdatedFactor(free, factor)


def test_unknowns_that_join_and_leave_are_solved_for_as_by_another_factorisation():
    free = np.arange(UNKNOWNS) % 3 > 0
    matrix, factor = a_factor(free)
    right = np.random.default_rng(1).normal(size=UNKNOWNS)
    for changed in ([], [0, 1, 3], [1, 2, 3], [4]):  # some change back
        now = free.copy()
        now[changed] ^= True
        expected = np.zeros(UNKNOWNS)
        expected[now] = np.linalg.solve(matrix[np.ix_(now, now)], right[now])
        found = factor.solve(
            np.where(now, right, 0.0), now, lambda rows, which: matrix[np.ix_(rows, which)]
        )
        np.testing.assert_allclose(found, expected, atol=1e-12)


def test_too_many_changes_are_left_to_another_factorisation():
    free = np.arange(UNKNOWNS) % 3 > 0
    matrix, factor = a_factor(free)
    found = factor.solve(np.zeros(UNKNOWNS), ~free, lambda rows, which: matrix[np.ix_(rows, which)])
    assert found is None


@pytest.mark.parametrize("strength", [0.0, 1e-6])
def test_fits_that_update_the_factor_meet_the_same_conditions(strength, monkeypatch):
    problem = a_problem(14, 500)
    usual = problem.fit(strength)
    monkeypatch.setattr(dense_solver, "_LEAST_UPDATED", 1)
    other = problem.fit(strength)
    assert other.kkt <= 1e-11
    np.testing.assert_allclose(other.x, usual.x, atol=1e-8 * np.abs(usual.x).max())


def test_refinement_that_runs_out_of_rounds_is_not_settled(monkeypatch):
    monkeypatch.setattr(dense_solver, "_ROUNDS", 1)
    monkeypatch.setattr(dense_solver, "_STEPS", 2)
    values = np.geomspace(1, 1e-3, 20)
    rows = dense_solver.Rows(lambda z: values * z, lambda r: values * r, np.ones(20))
    scaling = dense_solver.Preconditioner(np.arange(20), np.ones(20))
    z, settled = dense_solver.refine(rows, np.zeros(20), scaling)
    assert not settled
    monkeypatch.undo()
    z, settled = dense_solver.refine(rows, z, scaling)
    assert settled
    np.testing.assert_allclose(values * z, 1.0, atol=1e-12)
