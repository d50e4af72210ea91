from functools import partial

import numpy as np
import pytest

from minorloop import modelfile
from minorloop.dynamics.cascade import Cascade
from minorloop.errors import ParameterError, RecordError
from minorloop.lab import columns
from minorloop.operators.memory import Memory
from minorloop.operators.preisach import Preisach
from minorloop.page import lab_work

pytestmark = pytest.mark.usefixtures("without_pictures")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A user's folder with a record of a known model; the working folder during a test."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(2)
    u = np.concatenate([[0, 1], rng.uniform(0, 1, 300)])
    model = Preisach(np.linspace(0, 1, 6), np.tril(rng.uniform(size=(5, 5))))
    table = np.column_stack([u, model.simulate(u)])
    np.savetxt("run.csv", table, delimiter=",", header="u [V],y [um]", comments="")
    return str(tmp_path)


def result(folder, **options):
    reply = list(lab_work.identify_file(folder, "run.csv", "u", "y", lag=0, **options))
    return next(each["result"] for each in reply if "result" in each)


def _timed(late):
    """Write the record with times, its output late by some rows."""
    u, y = np.loadtxt("run.csv", delimiter=",", skiprows=1).T
    u, y = np.repeat(u, 4), np.repeat(y, 4)
    y = np.concatenate([np.full(late, y[0]), y[: y.size - late]])
    table = np.column_stack([0.01 * np.arange(u.size), u, y])
    np.savetxt("run.csv", table, delimiter=",", header="t [s],u [V],y [um]", comments="")


def test_dynamics_are_identified_shown_and_kept(folder, monkeypatch):
    quick = partial(lab_work.Dynamics, first="operator", poles=0, creep=False)
    monkeypatch.setattr(lab_work, "Dynamics", quick)
    _timed(3)
    found = result(folder, time="t", levels=3, dynamics="auto", last=160)
    rows = dict(found["table"])
    assert rows["order"].startswith("operator")
    assert rows["dead time"].endswith(" s")
    assert rows["samples fitted"] == "160"
    known = modelfile.read("model.json")
    assert isinstance(known.model, Cascade)
    assert 0.01 < known.model.linear.delay < 0.05
    (moved,) = lab_work.move(folder, None, 1.0)
    assert moved["y"] == pytest.approx(known.operator.range[1], rel=0.05)
    for options, said in (
        ({}, "name the column of time"),
        ({"time": "t", "curves": "u"}, "cannot be combined with dynamics"),
    ):
        with pytest.raises(ParameterError, match=said):
            result(folder, levels=5, dynamics="auto", **options)


def test_a_wide_file_is_read_once_and_too_wide_a_one_is_refused(folder, tmp_path, monkeypatch):
    opened = []
    table = columns.opened
    monkeypatch.setattr(columns, "opened", lambda *a, **b: opened.append(a) or table(*a, **b))
    names = [f"c{k}" for k in range(100)]
    lines = [",".join(names), *(",".join(["1", "2"] * 50) for _ in range(3))]
    (tmp_path / "wide.csv").write_text("\n".join(lines))
    (reply,) = lab_work.look(folder, "wide.csv")
    assert len(reply["columns"]) == 100
    assert len(opened) <= 2
    (tmp_path / "wider.csv").write_text(",".join(f"c{k}" for k in range(3000)) + "\n")
    with pytest.raises(RecordError, match=r"3000 columns or more; give at most 100"):
        list(lab_work.look(folder, "wider.csv"))


def test_options_are_those_of_the_command_line(folder, tmp_path):
    u, y = np.loadtxt("run.csv", delimiter=",", skiprows=1).T
    t = 10.0 * np.arange(u.size)
    t[200:] += 500.0
    names = np.repeat([f"wire {name}" for name in "abcdef"], 60)[: u.size]
    rows = [f"{a},{b},{c},{d}" for a, b, c, d in zip(t, u, y, names, strict=True)]
    (tmp_path / "run.csv").write_text("\n".join(["t [ms],u [V],y [um],wire", *rows]))
    (described,) = lab_work.look(folder, "run.csv")
    assert described["time"] == "t [ms]"
    found = result(folder, levels=5, time="t [ms]", first=10, last=300, skip=3, holdout=0.2)
    assert found["clock"] == "t [s]"
    assert found["rows"][0] == pytest.approx(0.1)
    assert found["rows"][0] < found["held"] < found["rows"][-1]
    assert "1 gap in column 't [ms]'" in found["advice"][0]
    table = dict(found["table"])
    assert table["rows skipped"] == "3"
    assert table["error on held-out data"].endswith("% of its range")
    found = result(folder, levels=5, curves="wire", groups="wire", start_of_curve="as-left")
    assert "error on left-out groups" in dict(found["table"])
    with pytest.raises(ParameterError, match="rows 5 to 5 are given, and there are 302"):
        result(folder, levels=5, first=5, last=5)


def test_memory_goes_in_and_out(folder):
    result(folder, levels=5)
    memory, inputs = None, [0.9, 0.2, 0.6, 0.95]
    for u in inputs:
        (reply,) = lab_work.move(folder, memory, u)
        memory = reply["memory"]
    assert memory == list(Memory.after(inputs, low=0.0, high=1.0).extrema)
