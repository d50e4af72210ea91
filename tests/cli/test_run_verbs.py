import csv
import json
import os
import random
from pathlib import Path

import numpy as np
import pytest

from minorloop.cli._adaptive import warnings
from minorloop.cli.run import _unsettled
from minorloop.identification.adaptive import Adaptive
from offspring import started

KILLED_RUNS = int(os.environ.get("MINORLOOP_KILLED_RUNS", "5"))
PLAN = "plan decaying --low -1.2 --high 1.2 --levels 4 --hold 30"
RUN = "run --actuator twin:ipmc --plan plan.csv --noise 0.05 --specimen 3 --seed 4"


@pytest.fixture(autouse=True)
def _planned(_somewhere, run):
    assert run(f'{PLAN} --input "voltage [V]" --save plan.csv')[0] == 0


def _exported(name):
    with open(name, newline="") as file:
        return list(csv.reader(file))


def test_from_a_plan_to_a_model(run, answer):
    status, out, err = run(f"{RUN} --store runs.sqlite")
    assert status == 0
    assert "11 of 11 levels measured" in out
    assert err.count("\n") == 11
    assert err.startswith("1/11  -1.2 V  ")
    assert run("runs export --store runs.sqlite --save points.csv")[0] == 0
    header, *rows = _exported("points.csv")
    assert header[:4] == ["index", "voltage [V]", "curvature [1/m]", "sd [1/m]"]
    assert [int(row[0]) for row in rows] == list(range(11))
    assert run("runs export --store runs.sqlite")[1] == Path("points.csv").read_text()
    from_store = answer("identify runs.sqlite --levels 4")
    from_csv = answer("identify points.csv --input voltage --output curvature --levels 4")
    for key in ("nrmse_train", "samples", "range", "rank"):
        assert from_store[key] == from_csv[key]


def test_shows_what_is_in_a_store(run, answer):
    run(f"{RUN} --store runs.sqlite")
    out = run("runs list --store runs.sqlite")[1]
    assert "11 of 11" in out
    assert "finished" in out
    assert answer("runs list --store .")["runs"][0]["points"] == 11
    shown = run("runs show --store runs.sqlite")[1]
    assert "fresh, from point 0 on; finished" in shown
    assert "curvature [1/m] against voltage [V]" in shown
    found = answer("runs show --store runs.sqlite")
    assert found["actuator"] == "twin:ipmc"
    assert found["settled"] + found["extrapolated"] + found["unsettled"] == 11
    assert len(found["columns"]["voltage [V]"]) == 11
    assert answer("runs export --store runs.sqlite")["rows"] == 11


def test_a_finished_run_is_not_repeated(run, answer):
    run(f"{RUN} --store runs.sqlite")
    before = Path("runs.sqlite").read_bytes()
    assert "nothing was applied" in run("resume --store runs.sqlite")[1]
    assert answer("resume --store runs.sqlite")["way"] == "finished"
    assert Path("runs.sqlite").read_bytes() == before


@pytest.mark.parametrize(
    ("line", "says"),
    [
        (f"{RUN} --store good.csv", "good.csv exists already"),
        (f"{RUN} --store plan.csv", "plan.csv exists already"),
        (f"{RUN} --store no/runs.sqlite", "the folder no does not exist"),
        (f"{RUN.replace('plan.csv', 'good.csv')} --store a", "has no column 'hold [s]'"),
        (f"{RUN.replace('ipmc', 'moon')} --store a", "nothing at address 'twin:moon'"),
        (f"{RUN.replace('ipmc', 'fibre')} --store a", "voltage -1.2 V is beyond the limits"),
        (f"{RUN} --tolerance 0 --store a", "tolerance is 0"),
        (f"{RUN} --shortest 31 --store a", "31 s at least and 30 s at most"),
        ("resume --store good.csv", "it is not an experiment store, or damaged; run makes a"),
        ("resume --store none", "none does not exist"),
        ("runs list --store .", "there is no experiment store in ."),
        ("runs sing --store a", "there is no action 'sing'"),
        ("runs list --store a --save b", "--save goes with export"),
        ("identify good.csv --input voltage", "--output is missing"),
    ],
)
def test_refuses_in_one_line(line, says, refused):
    assert says in refused(line)
    assert not Path("a").exists()


def test_a_store_knows_its_columns(run, refused):
    run(f"{RUN} --store runs.sqlite")
    assert "leave --input and --output out" in refused("identify runs.sqlite --input voltage")
    assert "resume --store runs.sqlite goes on" in refused(f"{RUN} --store runs.sqlite")


