import sys
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path

import pytest

from minorloop.cli import study
from minorloop.studies import fibre


def test_prints_claim_run_and_verdict_and_writes_the_report(run):
    status, out, err = run("study fibre --seed 1 --out made")
    assert (status, err) == (0, "")
    assert "1 simulated specimen" in out
    assert "verdict" in out
    assert "met" in out
    html = Path("made/report.html").read_text()
    assert fibre.TITLE in html


def test_figures_of_several_specimens_are_medians(answer, monkeypatch):
    monkeypatch.setattr(fibre, "run_study", cache(fibre.run_study))
    found = answer("study fibre --specimens 2 --seed 4")
    each = [fibre.run_study(seed).figures() for seed in (4, 5)]
    expected = sum(one["steady"]["curves_nrmse"] for one in each) / 2
    assert found["steady"]["curves_nrmse"] == pytest.approx(expected, rel=1e-9)
    assert (found["specimens"], found["seed"]) == (2, 4)


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("study moon", "there is no study 'moon'; give one of "),
        ("study fibre --specimens 0", "--specimens is 0; give 1 to 1000"),
        ("study fibre --seed -1", "--seed is -1; give 0 or more"),
        ("study fibre --out good.csv", "good.csv is a file"),
        ("study fibre --only unreachable", "--only is 'unreachable'; fibre has no parts"),
        ("study head --only all", "--only is 'all'; give unreachable"),
        ("study head --only unreachable --out made", "a part of a study has no report"),
    ],
)
def test_refuses_in_one_line(line, says, refused):
    assert says in refused(line)


def test_every_study_can_be_imported():
    for point in entry_points(group=study.STUDIES):
        assert {claim.key for claim in point.load().CLAIMS}


def test_without_trimesh_the_surfaces_that_are_not_written_are_named(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "trimesh", None)
    for name in ("head", "inspection"):
        study._check_surfaces(name)
    said = capsys.readouterr().err
    assert said == (
        "surfaces are not written: trimesh is not installed; pip install 'minorloop[head]' "
        "brings it\n"
    )
