from pathlib import Path

import numpy as np
import pytest

from minorloop import modelfile

INVERT = "invert model.json targets.csv --target length"
WANTED = [0.3, 1.5, -2.0]


@pytest.fixture(autouse=True)
def _far():
    Path("far.csv").write_text("length\n0.3\n1000\n-1000\n")


def test_the_inputs_bring_the_model_to_the_targets(run, model):
    status, out, err = run(f"{INVERT} --start positive --save in.csv")
    assert (status, err) == (0, "")
    assert "written to in.csv" in out
    assert "out of reach" not in out
    header, *_ = Path("in.csv").read_text().splitlines()
    assert header == "voltage [V],target length [um],predicted length [um],reachable"
    u, target, predicted, reachable = np.loadtxt("in.csv", delimiter=",", skiprows=1).T
    np.testing.assert_array_equal(target, WANTED)
    np.testing.assert_allclose(model.simulate(u, "positive"), WANTED, atol=1e-10)
    np.testing.assert_allclose(predicted, WANTED, atol=1e-10)
    assert reachable.all()


def test_clipping_goes_as_near_as_possible_and_marks_the_targets(run, answer, model):
    line = "invert model.json far.csv --target length --clip"
    out = run(line)[1]
    assert "2 of 3 targets are out of reach of the model" in out
    assert out.count("│ out of reach │") == 2
    found = answer(f"{line} --save in.csv")
    assert found["unreachable"] == 2
    rows = np.loadtxt("in.csv", delimiter=",", skiprows=1)
    np.testing.assert_array_equal(rows[:, 3], [1, 0, 0])
    np.testing.assert_allclose(rows[1:, 2], model.range[::-1])


@pytest.mark.parametrize("verb", [INVERT, "simulate model.json good.csv --input voltage"])
def test_warnings_of_the_file_are_repeated_with_every_result(verb, run, model):
    modelfile.save(model, "model.json", warnings=["the output is clipped"], force=True)
    for option in ("", "--json"):
        status, out, err = run(f"{verb} {option}")
        assert status == 0
        if option and verb == INVERT:
            assert '"warnings": ["the output is clipped"]' in out
        else:
            assert err == "warning: this model is not to be trusted: the output is clipped\n"
