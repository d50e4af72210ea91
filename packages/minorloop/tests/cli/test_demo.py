from pathlib import Path

import numpy as np

from minorloop import modelfile


def test_report_data_and_model_agree(answer, run, refused):
    status, out, err = run("demo --out new/result --seed 2")
    assert (status, err) == (0, "")
    assert "report written to new/result/report.html; open it in a browser" in out
    folder = Path("new/result")
    assert {path.name for path in folder.iterdir()} == {
        "report.html",
        "staircase.csv",
        "model.json",
    }
    found = answer(
        "identify new/result/staircase.csv --input voltage --output curvature "
        "--law levels=10,diagonal=reversible --prior smooth:strength=0 --save new/model.json"
    )
    assert found["rank"] == found["unknowns"] == 56
    mine, theirs = modelfile.read("new/model.json"), modelfile.read(folder / "model.json")
    np.testing.assert_allclose(mine.model.weights, theirs.model.weights, atol=1e-9)
    assert (mine.input, mine.output) == (theirs.input, theirs.output)
    assert mine.provenance.sha256 == theirs.provenance.sha256
    before = {path: path.read_bytes() for path in folder.iterdir()}
    assert "is not empty; give a new or an empty one" in refused("demo --out new/result")
    assert {path: path.read_bytes() for path in folder.iterdir()} == before
