import json
import math
import os
import re
import signal
import sys
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import pytest

from minorloop.errors import SignalError
from papers import __main__ as study
from papers import harness
from papers.harness import Study, study_of


def test_prints_claim_run_and_verdict_and_writes_the_report(run):
    status, out, err = run("fibre --seed 1 --out made")
    assert status == 0
    assert re.fullmatch(r"specimen 1 of 1, seed 1: \d+ s\n", err)
    assert "1 simulated specimen" in out
    assert "verdict" in out
    assert "met" in out
    assert {file.name for file in Path("made").iterdir()} == {"figures.json", "report.html"}
    assert study_of(study.STUDIES["fibre"]).title in Path("made/report.html").read_text()
    found = json.loads(Path("made/figures.json").read_text())
    assert found["steady"]["curves_nrmse"] > 0
    assert (found["specimens"], found["seed"]) == (1, 1)


def test_figures_of_several_specimens_are_medians(run, monkeypatch):
    monkeypatch.setitem(study.STUDIES, "made", "made_study")
    status, out, err = run("made --specimens 2 --seed 4 --json")
    assert status == 0
    assert re.fullmatch(r"specimen 1 of 2, seed 4: \d+ s\nspecimen 2 of 2, seed 5: \d+ s\n", err)
    found = json.loads(out)
    assert found["steady"] == {"square": (4**2 + 5**2) / 2}
    assert (found["specimens"], found["seed"]) == (2, 4)


class Specimen:
    """Of a study that ends the program from outside while it runs a specimen, or fails with one."""

    def __init__(self, ends, fails=None):
        self.ends, self.fails = ends, fails
        self.STUDY = Study("made", "A study", self.run)

    def run(self, seed):
        if seed == self.fails:
            raise SignalError("no lag")
        if seed == self.ends:
            os.kill(os.getpid(), signal.SIGTERM)
        return SimpleNamespace(figures=lambda: {"seed_of": float(seed), "none": math.nan})


def one_by_one(work, count, seed):
    return nullcontext(work(seed + k) for k in range(count))


@pytest.mark.parametrize(
    ("ends", "done", "kept"),
    [(7, 0, "nothing is kept"), (9, 2, f"their figures are in {Path('made', 'unfinished.json')}")],
)
def test_what_is_done_is_kept_after_a_signal(run, monkeypatch, ends, done, kept):
    made = Specimen(ends)
    monkeypatch.setitem(sys.modules, "made_study", made)
    monkeypatch.setitem(study.STUDIES, "made", "made_study")
    monkeypatch.setattr(harness, "begun", one_by_one)
    status, out, err = run("made --specimens 4 --seed 7 --out made")
    assert (status, out) == (130, "")
    lines = [f"specimen {k + 1} of 4, seed {7 + k}: 0 s" for k in range(done)]
    assert err.splitlines() == [*lines, f"{done} of 4 specimens are done; {kept}", "interrupted"]
    files = list(Path("made").iterdir())
    assert [file.name for file in files] == ["unfinished.json"] * bool(done)
    if done:
        figures = {"seed_of": 7.5, "none": None}
        counts = {"unfinished": True, "specimens": 2, "of": 4, "seed": 7}
        assert json.loads(files[0].read_text()) == figures | counts


def test_a_specimen_that_cannot_be_done_is_named_and_the_others_are_kept(run, monkeypatch):
    monkeypatch.setitem(sys.modules, "made_study", Specimen(None, fails=8))
    monkeypatch.setitem(study.STUDIES, "made", "made_study")
    monkeypatch.setattr(harness, "begun", one_by_one)
    status, out, err = run("made --specimens 4 --seed 7 --out made")
    assert (status, out) == (2, "")
    kept = f"1 of 4 specimens are done; their figures are in {Path('made', 'unfinished.json')}"
    assert err.splitlines()[1:] == [f"! seed 8: {kept}", "error: no lag"]


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("moon", "there is no study 'moon'; give one of "),
        ("fibre --specimens 0", "--specimens is 0; give 1 to 1000"),
        ("fibre --seed -1", "--seed is -1; give 0 to 4294967295"),
        ("fibre --out good.csv", "good.csv is a file"),
        ("fibre --only unreachable", "--only is 'unreachable'; fibre has no parts"),
        ("head --only all", "--only is 'all'; give integral, rivals, unreachable"),
        ("inspection --only all", "--only is 'all'; give missions, scans, sweeps"),
        ("inspection --only missions --scans 9", "--scans is not for --only missions"),
    ],
)
def test_refuses_in_one_line(line, says, refused):
    assert says in refused(line)


def test_every_study_has_claims_and_so_have_its_parts():
    for module in study.STUDIES.values():
        whole = study_of(module)
        for each in (whole, *map(study_of, whole.parts.values())):
            assert {claim.key for claim in each.claims}
