import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import minorloop as ml
from minorloop.dynamics.linear import Linear
from minorloop.lab.records import Quantity, Record
from minorloop.modelfile import ModelFile, Provenance
from minorloop.operators.differential import BoucWen
from minorloop.scoring import score, simulate

CHANCE = np.random.default_rng(1000)
PLANE = ml.Preisach(np.linspace(-1, 1, 6), np.tril(CHANCE.uniform(size=(5, 5))), 0.3)
U = np.concatenate([[-1.0, 1.0], CHANCE.uniform(-1, 1, 200)])
T = 0.1 * np.arange(U.size)
Y = PLANE.simulate(U)


def in_file(model=PLANE, **given):
    return ModelFile(model, Quantity("u", "V"), Quantity("v", "mm/s"), 0, Provenance(), **given)


@given(st.floats(-5, 5), st.floats(0.2, 3))
def test_offset_and_gain_of_a_sensor_are_found(offset, gain):
    found = score(PLANE, Record(U, offset + gain * Y, T))
    shift, slope, left = found.line
    assert slope == pytest.approx(gain)
    middle = (Y.max() + Y.min()) / 2
    assert shift * found.span == pytest.approx(offset + (gain - 1) * middle, abs=1e-9)
    assert left < 1e-9


@pytest.mark.parametrize("unit", ["A", "1/V", "V^2", "mV/s", "V s"])
def test_other_units_are_refused(unit):
    with pytest.raises(ml.RecordError, match="give the column in V"):
        score(in_file(), Record(U, Y, T, f"u [{unit}]", "v"))


def test_a_lag_in_seconds_is_that_of_another_rate():
    slow = 0.5 * np.arange(U.size)
    late = np.interp(slow - 0.7, slow, Y)
    found = score(in_file(lag_seconds=0.7), Record(U, late, slow))
    assert found.nrmse < 1e-12
    assert not found.scored[:2].any()
    assert found.scored[2:].all()


MODELS = {
    "plays": ml.PrandtlIshlinskii([0.0, 0.3], [1.0, 2.0]),
    "relays": ml.RelayModel([-0.2, 0.3], [[0.0, 0.0], [0.3, 0.0]]),
    "polynomial": ml.Polynomial([0.0, 2.0, 1.0], -1.0, 1.0),
    "cascade": ml.Cascade(PLANE, Linear.lags(0.3)),
    "after-effect": ml.AfterEffect(PLANE, times=[2.0], creep=[0.1 * PLANE.weights]),
    "oscillator": ml.Oscillator(1.0, 2.0, 30.0, BoucWen(5.0, 1.0, 0.3, 1.0)),
}


@pytest.mark.parametrize("kind", MODELS)
def test_models_of_every_kind_are_scored(kind):
    model, timed = MODELS[kind], kind in ("cascade", "after-effect", "oscillator")
    y = model.simulate(T, U) if timed else model.simulate(U)
    assert score(model, Record(U, y, T)).nrmse < 1e-12
    noise = 0.1 * np.ptp(y) * CHANCE.normal(size=y.size)
    found = score(model, Record(U, y + noise, T))
    assert found.accuracy.rmse == pytest.approx(np.sqrt(np.mean(noise**2)), rel=1e-9)
    assert "error" in str(found)
    assert len(found.plot().axes) == 4


@pytest.mark.parametrize("model", [Linear.lags(1.0), ml.Cascade(PLANE, Linear.lags(0.3))])
def test_a_model_that_cannot_be_simulated_so_is_refused(model):
    counted = Record(U, Y, np.arange(U.size), time=ml.lab.records.SAMPLE)
    with pytest.raises((ml.ModelFileError, ml.RecordError), match=r"identify --save|--time"):
        simulate(model, counted)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: score(Record(U, Y), PLANE), "the model is a Record; give a model"),
        (lambda: score(PLANE, "other.csv"), "the record is a str; give what minorloop.read"),
        (lambda: ml.save(PLANE, "m.json", input=3), "the name is 3; give one such as"),
    ],
)
def test_arguments_of_another_type_are_refused_in_one_sentence(call, says):
    with pytest.raises(ml.ParameterError, match=says):
        call()


def test_clipped_readings_are_named():
    found = score(PLANE, Record(U, np.minimum(Y, np.quantile(Y, 0.7)), T))
    assert "is clipped" in str(found.advice)


def test_an_identification_is_scored_like_its_model():
    fit = ml.identify(U, Y + 0.01 * CHANCE.normal(size=U.size), ml.Plane(5, lag=1), holdout=0.3)
    found = score(fit, Record(U, Y, T))
    expected = np.sqrt(np.mean((fit.predict(U) - Y)[1:] ** 2)) / np.ptp(Y[1:])
    assert found.nrmse == pytest.approx(expected)
    assert found.promised == fit.holdout_nrmse


@pytest.fixture(scope="module")
def fit():
    """A fit of 20 bands, more than a file keeps for bands, to a record with noise."""
    model = ml.Preisach(np.linspace(-1, 1, 6), np.tril(np.ones((5, 5))))
    chance = np.random.default_rng(1001)
    u = np.cumsum(chance.normal(size=400) / 4)
    u = np.abs((u + 3) % 4 - 2) - 1
    return ml.identify(u, model.simulate(u) + 0.3 * chance.normal(size=400), ml.Plane(20))


def test_bands_of_a_file_are_those_of_the_fit(fit, tmp_path):
    ml.save(fit, tmp_path / "m.json")
    u = np.random.default_rng(1002).uniform(-1, 1, 300)
    y = PLANE.simulate(u)
    found = score(tmp_path / "m.json", Record(u, y, np.arange(300.0)))
    whole = fit.predict(u, bands=0.9)
    np.testing.assert_allclose(found.bands.half_width, whole.half_width, rtol=0.15)
    assert found.bands.half_width.mean() == pytest.approx(whole.half_width.mean(), rel=0.02)
    assert found.coverage == np.mean(np.abs(found.error) <= found.bands.half_width)
    assert score(fit, Record(u, y, np.arange(300.0))).coverage == whole.covers(y)


def test_readings_of_the_plant_lie_within_the_bands_and_those_of_another_do_not(fit, tmp_path):
    ml.save(fit, tmp_path / "m.json")
    chance = np.random.default_rng(1003)
    u = chance.uniform(-1, 1, 300)
    model = ml.Preisach(np.linspace(-1, 1, 6), np.tril(np.ones((5, 5))))
    y = model.simulate(u) + 0.3 * chance.normal(size=300)
    assert 0.85 < score(tmp_path / "m.json", Record(u, y, np.arange(300.0))).coverage <= 1
    found = score(tmp_path / "m.json", Record(u, y + 2 * u, np.arange(300.0)))
    assert found.coverage < 0.75
    assert "of the readings lie within the 90 % bands" in str(found.advice)


def test_rows_that_are_not_used_are_not_scored():
    log = Record(U, np.where(T < 2, 100.0, Y), T, "u", "v").only(50, 150)
    found = score(PLANE, log.replace(skip=60))
    assert found.y.size == 100
    assert found.accuracy.samples == 40
    np.testing.assert_array_equal(found.prediction, PLANE.simulate(U[50:150]))
