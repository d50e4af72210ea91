import shlex
from pathlib import Path

import pytest

from board_process import commands, simulated_board
from minorloop.lab.drivers.bench import Bench
from minorloop.lab.store import Store

pytestmark = pytest.mark.usefixtures("planned")

RUN = "run --actuator twin:ipmc,noise=0.05,specimen=3,seed=4 --plan plan.csv"


def test_from_a_plan_to_a_model(run, answer):
    status, out, err = run(f"{RUN} --store runs.sqlite")
    assert status == 0
    assert "11 of 11 levels measured" in out
    assert err.count("\n") == 11
    assert err.startswith("1/11  -1.2 V  ")
    assert run("runs export --store runs.sqlite --save points.csv")[0] == 0
    header, *rows = Path("points.csv").read_text().splitlines()
    assert header.startswith("index,voltage [V],curvature [1/m],sd [1/m]")
    assert [int(row.split(",")[0]) for row in rows] == list(range(11))
    assert run("runs export --store runs.sqlite")[1] == Path("points.csv").read_text()
    from_store = answer("identify runs.sqlite --law levels=4")
    from_csv = answer("identify points.csv --input voltage --output curvature --law levels=4")
    for key in ("nrmse_train", "samples", "range", "rank"):
        assert from_store[key] == from_csv[key]


ADAPTIVE = "run --actuator twin:ipmc,noise=0.05,specimen=2 --plan adaptive:hold=100,"


def test_an_adaptive_run_ends_with_a_score(run, refused):
    status, out, _ = run(f"{ADAPTIVE}holds=6 --store a.sqlite")
    assert status == 0
    assert "model from 6 holds; on 4 more, never fitted" in out
    assert "omit rows, skip and holdout" in refused("identify a.sqlite --holdout 0.3")


def test_one_channel_of_a_bench_with_several_is_run_and_resumed(run, tmp_path, monkeypatch):
    pytest.importorskip("pyvisa_py", reason="needs pyvisa-py: minorloop[instruments]")
    monkeypatch.setattr(Bench, "answer_time", lambda bench: 0.0)  # a busy machine answers late
    Path("y.csv").write_text("y voltage [V],hold [s]\n0,0.3\n100,0.3\n")
    Path("other.csv").write_text("voltage [V],hold [s]\n0,0.3\n")
    with simulated_board(tmp_path) as (address, _):
        begin = f"run --actuator {shlex.quote(address)} --holds interval=0.03"
        status, _, error = run(f"{begin} --plan other.csv --store no.sqlite")
        assert status == 2
        assert "the inputs 'x voltage [V]', 'y voltage [V]'; choose one with --input" in error
        status, _, _ = run(f"{begin} --plan y.csv --store a.sqlite")
        assert status == 0
        status, _, _ = run(f"{begin} --plan y.csv --store b.sqlite --output x")
        assert status == 0
        assert run("resume --store a.sqlite")[0] == 0
    with Store.open("a.sqlite") as store:
        assert (store.setup.input, store.setup.output) == ("y voltage [V]", "y [um]")
        assert store.finished
    with Store.open("b.sqlite") as store:
        assert store.setup.output == "x [um]"
    sent = [words for words in commands(tmp_path) if words[0] == "SET"]
    assert ["SET", "0", "100"] in sent
    assert not [words for words in sent if words[1] != "0"]
