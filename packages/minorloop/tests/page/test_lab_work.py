from functools import partial
from pathlib import Path

import numpy as np
import pytest

from minorloop import modelfile
from minorloop.dynamics.cascade import Cascade
from minorloop.errors import MinorloopError, ParameterError, RecordError
from minorloop.lab import columns
from minorloop.operators.after_effect import AfterEffect
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


def test_time_in_the_plane_is_identified_shown_and_kept(folder):
    rng = np.random.default_rng(1000)
    levels = np.linspace(0, 1, 4)
    weights = np.tril(rng.uniform(size=(3, 3)))
    truth = AfterEffect(
        Preisach(levels, weights, diagonal="reversible"), times=[2.0], creep=[0.3 * weights]
    )
    t, u = np.arange(300) * 0.5, np.repeat(rng.uniform(0, 1, 30), 10)
    table = np.column_stack([t, u, truth.simulate(t, u)])
    np.savetxt("run.csv", table, delimiter=",", header="t [s],u [V],y [um]", comments="")
    found = result(folder, time="t", levels=3, creep="spectrum")
    rows = dict(found["table"])
    assert rows["law"] == "spectrum"
    assert any(name.startswith("creep, ") for name in rows)
    assert (Path(folder) / "report.html").read_text().count("time explains") == 1
    known = modelfile.read("model.json")
    assert isinstance(known.model, AfterEffect)
    (moved,) = lab_work.move(folder, None, 1.0)
    assert moved["y"] == pytest.approx(known.model.range[1])
    (inverse,) = lab_work.invert(folder, [0.5 * sum(known.model.range)], "negative")
    assert inverse["worst"] < 1e-9
    for options, said in (
        ({}, "name the column of time"),
        ({"time": "t", "dynamics": "auto"}, "choose one"),
        ({"time": "t", "rate": True}, "which is one rate"),
    ):
        with pytest.raises(MinorloopError, match=said):
            result(folder, levels=3, creep="spectrum", **options)


def test_a_column_of_words_is_set_aside(folder, tmp_path):
    (tmp_path / "words.csv").write_text("who,u,y\nme,1,2\nyou,2,3\n")
    (reply,) = lab_work.look(folder, "words.csv")
    assert "every cell must be a number" in reply["columns"][0]["trouble"]
    assert "trouble" not in reply["columns"][1]


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
    assert table["error on held-out data"].endswith("% of range")
    found = result(folder, levels=5, curves="wire", groups="wire", start_of_curve="as-left")
    assert "error on left-out groups" in dict(found["table"])
    with pytest.raises(ParameterError, match="rows 5 to 5 are given, and there are 302"):
        result(folder, levels=5, first=5, last=5)


def test_the_loop_is_interrupted_where_nothing_was_measured(folder):
    u, y = np.loadtxt("run.csv", delimiter=",", skiprows=1).T
    cells = [f"{b}" if not 50 <= k < 60 else "" for k, b in enumerate(y)]
    rows = [f"{a},{b}" for a, b in zip(u, cells, strict=True)]
    Path("run.csv").write_text("\n".join(["u [V],y [um]", *rows]))
    loop = result(folder, levels=5)["loop"]
    assert loop["joined"]
    for name in ("y", "fit"):
        assert [k for k, value in enumerate(loop[name]) if value is None] == list(range(50, 60))


def test_memory_goes_in_and_out(folder):
    result(folder, levels=5)
    memory, inputs = None, [0.9, 0.2, 0.6, 0.95]
    for u in inputs:
        (reply,) = lab_work.move(folder, memory, u)
        memory = reply["memory"]
    assert memory == list(Memory.after(inputs, low=0.0, high=1.0).extrema)


def test_what_cannot_be_is_refused(folder, tmp_path):
    for levels in (0, 101, "many"):
        with pytest.raises(ParameterError, match="levels"):
            result(folder, levels=levels)
    with pytest.raises(ParameterError, match="targets"):
        list(lab_work.invert(folder, [], "negative"))
    with pytest.raises(ParameterError, match="no model yet"):
        list(lab_work.invert(str(tmp_path / "other"), [1.0], "negative"))
    (tmp_path / "one.csv").write_text("u\n1\n2\n")
    with pytest.raises(RecordError, match="one column"):
        list(lab_work.look(folder, "one.csv"))
    result(folder, levels=5)
    with pytest.raises(MinorloopError):
        list(lab_work.move(folder, [1.0, 0.0, 5.0], 0.5))


def test_warnings_go_with_the_model_and_its_inverse(folder, tmp_path):
    found = result(folder, levels=5)
    assert found["warnings"] == []
    (reply,) = lab_work.invert(folder, [0.5], "negative")
    assert reply["warnings"] == []
    table = np.loadtxt(tmp_path / "run.csv", delimiter=",", skiprows=1)
    table[100:160, 1] = table[100, 1]
    np.savetxt("run.csv", table, delimiter=",", header="u [V],y [um]", comments="")
    found = result(folder, levels=5)
    assert "the output is stuck" in found["warnings"][0]
    assert found["advice"][0] == found["warnings"][0]
    (reply,) = lab_work.invert(folder, [0.5], "negative")
    assert reply["warnings"] == found["warnings"]
