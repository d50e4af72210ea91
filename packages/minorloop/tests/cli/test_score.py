"""Errors of a model on another file; figures are compared with numpy on what simulate writes."""

import json
from pathlib import Path

import numpy as np
import pytest

from minorloop import modelfile

SCORE = "score model.json other.csv"
CHANCE = np.random.default_rng(1000)


@pytest.fixture(autouse=True)
def other(model):
    """A second record of the plant with noise: time, voltage, length, and numbers of curves."""
    u = np.concatenate([[0.3], CHANCE.uniform(-1, 1, 239)])
    curve = np.repeat([4, 7, 9], 80)
    y = np.concatenate([model.simulate(u[curve == k], "positive") for k in (4, 7, 9)])
    rows = np.column_stack([0.5 * np.arange(240), u, y + 0.05 * CHANCE.normal(size=240), curve])
    write("other.csv", rows)
    return rows


def write(name, rows, header="time [s],voltage [V],length [um],curve"):
    np.savetxt(name, rows, "%.17g", ",", header=header, comments="")


CURVES = "--record curves=curve,start_of_curve=positive"


def test_figures_are_those_of_the_outputs_that_simulate_writes(other, answer, run):
    found = answer(f"{SCORE} {CURVES} --record skip=2 --save residuals.csv")
    assert run(f"simulate model.json other.csv {CURVES} --save predicted.csv")[0] == 0
    y, predicted = other[:, 2], np.loadtxt("predicted.csv", delimiter=",", skiprows=1)[:, -1]
    kept = np.arange(240) % 80 >= 2
    error, span = (predicted - y)[kept], np.ptp(y[kept])
    assert found["samples"] == kept.sum()
    assert found["nrmse"] == pytest.approx(np.sqrt(np.mean(error**2)) / span)
    assert found["worst"] == pytest.approx(error[np.argmax(np.abs(error))] / span)
    assert found["relative_rms"] == pytest.approx(
        np.sqrt(np.mean(error**2) / np.mean(y[kept] ** 2))
    )
    gain, offset = np.polyfit(predicted[kept], y[kept], 1)
    assert found["gain"] == pytest.approx(gain)
    left = y[kept] - offset - gain * predicted[kept]
    assert found["nrmse_without_offset_and_gain"] == pytest.approx(np.std(left) / span)
    for one, name in zip(found["curves"], ("4", "7", "9"), strict=True):
        part = (other[:, 3] == int(name)) & kept
        own = np.sqrt(np.mean((predicted - y)[part] ** 2)) / span
        assert (one["name"], one["accuracy"]["nrmse"]) == (name, pytest.approx(own))
    table = np.genfromtxt("residuals.csv", delimiter=",", names=True)
    np.testing.assert_allclose(table["residual_length_um"][kept], error)
    assert np.isnan(table["residual_length_um"][~kept]).all()
    np.testing.assert_array_equal(table["measured_length_um"], y)


def test_the_error_on_its_own_record_is_that_of_the_fit(answer, run, other):
    columns = "--input voltage --output length"
    for options in ("", "--law lag=2 --record skip=3,start=demagnetised", f"{CURVES}", ""):
        line = f"identify other.csv {columns} --law levels=5 {options} --save own.json --force"
        fit = json.loads(run(f"{line} --json")[1])
        again = options.removeprefix("--law lag=2 ")
        found = json.loads(run(f"score own.json other.csv {again} --json")[1])
        assert found["nrmse"] == pytest.approx(fit["nrmse_train"], rel=1e-9)
        assert found["samples"] == fit["samples"]


def test_groups_have_their_errors(other, answer):
    rows = other.copy()
    rows[rows[:, 3] == 7, 2] += 1.0
    write("moved.csv", rows[:, [0, 1, 2, 3, 3]], "t,voltage,length,curve,specimen")
    found = answer(f"score model.json moved.csv {CURVES} --record groups=specimen")["curves"]
    assert [one["name"] for one in found] == ["4", "7", "9"]
    small, large, _ = (one["accuracy"]["rmse"] for one in found)
    assert large == pytest.approx(1.0, abs=0.05)
    assert small < 0.1


def test_another_start_that_fits_is_named(model, run):
    u = np.concatenate([[0.2], 0.5 * np.sin(np.arange(60))])
    np.savetxt(
        "up.csv",
        np.column_stack([u, model.simulate(u, "positive")]),
        delimiter=",",
        header="voltage,length",
        comments="",
    )
    status, out, _ = run("score model.json up.csv --json")
    assert status == 1
    assert "(--record start=positive)" in str(json.loads(out)["advice"])
    assert json.loads(out)["starts"]["positive"] < 1e-9
    assert run("score model.json up.csv --record start=positive")[0] == 0


def test_the_error_that_the_file_promises_is_compared(other, model, answer):
    promise = {"scores": {"nrmse_holdout": 0.001}}
    modelfile.save(model, "sure.json", input="voltage", output="length", provenance=promise)
    rows = other.copy()
    rows[:, 2] += 0.5 * CHANCE.normal(size=240)
    write("noisy.csv", rows)
    found = answer(f"score sure.json noisy.csv {CURVES}")
    assert found["nrmse_promised"] == 0.001
    assert "times the 0.100% that the model had" in str(found["advice"])


def test_a_report_shows_what_is_printed(run):
    status, out, err = run(f"{SCORE} {CURVES} --report r.html --save s.csv")
    assert (status, err) == (0, "")
    assert "residuals written to s.csv" in out
    page = Path("r.html").read_text()
    for text in ("model.json on other.csv", "How good it is", "Curve by curve", "data:image/svg"):
        assert text in page
