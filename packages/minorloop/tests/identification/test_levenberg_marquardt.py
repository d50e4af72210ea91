import numpy as np
import pytest

from minorloop.identification.levenberg_marquardt import minimise


def valley(x):
    """Rosenbrock's valley."""
    residuals = np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])
    return residuals, np.array([[-20 * x[0], 10.0], [-1.0, 0.0]])


def test_a_curved_valley_is_followed_to_its_end():
    found = minimise(valley, np.array([-1.2, 1.0]), gain=1e-12)
    assert found.converged
    assert found.parameters == pytest.approx([1, 1], abs=1e-5)


def test_steps_to_where_there_is_no_model_are_refused():
    def half(x):
        return None if x[0] <= 0 else (np.array([np.log(x[0]) + 2]), np.array([[1 / x[0]]]))

    found = minimise(half, np.array([30.0]), gain=1e-12)  # a full step leads to -101
    assert found.parameters == pytest.approx([np.exp(-2)])
    assert minimise(half, np.array([-1.0])) is None


def test_a_parameter_without_effect_stays():
    def flat(x):
        return np.array([x[0] - 3, x[0] - 5]), np.array([[1.0, 0.0], [1.0, 0.0]])

    found = minimise(flat, np.array([0.0, 7.0]), gain=1e-12)
    assert found.converged
    assert found.parameters == pytest.approx([4, 7])


def test_a_search_that_is_cut_short_says_so():
    found = minimise(valley, np.array([-1.2, 1.0]), steps=3)
    assert (found.steps, found.converged) == (3, False)
