import numpy as np

from minorloop.identification.design_matrix import PlaneSpec
from minorloop.identification.prior import Hyperparameters, PlanePrior


def test_covariances_are_positive_on_uneven_planes():
    rng = np.random.default_rng(2)
    for _ in range(20):
        spec = PlaneSpec(np.sort(rng.uniform(0, 1, 9)), slope=True)
        values = np.exp(rng.normal(size=7)) * [0.3, 0.3, 0.4, 0.15, 0.3, 0.006, 0.003]
        plane, h = PlanePrior(spec), Hyperparameters(*values)
        assert np.linalg.eigvalsh(plane.covariance(h)).min() > 0
        assert (plane.scale(h) > 0).all()
