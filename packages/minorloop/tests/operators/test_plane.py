import numpy as np
import pytest

from minorloop.operators import plane

LEVELS = np.array([0.0, 1.0, 3.0, 3.5])
WEIGHTS = np.tril(np.random.default_rng(0).uniform(size=(3, 3)))


def test_nodes_are_sums_over_triangles():
    nodes = plane.nodes_from_weights(WEIGHTS)
    for a in range(4):
        for b in range(4):
            cells = [WEIGHTS[i, j] for i in range(a) for j in range(b, 3) if j <= i]
            assert nodes[a, b] == pytest.approx(sum(cells))


def test_nodes_and_weights_convert_into_each_other():
    np.testing.assert_allclose(plane.weights_from_nodes(plane.nodes_from_weights(WEIGHTS)), WEIGHTS)


def test_areas_cover_the_triangle():
    assert plane.cell_areas(LEVELS).sum() == pytest.approx(3.5**2 / 2)


def test_weights_of_a_constant_density_are_proportional_to_areas():
    weights = plane.integrate_density(LEVELS, lambda alpha, beta: 2.0)
    np.testing.assert_allclose(weights, 2 * plane.cell_areas(LEVELS))
