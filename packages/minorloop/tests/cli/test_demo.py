import re
from pathlib import Path

import numpy as np

from minorloop import modelfile
from minorloop.positioning import run_positioning

KEYS = ("rms_preisach", "rms_quadratic", "rms_ratio", "max_preisach", "max_quadratic")


def test_json_has_the_figures_of_merit(answer):
    found = answer("demo --seed 3 --noise 0.05")
    summary = run_positioning(3, 0.05).summary
    assert {key: found[key] for key in KEYS} == {key: summary[key] for key in KEYS}
    assert found["rms_ratio"] == found["rms_quadratic"] / found["rms_preisach"]
    assert (found["seed"], found["noise"]) == (3, 0.05)
    assert found["measurements"] == found["unknowns"] == 56


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


def test_the_report_opens_offline(run):
    assert run("demo --out result --json")[0] == 0
    page = Path("result/report.html").read_text(encoding="utf-8")
    sources = re.findall(r'(?:src|href|action|data)="([^"]*)"', page)
    assert len(sources) == 4
    assert all(source.startswith("data:image/svg+xml;base64,") for source in sources)
    assert not re.search(r"https?://|@import|url\(|<script|<link", page)
