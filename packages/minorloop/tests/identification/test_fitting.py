import numpy as np
import pytest

from fixed_options import Plane, identify
from minorloop.identification import excitation
from minorloop.identification.curves import Curves
from minorloop.identification.fitting import FitRecord, on_steep_branch


def steep(seed):
    """A wire that transforms within less than a step of its input."""
    rng = np.random.default_rng(seed)
    u = excitation.major_loop(np.linspace(0, 1, 11))
    half, sharp, centre = rng.uniform(0.05, 0.15), rng.uniform(10, 200), rng.uniform(0.3, 0.7)
    place, y = 0.0, np.empty(u.size)
    for k, value in enumerate(u):
        place = min(max(place, value - half), value + half)
        y[k] = 1 / (1 + np.exp(-sharp * (place - centre))) + 0.05 * value
    return u, y


@pytest.mark.parametrize("curve", [np.exp, np.copy])
def test_samples_of_a_curve_without_memory_are_no_outliers(curve):
    u = np.linspace(-1, 1, 150)
    assert identify(u, curve(u), Plane(10)).suspects == ()


def test_an_outlier_of_a_steep_branch_is_set_aside():
    u, y = steep(1005)
    y[25] += 3 * np.ptp(y)
    assert identify(u, y, Plane(8)).suspects == (25,)


def test_samples_of_steep_branches_lie_between_their_neighbours():
    u, y = np.array([0.0, 1, 2, 3, 2, 1, 0, 9]), np.array([0.0, 1, 5, 6, 3, 4, np.nan, 4.0])
    record = FitRecord(u, y, np.isfinite(y), Curves.whole("negative"), False)
    assert np.flatnonzero(on_steep_branch(record)).tolist() == [1, 2]
