import numpy as np
import pytest
from scipy.linalg import lapack

from minorloop.identification import active_set
from minorloop.identification.updated_factor import UpdatedFactor
from plane_problems import a_problem

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
    monkeypatch.setattr(active_set, "LEAST", 1)
    other = problem.fit(strength)
    assert other.kkt <= 1e-11
    np.testing.assert_allclose(other.x, usual.x, atol=1e-8 * np.abs(usual.x).max())
