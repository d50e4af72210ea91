import numpy as np
import pytest
from scipy.optimize import nnls

from benchmarks import fit_times
from minorloop.identification import active_set, everett_system, least_squares
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec
from minorloop.identification.least_squares import Problem
from plane_problems import a_problem, objective

SPECS = (
    {},
    {"slope": True},
    {"offset": False},
    {"relay": "unipolar"},
    {"relay": "unipolar", "offset": False, "slope": True},
    {"diagonal": "reversible"},
)


@pytest.fixture(params=["dense", "sparse"])
def _system(request, monkeypatch):
    """Use either system for planes of any size."""
    if request.param == "sparse":
        monkeypatch.setattr(least_squares, "_LEAST_SPARSE", 0)
        monkeypatch.setattr(least_squares, "_FILL", np.inf)
        monkeypatch.setattr(everett_system, "_REVERSALS", np.inf)


def dense_optimum(problem):
    """Least objective by scipy on columns from unit weights."""
    spec, columns = problem.matrix.spec, problem.matrix.dense()
    if spec.offset:
        columns = np.column_stack([columns, -columns[:, spec.cells]])
    return 0.5 * nnls(columns, problem.y, maxiter=10_000)[1] ** 2


@pytest.mark.usefixtures("_system")
@pytest.mark.parametrize("spec", SPECS)
def test_the_optimum_is_that_of_scipy(spec):
    for seed in range(4):
        rng = np.random.default_rng(seed)
        samples, noise = int(rng.choice([5, 30, 300])), float(rng.choice([1e-3, 0.1]))
        problem = a_problem(int(rng.integers(2, 11)), samples, noise, seed, **spec)
        fit = problem.fit(0.0)
        assert fit.kkt <= 1e-10
        assert fit.converged
        scale = np.sum((problem.y - problem.y.mean()) ** 2) + 1e-12
        least = dense_optimum(problem)
        assert objective(problem, fit.x) == pytest.approx(least, rel=1e-9, abs=1e-14 * scale)


@pytest.mark.parametrize(
    ("shape", "bands", "seed", "kkt"),
    [
        (fit_times.walk, 50, 931006, active_set.TOLERANCE),
        (fit_times.random_staircase, 50, 1000, 2e-12),  # never reaches the tolerance
        (fit_times.walk, 100, 2, active_set.TOLERANCE),
        # One cell is off at one sample, by 0.0001 of its area.
        (fit_times.walk, 100, 771402, active_set.TOLERANCE),
    ],
)
def test_unknowns_hardly_determined_take_few_factorisations(shape, bands, seed, kkt, monkeypatch):
    model, u, y = fit_times.a_record(shape, bands, 1000, seed)
    spec, every = PlaneSpec(model.levels), np.ones(u.size, dtype=bool)
    done, factorise = list[int](), everett_system.EverettSystem.factorise

    def counted(self, ridge):
        done.append(1)
        factorise(self, ridge)

    monkeypatch.setattr(everett_system.EverettSystem, "factorise", counted)
    fit = Problem(DesignMatrix(spec, u, every, "negative"), y).fit(0.0)
    assert fit.kkt <= kkt
    assert len(done) <= 60


class DiagonalPivoting(active_set.Pivoting):
    """Pivoting on a diagonal system, whose solution fails below some ridge."""

    def __init__(self, diagonal, target, fails):
        self.diagonal, self.fails, self.failures = diagonal, fails, 0
        everywhere = np.ones(diagonal.size, dtype=bool)
        super().__init__(lambda z: diagonal * z - target, everywhere, 1.0)

    def step(self, downhill, free, ridge):
        self.factorisations += 1
        if ridge < self.fails:
            self.failures += 1
            raise np.linalg.LinAlgError
        return np.where(free, downhill / (self.diagonal + ridge), 0.0)


def test_a_ridge_that_fails_is_hardly_tried_again_and_the_optimum_is_met_above_it():
    diagonal = np.array([1.0, 0.1, 1e-3, 1e-11])
    pivoting = DiagonalPivoting(diagonal, diagonal * [1, 2, 3, 300], fails=0.9e-8)
    solution = pivoting.run(np.zeros(4))
    assert solution.kkt <= 1e-12
    assert pivoting.failures <= 4
