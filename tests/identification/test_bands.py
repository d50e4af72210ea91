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


def test_bands_hold_what_they_promise():
    rng = np.random.default_rng(2)
    y, sd = rng.normal(size=20_000), np.full(20_000, 0.5)
    shown = Prediction(y, y, sd, 0.9)
    assert shown.covers(y + sd * rng.normal(size=y.size)) == pytest.approx(0.9, abs=0.01)
    np.testing.assert_allclose((shown.upper + shown.lower) / 2, y)


def test_what_was_not_measured_counts_for_nothing():
    shown = Prediction(np.zeros(3), np.zeros(3), np.ones(3), 0.5)
    assert shown.covers(np.array([0.0, np.nan, 9.0])) == 0.5
    assert np.isnan(shown.covers(np.full(3, np.nan)))


def test_a_model_predicts_with_and_without_bands(fit):
    shown = fit.predict(U, bands=0.5)
    np.testing.assert_array_equal(shown.y, fit.predict(U))
    assert (shown.lower < shown.y).all()
    assert (shown.sd > 0).all()
    assert "bands of 50%" in str(shown)
    assert len(shown.plot().axes) == 2


def test_an_inversion_says_how_sure_it_is(fit):
    targets = np.quantile(MODEL.simulate(U), [0.3, 0.8, 0.5])
    found = fit.invert(targets)
    np.testing.assert_allclose(found.sd, fit.predict(found.u, bands=0.9).sd)
    assert "sd" in str(found).splitlines()[0]
    assert fit.model.invert(targets).sd is None


@pytest.mark.parametrize("bands", [0, 1, -0.1, 1.5, np.nan])
def test_refuses_what_is_no_probability(fit, bands):
    with pytest.raises(ParameterError, match="bands is"):
        fit.predict(U, bands=bands)


def test_a_model_without_the_prior_has_no_bands():
    plain = identify(U, MODEL.simulate(U), levels=8, prior="none")
    with pytest.raises(ParameterError, match="prior gaussian"):
        plain.predict(U, bands=0.9)
    assert plain.invert([0.0], unreachable="clip").sd is None


def test_no_outputs_are_said_to_be_none(fit):
    assert str(fit.predict([], bands=0.9)) == "no outputs, bands of 90%"


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"noise": 1e300}, "noise is 1e"),
        ({"noise": True}, "noise is True"),
        ({"levels": 65, "prior": "gaussian"}, "2145 cells; give at most 64 levels"),
    ],
)
def test_refuses_what_the_prior_cannot_use(options, says):
    with pytest.raises(ParameterError, match=says):
        identify(U, U, **options)


def test_the_record_is_drawn_with_bands_between_the_samples(fit):
    record = fit.plot().axes[2]
    assert record.get_title() == "Record"
    across = record.collections[0].get_paths()[0].vertices[:, 0]
    assert len(np.unique(across)) > 5 * U.size
