import numpy as np
import pytest

from fixed_options import Plane, identify
from minorloop import Preisach, Smooth

MODEL = Preisach(np.linspace(0, 1, 6), np.tril(np.ones((5, 5))))
U = np.random.default_rng(0).uniform(0, 1, 25)


@pytest.fixture(scope="module")
def fit():
    y = MODEL.simulate(U) + np.random.default_rng(1).normal(0, 0.1, 25)
    return identify(U, y, Plane(8))


def test_a_model_predicts_with_and_without_bands(fit):
    shown = fit.predict(U, bands=0.5)
    np.testing.assert_array_equal(shown.y, fit.predict(U))
    assert (shown.lower < shown.y).all()
    assert (shown.sd > 0).all()
    assert "bands of 50%" in str(shown)
    assert len(shown.plot().axes) == 2


def test_an_inversion_has_standard_deviations(fit):
    targets = np.quantile(MODEL.simulate(U), [0.3, 0.8, 0.5])
    found = fit.invert(targets)
    np.testing.assert_allclose(found.sd, fit.predict(found.u, bands=0.9).sd)
    assert "sd" in str(found).splitlines()[0]
    assert fit.model.invert(targets).sd is None


def test_a_model_without_the_prior_has_bands():
    plain = identify(U, MODEL.simulate(U), Plane(8), prior=Smooth())
    assert (plain.predict(U, bands=0.9).sd > 0).all()
    assert plain.invert([0.0], unreachable="clip").sd > 0
    assert plain.band_sd == pytest.approx(plain.predict(U, bands=0.9).sd.mean())
