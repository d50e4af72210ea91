import numpy as np
import pytest

from minorloop.identification.design_matrix import PlaneSpec
from minorloop.identification.prior import Hyperparameters, PlanePrior

LEVELS = np.append(0, np.cumsum(np.random.default_rng(0).uniform(0.5, 1.5, 12))) / 10
SPECS = ({}, {"slope": True, "relay": "unipolar"}, {"offset": False})


def test_covariances_are_positive_on_uneven_planes():
    rng = np.random.default_rng(2)
    for _ in range(20):
        spec = PlaneSpec(np.sort(rng.uniform(0, 1, 9)), slope=True)
        values = np.exp(rng.normal(size=7)) * [0.3, 0.3, 0.4, 0.15, 0.3, 0.006, 0.003]
        plane, h = PlanePrior(spec), Hyperparameters(*values)
        assert np.linalg.eigvalsh(plane.covariance(h)).min() > 0
        assert (plane.scale(h) > 0).all()


def covariances(spec, h, bands):
    """Covariance of the unknowns through the field, and that of `PlanePrior`."""
    plane = PlanePrior(spec, bands)
    precision = plane.precision(h, 2.0)
    product = np.stack([precision.product(unit) for unit in np.eye(spec.unknowns)], axis=1)
    scale = plane.scale(h)
    return 2.0 * np.linalg.inv(product), scale[:, None] * plane.covariance(h) * scale


@pytest.mark.parametrize("options", SPECS)
@pytest.mark.parametrize("bands", [3, 6, 50])
def test_variances_are_those_of_the_dense_prior(options, bands):
    found, dense = covariances(PlaneSpec(LEVELS, **options), Hyperparameters(), bands)
    np.testing.assert_allclose(found.diagonal(), dense.diagonal(), rtol=1e-4)


@pytest.mark.parametrize(("bands", "off"), [(4, 0.2), (12, 0.06)])
def test_correlations_approach_those_of_the_dense_prior_on_a_fine_mesh(bands, off):
    found, dense = covariances(PlaneSpec(LEVELS), Hyperparameters(nugget=0.01), bands)
    found, dense = (c / np.sqrt(np.outer(c.diagonal(), c.diagonal())) for c in (found, dense))
    np.testing.assert_allclose(found, dense, atol=off)
