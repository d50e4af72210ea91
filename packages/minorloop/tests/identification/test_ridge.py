import numpy as np
import pytest

from fixed_options import Plane, identify
from minorloop import Gaussian, Preisach
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec
from minorloop.identification.ridge import KINDS, Ridge, fit_ridge

LEVELS = np.linspace(-2, 2, 17)
U = np.concatenate([np.linspace(-2, 2, 40), np.linspace(2, -2, 40)])


def shape(kind):
    return Ridge(kind, 0.6, 0.4, 0.5, 0.1, 0.7)


@pytest.mark.parametrize("kind", KINDS)
def test_weights_are_not_negative_have_a_sum_of_one_and_are_largest_at_the_coercive_field(kind):
    weights = shape(kind).irreversible(LEVELS)
    assert weights.sum() == pytest.approx(1.0)
    assert weights.min() >= 0
    assert not np.triu(weights, 1).any()
    i, j = np.unravel_index(weights.argmax(), weights.shape)
    middle = (LEVELS[1:] + LEVELS[:-1]) / 2
    assert (middle[i] - middle[j]) / 2 == pytest.approx(0.6, abs=0.2)
    assert (middle[i] + middle[j]) / 2 == pytest.approx(0.1, abs=0.2)
    reversible = shape(kind).reversible(LEVELS)
    assert reversible.sum() == pytest.approx(1.0)
    assert middle[reversible.argmax()] == pytest.approx(0.1, abs=0.2)


@pytest.mark.parametrize("kind", ["gaussian", "factored lorentzian"])
def test_a_major_loop_of_a_ridge_gives_its_minor_loops(kind):
    weights = 3.0 * shape(kind).irreversible(LEVELS)
    weights += np.diag(shape(kind).reversible(LEVELS))
    plane = Preisach(LEVELS, weights, offset=5.0)
    y = plane.simulate(U)
    matrix = DesignMatrix(PlaneSpec(LEVELS), U, np.ones(U.size, dtype=bool), "negative")
    found = fit_ridge(matrix, y, (kind,))
    assert found.nrmse < 1e-4
    model = matrix.spec.model(found.x)
    minor = np.concatenate([U, np.linspace(-2, 0.5, 20), np.linspace(0.5, -0.5, 20)])
    np.testing.assert_allclose(model.simulate(minor), plane.simulate(minor), atol=0.02)


def test_the_kind_with_the_least_error_is_kept():
    weights = shape("gaussian").irreversible(LEVELS)
    matrix = DesignMatrix(PlaneSpec(LEVELS), U, np.ones(U.size, dtype=bool), "negative")
    y = Preisach(LEVELS, weights).simulate(U)
    assert fit_ridge(matrix, y, ("lorentzian", "gaussian")).ridge.kind == "gaussian"


def test_few_samples_leave_the_mean_zero():
    found = identify(U[::16], U[::16], Plane(4), prior=Gaussian("ridge"))
    assert found.samples < 8
    assert found.ridge is None
