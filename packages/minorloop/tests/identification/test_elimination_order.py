import numpy as np
import pytest
from scipy.sparse import csc_array, eye_array, random_array

from minorloop.identification import elimination_order
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec
from minorloop.identification.elimination_order import Elimination, quick_elimination
from minorloop.identification.everett_system import EverettSystem


def links(unknowns, near, seed):
    """Pattern of places in a square that are linked where they are near, and a few far ones."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(size=(unknowns, 2))
    distance = np.abs(places[:, None] - places).max(axis=2)
    far = random_array((unknowns, unknowns), density=0.2 / unknowns, rng=rng)
    pattern = csc_array((distance < near).astype(np.float64)) + far + far.T + eye_array(unknowns)
    return csc_array(pattern != 0).astype(np.float64), places


@pytest.mark.parametrize("unknowns", [1, 2, 40, 900])
@pytest.mark.parametrize("together", [False, True])
def test_each_unknown_is_eliminated_once_and_the_last_ones_last(monkeypatch, unknowns, together):
    monkeypatch.setattr(elimination_order, "_COSTLY", 0.0)
    pattern, places = links(unknowns, 1.5 / np.sqrt(unknowns), unknowns)
    last = unknowns // 10
    places = np.zeros_like(places) if together else places
    found = quick_elimination(pattern, last, places[: unknowns - last])
    assert sorted(found.order) == list(range(unknowns))
    assert sorted(found.order[unknowns - last :]) == list(range(unknowns - last, unknowns))


def test_the_counts_are_those_of_a_dense_factor():
    pattern, _ = links(60, 0.2, 0)
    order = np.random.default_rng(1).permutation(60)
    found = Elimination.of(pattern, order)
    dense = pattern.toarray()[np.ix_(order, order)]
    root = np.linalg.cholesky(dense + 60 * np.eye(60))
    assert list(found.counts) == list(np.count_nonzero(np.abs(root) > 1e-300, axis=0))


def test_independent_steps_are_cut_in_parts():
    u = np.random.default_rng(1000).uniform(-1, 1, 1000)
    spec = PlaneSpec(np.linspace(-1, 1, 51))
    weight, scale, found = np.ones(u.size), np.ones(spec.unknowns), []
    for costly in (np.inf, elimination_order._COSTLY):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(elimination_order, "_COSTLY", costly)
            matrix = DesignMatrix(spec, u, weight > 0, "negative")
            found.append(EverettSystem(matrix, weight, scale))
    assert found[1].operations < 0.5 * found[0].operations
    r = np.random.default_rng(1).normal(size=spec.unknowns)
    solved = []
    for system in found:
        system.factorise(1.0)
        solved.append(system.solve(r, tolerance=1e-12, most=30))
    np.testing.assert_allclose(solved[1], solved[0], rtol=1e-9, atol=1e-9)