def test_a_damaged_store_does_not_hide_the_others(run, answer):
    run(f"{RUN} --store runs.sqlite")
    content = bytearray(Path("runs.sqlite").read_bytes())
    content[len(content) // 2 : len(content) // 2 + 400] = bytes(400)
    Path("bad.sqlite").write_bytes(content)
    out = run("runs list --store .")[1]
    assert "11 of 11" in out
    assert "bad.sqlite" in out
    found = answer("runs list --store .")
    assert len(found["runs"]) == len(found["unusable"]) == 1


def _killed(line, points, delay):
    """Kill a process a moment after its log has told of so many points; whether it was."""
    with started(line) as (process, log):
        for _ in range(points):
            if not log.readline():
                break
        process.join(delay)
        process.kill()
        process.join()
        return process.exitcode != 0


def _killed_until_done(chance):
    """Run the plan and kill it at random instants until it ends; how often it was so far."""
    for kills in range(1, 41):
        begun = Path("runs.sqlite").exists()
        line = "resume --store runs.sqlite" if begun else f"{RUN} --store runs.sqlite"
        points = chance.choice([0, 1, 1, 2, 3])
        if not _killed(line, points, chance.uniform(0, 0.02 if points else 0.2)):
            break
        yield kills


@pytest.mark.parametrize("number", range(KILLED_RUNS))
def test_killed_again_and_again_it_ends_as_if_nothing_had_been(number, run):
    """SIGKILL at random instants loses nothing, repeats nothing and changes nothing."""
    chance = random.Random(number)
    run(f"{RUN} --store whole.sqlite")
    run("runs export --store whole.sqlite --save whole.csv")
    kills = 0
    while kills < 2:  # On a busy machine a run may end before it can be killed.
        Path("runs.sqlite").unlink(missing_ok=True)
        for kills in _killed_until_done(chance):  # noqa: B007
            if Path("runs.sqlite").exists():
                status, out, _ = run("runs export --store runs.sqlite --json")
                assert status == 0
                columns = json.loads(out)["columns"]
                assert columns["index"] == list(range(len(columns["index"])))
    run("resume --store runs.sqlite")
    run("runs export --store runs.sqlite --save points.csv")
    assert Path("points.csv").read_bytes() == Path("whole.csv").read_bytes()
    voltages = [float(row[1]) for row in _exported("points.csv")[1:]]
    np.testing.assert_array_equal(voltages, np.loadtxt("plan.csv", delimiter=",", skiprows=1)[:, 0])


ADAPTIVE = "run --actuator twin:ipmc --plan adaptive --noise 0.05 --specimen 2 --hold 100"


def test_an_adaptive_run_ends_with_a_score(run, answer):
    status, out, _ = run(f"{ADAPTIVE} --holds 6 --store a.sqlite")
    assert status == 0
    assert "model from 6 holds; on 4 more, never fitted" in out
    found = answer("runs show --store a.sqlite")
    assert found["points"] == 10
    assert found["finished"]
    again = answer("resume --store a.sqlite")
    assert again["way"] == "finished"
    assert again["validation"]["holds"] == 4
    assert again["validation"]["nrmse"] < 0.1


def test_an_adaptive_run_is_resumed_with_the_same_levels(run, answer):
    run(f"{ADAPTIVE} --holds 5 --store whole.sqlite")
    _killed(f"{ADAPTIVE} --holds 5 --store a.sqlite", 4, 0.0)
    run("resume --store a.sqlite")
    for key in ("columns", "finished"):
        one, other = (answer(f"runs show --store {name}.sqlite")[key] for name in ("whole", "a"))
        assert one == other


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ("--holds 2", "holds is 2; give a budget of 3 to 1000"),
        ("--holds 5 --hours 1", "one of them"),
        ("--hours 0.01", "0.01 h are 0 holds of 100 s"),
        ("--low -2", "voltage -2 V is beyond the limits"),
        ("--levels 0", "0 bands; give a whole number"),
    ],
)
def test_an_impossible_adaptive_run_is_refused(options, says, refused):
    assert says in refused(f"{ADAPTIVE} {options} --store a.sqlite")
    assert not Path("a.sqlite").exists()


def test_an_adaptive_store_is_identified_as_it_was_run(run, answer):
    run(f"{ADAPTIVE} --holds 6 --levels 12 --store own.sqlite")
    found = answer("identify own.sqlite")
    assert (found["samples"], found["held_out"], found["levels"]) == (6, 4, 12)
    assert found["prior"] == "gaussian"
    assert found["nrmse_holdout"] is not None
    assert answer("identify own.sqlite --levels 8")["levels"] == 8
    assert "samples held out" in run("identify own.sqlite")[1]


def test_an_adaptive_run_says_what_it_took_and_keeps_within_its_hours(run, answer):
    out = run(f"{ADAPTIVE} --hours 0.28 --store h.sqlite")[1]
    assert "7 levels measured; 3 kept for repetitions were not needed" in out
    assert answer("runs show --store h.sqlite")["levels"] == 10


def test_points_that_never_settled_are_warned_of():
    said = _unsettled({"points": 4, "unsettled": 2})
    assert "2 of 4 points had not settled" in said[0]
    assert _unsettled({"points": 4, "unsettled": 1}) == _unsettled({"points": 0}) == []


@pytest.mark.parametrize("option", ["--holds 5", "--hold 5", "--levels 9", "--least-gain 0.1"])
def test_options_of_adaptive_runs_are_refused_with_a_plan(option, refused):
    Path("p.csv").write_text("voltage [V],hold [s]\n1,200\n")
    said = refused(f"run --actuator twin:ipmc --plan p.csv {option} --store p.sqlite")
    assert f"{option.split()[0]} is for --plan adaptive" in said


def test_too_few_hours_and_own_holdouts_are_refused(run, refused):
    assert "give 0.278 h or more" in refused(f"{ADAPTIVE} --hours 0.2 --store a.sqlite")
    run(f"{ADAPTIVE} --holds 3 --store a.sqlite")
    assert "leave --rows and --holdout out" in refused("identify a.sqlite --holdout 0.3")
    assert "nosuch.sqlite does not exist" in refused("identify nosuch.sqlite")


@pytest.mark.parametrize(
    ("reads", "says"),
    [
        (lambda k, u: -u, "the output falls as the input rises"),
        (lambda k, u: u + 3.0 * (k >= 8), "changed at about hold 9"),
        (lambda k, u: u + 9.0 * (k >= 12) * (-1) ** k, "do not trust this model"),
        (lambda k, u: u, ""),
    ],
)
def test_what_is_wrong_with_a_run_is_said(reads, says):
    chooser = Adaptive(-1, 1, levels=10)
    u, y = [], []
    while (level := chooser.choose(u, y)) is not None:
        u.append(level)
        y.append(reads(len(y), level))
    said = warnings(chooser, u, y)
    assert says in " ".join(said)
    assert bool(said) == bool(says)
