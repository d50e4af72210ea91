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


def test_a_sweep_dips_at_the_true_depth(fit):
    depths = np.arange(0.5e-3, 0.8e-3, 0.01e-3)
    assert depths[np.argmin(fit.sweep(pit(around=40e-6), depths))] == pytest.approx(
        0.63e-3, abs=0.011e-3
    )


def test_distances_that_follow_the_angles_have_no_range_error(fit):
    assert fit.range_error < 1e-6
