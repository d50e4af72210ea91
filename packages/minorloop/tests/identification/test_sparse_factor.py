import numpy as np
import pytest

from minorloop.identification.sparse_factor import SparseFactor


@pytest.mark.parametrize(("unknowns", "blocks"), [(1, 1), (30, 3), (200, 4), (300, 1)])
def test_a_quasi_definite_system_is_solved(unknowns, blocks):
    rng = np.random.default_rng(unknowns)
    sign = np.where(rng.random(unknowns) < 0.3, -1.0, 1.0)
    dense = np.zeros((unknowns, unknowns))
    for block in np.array_split(rng.permutation(unknowns), blocks):
        rows = rng.normal(size=(2 * block.size, block.size)) * (rng.random(block.size) < 0.7)
        dense[np.ix_(block, block)] = rows.T @ rows
    same = np.equal.outer(sign, sign)
    dense = np.where(same, sign * dense, dense) + np.diag(sign)
    rows, columns = np.nonzero(np.tril(dense))
    factor = SparseFactor(rows, columns, sign, unknowns // 10)
    for scale in (1.0, 1e-3):
        factor.factorise(scale * dense[rows, columns])
        b = rng.normal(size=unknowns)
        np.testing.assert_allclose(scale * dense @ factor.solve(b), b, rtol=1e-8, atol=1e-8)
        assert factor.logarithm() == pytest.approx(np.linalg.slogdet(scale * dense)[1], rel=1e-9)
        several = rng.normal(size=(unknowns, 3)) * (rng.random((unknowns, 1)) < 0.2)
        squares = np.einsum("nr,nr->r", several, np.linalg.solve(scale * dense, several))
        np.testing.assert_allclose(factor.squares(several), squares, rtol=1e-7, atol=1e-9)
        inverse = np.linalg.inv(scale * dense)[rows, columns]
        size = np.abs(inverse).max()
        np.testing.assert_allclose(factor.inverse(), inverse, rtol=1e-7, atol=1e-9 * size)


def test_entries_in_one_place_are_added():
    factor = SparseFactor(np.array([0, 1, 0, 1]), np.array([0, 1, 0, 0]), np.ones(2))
    factor.factorise(np.array([1.0, 3.0, 1.0, 1.0]))
    np.testing.assert_allclose(factor.solve(np.array([3.0, 4.0])), [1.0, 1.0])


def test_an_unknown_without_a_pivot_becomes_zero():
    factor = SparseFactor(np.array([0, 1, 1]), np.array([0, 1, 0]), np.ones(2))
    factor.factorise(np.array([1.0, 1.0, 1.0]))
    np.testing.assert_allclose(np.sort(factor.solve(np.array([2.0, 2.0]))), [0.0, 2.0], atol=1e-12)
