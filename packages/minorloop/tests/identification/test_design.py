import numpy as np
import pytest

from fixed_options import Plane, identify
from minorloop import Gaussian, Memory, ParameterError, Preisach, Record, design, next_input
from minorloop.identification.design_matrix import PlaneSpec
from minorloop.identification.likelihood import regressors
from minorloop.identification.prior import Hyperparameters
from minorloop.identification.prior_fit import posterior_after

LEVELS = np.linspace(0, 1, 11)
MODEL = Preisach(LEVELS, np.tril(np.exp(-np.subtract.outer(LEVELS[1:], LEVELS[1:]))))
U = np.array([0.0, 0.85, 0.3, 0.5, 0.95])
NOW = Memory.after(U, low=0, high=1)


@pytest.fixture(scope="module")
def fit():
    return identify(Record(U, MODEL.simulate(U), sd=0.05), Plane(LEVELS), prior=Gaussian())


def test_a_design_leaves_less_uncertainty_than_random_inputs():
    spec, h = PlaneSpec(LEVELS, diagonal="reversible"), Hyperparameters()
    rng = np.random.default_rng(0)
    aims = rng.uniform(0, 1, 60)

    def left(u):
        dense = regressors(spec, u, np.ones(u.size, dtype=bool), "negative")
        return np.mean(posterior_after(spec, h, dense).deviation(aims, "negative") ** 2)

    random = [left(np.append(0.0, rng.uniform(0, 1, 9))) for _ in range(10)]
    assert left(design(LEVELS, 10)) < np.quantile(random, 0.2)


def test_what_is_expected_of_a_hold_comes_true(fit):
    found = next_input(fit, NOW)
    assert 0 < found.gain < 1
    spec, h = fit.matrix.spec, fit.posterior.hyperparameters
    rng = np.random.default_rng(3)
    aims = rng.uniform(0, 1, 200)
    spread = []
    for u in (U, np.append(U, found.u)):
        dense = regressors(spec, u, np.ones(u.size, dtype=bool), "negative")
        posterior = posterior_after(spec, h, dense)
        spread.append(np.sqrt(np.mean(posterior.deviation(aims, "negative") ** 2)))
    assert spread[1] / spread[0] == pytest.approx(1 - found.gain, abs=0.15)


def test_a_plane_too_fine_for_dense_matrices_is_refused(fit, monkeypatch):
    monkeypatch.setattr("minorloop.identification.design.MOST_DENSE_CELLS", 54)
    with pytest.raises(ParameterError, match="56 unknowns; give at most 64 levels"):
        next_input(fit, NOW)
