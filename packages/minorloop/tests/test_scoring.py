from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import minorloop as ml
from minorloop import BoucWen, Linear, Record, score
from minorloop.lab.records import Quantity
from minorloop.modelfile import ModelFile, Provenance
from minorloop.scoring import simulate

CHANCE = np.random.default_rng(1000)
PLANE = ml.Preisach(np.linspace(-1, 1, 6), np.tril(CHANCE.uniform(size=(5, 5))), 0.3)
U = np.concatenate([[-1.0, 1.0], CHANCE.uniform(-1, 1, 200)])
T = 0.1 * np.arange(U.size)
Y = PLANE.simulate(U)


def in_file(model=PLANE, lag=0, **given):
    return ModelFile(model, Quantity("u", "V"), Quantity("v", "mm/s"), lag, Provenance(), **given)


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


@pytest.mark.parametrize(
    ("inputs", "outputs", "named"), [(1e3, 1.0, "u [V]"), (1.0, 1e3, "v [mm/s]")]
)
def test_the_signal_with_another_prefix_is_named_alone(inputs, outputs, named):
    advice = " ".join(score(in_file(), Record(inputs * U, outputs * Y, T)).advice)
    assert advice.count("times that of the model") == 1
    assert f"give its unit in the header, as {named}" in advice


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


NUMBERS = np.repeat([4, 7, 9], 80)
NOISE = 0.05 * np.random.default_rng(1001).normal(size=240)
DRAWN = np.concatenate([[0.3], np.random.default_rng(1002).uniform(-1, 1, 239)])
CLEAN = np.concatenate([PLANE.simulate(DRAWN[k == NUMBERS], "positive") for k in (4, 7, 9)])


def numbered(y=CLEAN + NOISE, **settings):
    """Return a record of three curves that begin in positive saturation."""
    return Record(DRAWN, y, curves=NUMBERS, start_of_curve="positive", **settings)


def test_errors_are_those_of_the_outputs():
    found = score(PLANE, numbered(skip=2))
    kept = np.arange(240) % 80 >= 2
    error, y, span = -NOISE[kept], (CLEAN + NOISE)[kept], np.ptp((CLEAN + NOISE)[kept])
    assert found.scored.tolist() == kept.tolist()
    np.testing.assert_allclose(found.error[kept], error, atol=1e-12)
    figures = found.figures
    assert figures["nrmse"] == pytest.approx(np.sqrt(np.mean(error**2)) / span)
    assert figures["worst"] == pytest.approx(error[np.argmax(np.abs(error))] / span)
    assert figures["relative_rms"] == pytest.approx(np.sqrt(np.mean(error**2) / np.mean(y**2)))
    gain, offset = np.polyfit(CLEAN[kept], y, 1)
    assert figures["gain"] == pytest.approx(gain)
    left = y - offset - gain * CLEAN[kept]
    assert figures["nrmse_without_offset_and_gain"] == pytest.approx(np.std(left) / span)
    for one, name in zip(figures["curves"], (4, 7, 9), strict=True):
        own = np.sqrt(np.mean(NOISE[kept & (name == NUMBERS)] ** 2)) / span
        assert (one["name"], one["accuracy"]["nrmse"]) == (f"{name}", pytest.approx(own))


@pytest.mark.parametrize(
    ("law", "settings"),
    [
        (ml.Plane(5), {"curves": None, "start_of_curve": None}),
        (ml.Plane(5, lag=2), {"curves": None, "start_of_curve": None, "skip": 3}),
        (ml.Plane(5), {"start": "demagnetised", "curves": None, "start_of_curve": None}),
        (ml.Plane(5), {}),
    ],
)
def test_the_error_on_its_own_record_is_that_of_the_fit(law, settings):
    record = numbered().replace(**settings)
    fit = ml.identify(record, law)
    found = score(fit, record)
    assert found.nrmse == pytest.approx(fit.nrmse, rel=1e-9)
    assert found.scored.sum() == fit.samples


@pytest.mark.parametrize("curves", [NUMBERS, None])
def test_rows_without_curves_are_named_where_the_model_was_identified_from_curves(curves):
    known = ml.identify(numbered(), ml.Plane(5))
    start = None if curves is None else "positive"
    found = simulate(known, numbered().replace(curves=curves, start_of_curve=start))
    assert ("(--record curves=COLUMN)" in str(found.notes)) == (curves is None)


def test_groups_have_their_errors():
    moved = CLEAN + NOISE + (NUMBERS == 7)
    found = score(PLANE, numbered(moved, groups=NUMBERS)).curve_accuracy
    assert [one.name for one in found] == ["4", "7", "9"]
    assert [one.accuracy.rmse for one in found] == pytest.approx([0, 1, 0], abs=0.1)


def test_another_start_that_fits_is_named():
    u = np.concatenate([[0.2], 0.5 * np.sin(np.arange(60))])
    found = score(PLANE, Record(u, PLANE.simulate(u, "positive")))
    assert "(--record start=positive)" in str(found.advice)
    assert found.starts["positive"] < 1e-9


def test_the_error_that_the_file_promises_is_compared():
    promise = Provenance(scores={"nrmse_holdout": 0.001})
    known = ModelFile(PLANE, Quantity("u"), Quantity("y"), 0, promise)
    found = score(known, numbered(CLEAN + 10 * NOISE))
    assert found.figures["nrmse_promised"] == 0.001
    assert "times the 0.100% that the model had" in str(found.advice)
    fit = ml.identify(U, Y, ml.Plane(5), holdout=0.3)
    assert score(fit, Record(U, Y, T)).promised == fit.holdout_nrmse


@pytest.mark.parametrize("start", ["negative", "positive", "as-left"])
@pytest.mark.parametrize("kind", ["plays", "cascade", "after-effect", "oscillator"])
def test_each_curve_begins_with_its_start(kind, start):
    model, timed = MODELS[kind], kind != "plays"
    if (kind, start) == ("oscillator", "positive"):
        pytest.skip("it begins at rest")
    label, t = np.repeat([3, 5, 3], (20, 7, 30)), np.arange(57.0)
    u = np.random.default_rng(1000).uniform(-1, 1, 57)
    known = ModelFile(model, Quantity("u"), Quantity("y"), 0 if timed else 2, Provenance())
    record = Record(u, np.full(57, np.nan), t, curves=label, start_of_curve=start)
    found = simulate(known, record.with_memory_reset() if start != "as-left" else record).y
    ends = [0, 57] if start == "as-left" else [0, 20, 27, 57]
    begin = () if start == "as-left" or kind == "oscillator" else (start,)
    for first, last in pairwise(ends):
        part = slice(first, last)
        late = np.concatenate([[u[first]] * 2, u[part]])[:-2]
        inputs = (t[part] - t[first], u[part]) if timed else (late,)
        wanted = model.simulate(*inputs, *begin)
        np.testing.assert_allclose(found[part], wanted, rtol=1e-10, atol=1e-10)
