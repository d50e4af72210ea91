import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop.operators.densities import (
    FactoredGaussianDensity,
    FactoredLorentzianDensity,
    GaussianDensity,
    LorentzianDensity,
)
from minorloop.operators.plane import integrate_density

TAILED = [
    FactoredGaussianDensity(0.5, 0.4, mass=3.0, centre=0.2),
    FactoredGaussianDensity(0.0, 1.0),
    GaussianDensity(0.5, 0.3, 0.6, mass=3.0, centre=-0.2),
    GaussianDensity(0.0, 1.0, 0.2),
    LorentzianDensity(0.5, 0.3, 0.6, mass=3.0, centre=0.2),
    FactoredLorentzianDensity(0.5, 0.4, mass=3.0, centre=-0.2),
    FactoredLorentzianDensity(0.0, 1.0),
]
thresholds = st.floats(-5, 5)


def half_plane(in_mean_and_half_width, order=300):
    """Thresholds and quadrature weights; tangents of angles reach into the tails."""
    nodes, weights = np.polynomial.legendre.leggauss(order)
    nodes, weights = (nodes + 1) / 2, weights / 2
    angle = (nodes[:, None] - 0.5) * np.pi
    if in_mean_and_half_width:
        mean, half = np.tan(angle), np.tan(nodes * np.pi / 2)
        area = 2 * np.pi * np.pi / 2 * (1 + mean**2) * (1 + half**2)
        return mean + half, mean - half, area * weights[:, None] * weights
    below = (angle + np.pi / 2) * nodes - np.pi / 2
    alpha, beta = np.tan(angle), np.tan(below)
    area = np.pi * (angle + np.pi / 2) * (1 + alpha**2) * (1 + beta**2)
    return alpha, beta, area * weights[:, None] * weights


@pytest.mark.parametrize("density", TAILED, ids=repr)
def test_mass_is_the_integral_over_the_half_plane(density):
    alpha, beta, area = half_plane(hasattr(density, "spread_mean"))
    assert (density(alpha, beta) * area).sum() == pytest.approx(density.mass, rel=1e-6)


@pytest.mark.parametrize("density", TAILED, ids=repr)
@given(alpha=thresholds, beta=thresholds)
def test_symmetric_about_the_centre_and_nothing_below_the_diagonal(density, alpha, beta):
    mirrored = density(2 * density.centre - beta, 2 * density.centre - alpha)
    if alpha > beta + 1e-9:
        assert density(alpha, beta) == pytest.approx(float(mirrored), rel=1e-9, abs=1e-300)
        assert density(alpha, beta) > 0
    elif alpha < beta:
        assert density(alpha, beta) == 0


def test_factored_density_is_a_product_with_the_given_widths():
    gaussian, lorentzian = FactoredGaussianDensity(1.0, 0.2), FactoredLorentzianDensity(1.0, 0.2)
    assert gaussian(1.2, -1.0) == pytest.approx(gaussian(1.0, -1.0) * np.exp(-0.5))
    assert gaussian(1.2, -1.2) == pytest.approx(gaussian(1.0, -1.0) * np.exp(-1.0))
    assert lorentzian(1.2, -1.0) == pytest.approx(lorentzian(1.0, -1.0) / 2)
    assert lorentzian(1.2, -1.2) == pytest.approx(lorentzian(1.0, -1.0) / 4)


def test_cells_of_a_plane_add_up_to_the_mass_within_it():
    levels = np.linspace(-1.0, 2.0, 9)
    narrow = GaussianDensity(0.5, 0.1, 0.1, mass=3.0, centre=0.5)
    assert integrate_density(levels, narrow).sum() == pytest.approx(3.0, rel=1e-5)
