import numpy as np
import pytest

from .synthetic import fit_of, pit


@pytest.fixture(scope="module")
def fit():
    return fit_of(pit(around=40e-6, size=0.05, depth=0.63e-3, tilt_along=0.02))


def test_the_fit_finds_the_pit_of_its_own_echoes(fit):
    found = fit.solve(pit(depth=0.62e-3)).unknowns
    assert found[3] == pytest.approx(0.63e-3, abs=2e-6)
    assert found[0] == pytest.approx(40e-6, abs=10e-6)
    assert found[4] == pytest.approx(1.0, abs=0.05)


def test_the_cost_of_the_fitted_pit_is_that_of_noise():
    fit = fit_of(pit(depth=0.63e-3))
    fit.refine_pulse(fit.solve(pit()).unknowns)
    assert fit.solve(pit(depth=0.63e-3)).cost == pytest.approx(fit.usual_cost, rel=0.1)
    assert fit.cost_of(fit.model.plain) > 2 * fit.usual_cost


def test_a_sweep_dips_at_the_true_depth(fit):
    depths = np.arange(0.5e-3, 0.8e-3, 0.01e-3)
    assert depths[np.argmin(fit.sweep(pit(around=40e-6), depths))] == pytest.approx(
        0.63e-3, abs=0.011e-3
    )


def test_distances_that_follow_the_angles_have_no_range_error(fit):
    assert fit.range_error < 1e-6


def test_deviations_grow_with_the_noise():
    quiet, loud = (fit_of(pit(), noise=noise).deviations(pit()) for noise in (0.01, 0.03))
    assert loud[3] == pytest.approx(3 * quiet[3], rel=0.2)
