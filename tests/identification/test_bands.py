import numpy as np
import pytest

from minorloop.errors import ParameterError
from minorloop.identification import identify
from minorloop.identification.bands import Prediction
from minorloop.operators.preisach import Preisach

MODEL = Preisach(np.linspace(0, 1, 6), np.tril(np.ones((5, 5))))
U = np.random.default_rng(0).uniform(0, 1, 25)


@pytest.fixture(scope="module")
def fit():
    y = MODEL.simulate(U) + np.random.default_rng(1).normal(0, 0.1, 25)
    return identify(U, y, levels=8)


def test_bands_cover_their_share():
    rng = np.random.default_rng(2)
    y, sd = rng.normal(size=20_000), np.full(20_000, 0.5)
    shown = Prediction(y, y, sd, 0.9)
    assert shown.covers(y + sd * rng.normal(size=y.size)) == pytest.approx(0.9, abs=0.01)
    np.testing.assert_allclose((shown.upper + shown.lower) / 2, y)


def test_missing_outputs_are_not_counted():
    shown = Prediction(np.zeros(3), np.zeros(3), np.ones(3), 0.5)
    assert shown.covers(np.array([0.0, np.nan, 9.0])) == 0.5
    assert np.isnan(shown.covers(np.full(3, np.nan)))


@pytest.mark.parametrize("bands", [0, 1, -0.1, 1.5, np.nan])
def test_refuses_what_is_no_probability(fit, bands):
    with pytest.raises(ParameterError, match="bands is"):
        fit.predict(U, bands=bands)


def test_no_outputs_are_printed_as_none(fit):
    assert str(fit.predict([], bands=0.9)) == "no outputs, bands of 90%"


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"noise": 1e300}, "noise is 1e"),
        ({"noise": True}, "noise is True"),
    ],
)
def test_refuses_what_the_prior_cannot_use(options, says):
    with pytest.raises(ParameterError, match=says):
        identify(U, U, **options)
