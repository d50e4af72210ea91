import numpy as np
import pytest

from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec
from minorloop.identification.everett_system import EverettSystem

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
    if plane.offset:
        ridge[plane.cells] = 0.0
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
