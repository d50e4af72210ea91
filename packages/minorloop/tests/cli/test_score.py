"""Errors of a model on another file; figures are compared with numpy on what simulate writes."""

import numpy as np
import pytest

from command_line import write
from minorloop import modelfile

SCORE = "score model.json other.csv"
HEADER = "time [s],voltage [V],length [um],curve"
CHANCE = np.random.default_rng(1000)


@pytest.fixture(autouse=True)
def other(model):
    """A second record of the plant with noise: time, voltage, length, and numbers of curves."""
    u = np.concatenate([[0.3], CHANCE.uniform(-1, 1, 239)])
    curve = np.repeat([4, 7, 9], 80)
    y = np.concatenate([model.simulate(u[curve == k], "positive") for k in (4, 7, 9)])
    rows = np.column_stack([0.5 * np.arange(240), u, y + 0.05 * CHANCE.normal(size=240), curve])
    write("other.csv", HEADER, rows)
    return rows


CURVES = "--record curves=curve,start_of_curve=positive"


@pytest.mark.parametrize("start", ["positive", "as-left"])
def test_curves_begin_as_in_the_record_of_the_model(start, run):
    line = "identify other.csv --input voltage --output length --law levels=6,slope=no,lag=0"
    run(f"{line} --record curves=curve,start_of_curve={start} --save curves.json")
    line = "simulate curves.json other.csv --time none --json --record curves=curve"
    found = run(line)
    assert "start_of_curve" not in found[1]
    assert found == run(f"{line},start_of_curve={start}")
    assert found != run(f"{line},start_of_curve=negative")


def test_residuals_are_those_of_the_outputs_that_simulate_writes(other, answer, run):
    found = answer(f"{SCORE} {CURVES} --record skip=2 --save residuals.csv")
    status, out, _ = run(f"simulate model.json other.csv {CURVES} --save predicted.csv")
    assert status == 0
    assert "240 samples of length" in out
    y, predicted = other[:, 2], np.loadtxt("predicted.csv", delimiter=",", skiprows=1)[:, -1]
    kept = np.arange(240) % 80 >= 2
    assert found["samples"] == kept.sum()
    table = np.genfromtxt("residuals.csv", delimiter=",", names=True)
    np.testing.assert_allclose(table["residual_length_um"][kept], (predicted - y)[kept])
    assert np.isnan(table["residual_length_um"][~kept]).all()
    np.testing.assert_array_equal(table["measured_length_um"], y)


def test_a_model_that_does_not_predict_the_record_ends_with_status_1(other, run):
    write("turned.csv", HEADER, other * [1, 1, -1, 1])
    status, out, err = run("score model.json turned.csv")
    assert status == 1
    assert "the model does not predict this record" in " ".join(out.split())
    assert err == "warning: this model is not to be trusted: the first of these says why\n"


def test_the_file_that_the_model_was_identified_from_is_named(answer, run, model):
    said = "the model was identified from this file, so its error here says little about"
    assert said not in " ".join(answer(SCORE)["notes"])
    origin = modelfile.Provenance.of("other.csv")
    names = {"input": "voltage [V]", "output": "length [um]"}
    modelfile.save(model, "own.json", provenance=origin, **names)
    assert said in " ".join(run("score own.json other.csv")[1].split())
