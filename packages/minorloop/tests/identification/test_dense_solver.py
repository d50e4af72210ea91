import pytest

from benchmarks import optima
from fixed_options import Plane, identify
from minorloop.identification import Smooth, active_set, dense_solver, least_squares
from minorloop.identification.design_matrix import DesignMatrix
from plane_problems import a_problem, objective

PATHS = {
    "conjugate gradients": ((dense_solver, "_FACTORISED", 10), (least_squares, "_LARGE", 20)),
    "a few unknowns at a time": ((active_set, "_FEW", 2),),
    "an updated factor": ((dense_solver, "_LEAST_UPDATED", 1),),
    "normal equations of many samples": ((least_squares, "_MANY", 10),),
    "single rows of the Gram matrix": (
        (least_squares, "_LARGE", 20),
        (DesignMatrix, "gram", None),
        (dense_solver, "_SHARE", 1.0),
    ),
    "the whole Gram matrix": (
        (least_squares, "_LARGE", 20),
        (DesignMatrix, "gram_rows", lambda *_: pytest.fail("single rows")),
    ),
}
"""What makes a small problem go the way of a large one."""


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("strength", [0.0, 1e-4])
def test_each_path_reaches_the_same_optimum(path, strength, monkeypatch):
    problem = a_problem(14, 500)
    usual = problem.fit(strength)
    monkeypatch.setattr(least_squares._System, "_coarse_guess", lambda *_: usual.x / 2)
    for owner, name, value in PATHS[path]:
        monkeypatch.setattr(owner, name, value)
    other = problem.fit(strength)
    close, kkt = (1e-7, 1e-6) if path == "conjugate gradients" else (1e-9, 1e-10)
    assert objective(problem, other.x) == pytest.approx(objective(problem, usual.x), rel=close)
    assert other.kkt <= kkt


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
