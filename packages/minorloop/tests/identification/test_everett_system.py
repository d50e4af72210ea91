import numpy as np
import pytest

from minorloop.identification import everett_system
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec
from minorloop.identification.everett_system import EverettSystem, quick_system
from minorloop.identification.prior import Hyperparameters, PlanePrior

SPECS = (
    {},
    {"slope": True},
    {"offset": False},
    {"relay": "unipolar", "offset": False, "slope": True},
    {"diagonal": "reversible"},
)


@pytest.mark.parametrize("spec", SPECS)
@pytest.mark.parametrize("start", ["negative", "demagnetised"])
def test_it_solves_the_normal_equations_with_a_ridge(spec, start):
    rng = np.random.default_rng(0)
    plane = PlaneSpec(np.sort(rng.uniform(-1, 1, 9)), **spec)
    u = np.interp(np.arange(0, 40, 0.3), np.arange(41), rng.uniform(-1, 1, 41))
    matrix = DesignMatrix(plane, u, rng.random(u.size) < 0.8, start)
    weight, scale = rng.uniform(0, 2, matrix.samples), rng.uniform(0.05, 0.2, plane.unknowns)
    ridge = rng.uniform(0.1, 10, plane.unknowns)
    system = EverettSystem(matrix, weight, scale)
    system.factorise(ridge)
    columns = scale * matrix.dense()
    normal = columns.T * weight @ columns + np.diag(ridge)
    r = rng.normal(size=plane.unknowns)
    expected = np.linalg.solve(normal, r)
    np.testing.assert_allclose(system.solve(r, tolerance=1e-12, most=30), expected, atol=1e-9)
    free = rng.random(plane.unknowns) < 0.5
    system.factorise(np.where(free, ridge, 1e4))
    some = np.zeros(plane.unknowns)
    some[free] = np.linalg.solve(normal[np.ix_(free, free)], r[free])
    np.testing.assert_allclose(system.solve(r, free, 1e-12, 50), some, atol=1e-9)
    assert system.operations > 0


@pytest.mark.parametrize("spec", SPECS)
def test_with_a_prior_it_is_the_precision_of_the_unknowns(spec):
    rng = np.random.default_rng(1)
    plane = PlaneSpec(np.sort(rng.uniform(-1, 1, 9)), **spec)
    u = np.interp(np.arange(0, 20, 0.3), np.arange(21), rng.uniform(-1, 1, 21))
    matrix = DesignMatrix(plane, u, rng.random(u.size) < 0.8, "negative")
    weight, scale = rng.uniform(0, 2, matrix.samples), rng.uniform(0.05, 0.2, plane.unknowns)
    assumed = PlanePrior(plane, 5)
    precision = assumed.precision(Hyperparameters(), 0.01)
    system = EverettSystem(matrix, weight, scale, assumed.mesh)
    system.condition(precision, scale)
    ridge = rng.uniform(0, 1, plane.unknowns)
    system.factorise(ridge)
    prior = np.stack([precision.product(unit) for unit in np.eye(plane.unknowns)], axis=1)
    columns = matrix.dense()
    whole = scale[:, None] * (columns.T * weight @ columns + prior) * scale + np.diag(ridge)
    r = rng.normal(size=plane.unknowns)
    np.testing.assert_allclose(system.product(r) + ridge * r, whole @ r, rtol=1e-8)
    found = system.solve(r, tolerance=1e-12, most=20)
    np.testing.assert_allclose(found, np.linalg.solve(whole, r), atol=1e-9)
    later = rng.uniform(-1.2, 1.2, 90)
    future = DesignMatrix(plane, later, rng.random(90) < 0.8, "positive")
    rows = future.dense() * scale
    variances = np.einsum("tk,kt->t", rows, np.linalg.solve(whole, rows.T))
    np.testing.assert_allclose(system.variances(future), variances, rtol=1e-5)
    before = system.logarithm()
    system.factorise(0.0)
    change = np.linalg.slogdet(whole)[1] - np.linalg.slogdet(whole - np.diag(ridge))[1]
    assert before - system.logarithm() == pytest.approx(change, rel=1e-5)


class TestCounting:
    @pytest.fixture
    def counted(self, monkeypatch):
        """Unknowns of the systems whose order of elimination was searched."""
        sizes, search = [], everett_system.quick_elimination

        def counting(pattern, *rest):
            sizes.append(pattern.shape[0])
            return search(pattern, *rest)

        monkeypatch.setattr(everett_system, "quick_elimination", counting)
        monkeypatch.setattr(everett_system, "_FIRST_PART", 100)
        return sizes

    @pytest.fixture
    def steps(self):
        u = np.random.default_rng(2).uniform(-1, 1, 1600)
        spec = PlaneSpec(np.linspace(-1, 1, 41))
        matrix = DesignMatrix(spec, u, np.ones(u.size, dtype=np.bool_), "negative")
        return matrix, np.ones(u.size), np.ones(spec.unknowns)

    def test_the_order_of_elimination_is_searched_once_for_a_record(self, counted, steps):
        system = quick_system(*steps, np.inf)
        assert system is not None
        searched = len(counted)
        again = quick_system(*steps, np.inf, PlanePrior(steps[0].spec, 5).mesh)
        assert again is not None
        assert again.operations > system.operations
        assert len(counted) == searched

    def test_parts_whose_multiplications_grow_fast_show_that_the_whole_takes_too_many(
        self, counted, steps
    ):
        whole = EverettSystem(*steps).operations
        fresh = DesignMatrix(steps[0].spec, steps[0].u, steps[1] > 0, "negative")
        counted.clear()
        assert quick_system(fresh, *steps[1:], 0.5 * whole) is None
        assert 0.5 * whole < fresh.operations <= whole
        searched = len(counted)
        assert searched <= 3
        assert fresh.order is None
        assert quick_system(fresh.coarser(), steps[1], np.ones(211), whole / 16) is None
        assert quick_system(fresh, *steps[1:], 0.5 * whole) is None
        assert len(counted) == searched
