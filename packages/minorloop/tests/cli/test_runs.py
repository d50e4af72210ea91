from pathlib import Path

import pytest

from minorloop.cli import runs
from minorloop.lab.store import Store

pytestmark = pytest.mark.usefixtures("planned")

PLAN = "plan decaying --low -1.2 --high 1.2 --levels 4 --hold 30"
RUN = "run --actuator twin:ipmc,noise=0.05,specimen=3,seed=4 --plan plan.csv"


def test_a_damaged_store_does_not_hide_the_others(run, answer):
    run(f"{RUN} --store runs.sqlite")
    content = Path("runs.sqlite").read_bytes()
    Path("bad.sqlite").write_bytes(content[: len(content) // 2])
    out = run("runs list --store .")[1]
    assert "11 of 11" in out
    assert "bad.sqlite" in out
    found = answer("runs list --store .")
    assert len(found["runs"]) == len(found["unusable"]) == 1


def test_a_run_that_goes_on_can_be_read_by_every_verb(run, answer):
    run(f"{RUN} --store runs.sqlite")
    with Store.open("runs.sqlite", write=True) as store:
        begun = store.session("restored")
        begun.__enter__()
        assert answer("runs list --store .")["runs"][0]["running"]
        shown = answer("runs show --store runs.sqlite")
        assert (shown["running"], shown["points"], shown["left_s"]) == (True, 11, None)
        assert "still running" in run("runs show --store runs.sqlite")[1]
        assert "the run continues" in run("runs export --store runs.sqlite --save p.csv")[1]
        status, out, _ = run("identify runs.sqlite --law levels=4")
        assert status == 0
        assert "the run continues, and has 11 of 11 points so far" in " ".join(out.split())
    assert not answer("runs show --store runs.sqlite")["running"]
    assert "killed" in run("runs show --store runs.sqlite")[1]
    assert "the run continues" not in run("identify runs.sqlite --law levels=4")[1]


def test_a_run_is_followed_until_it_ends(run, monkeypatch):
    run(f"{RUN} --store whole.sqlite")
    with Store.open("whole.sqlite") as whole:
        points, traces = whole.points(), [whole.trace(k) for k in range(len(whole))]
        store = Store.create("runs.sqlite", whole.plan, whole.setup)
    begun = store.session("fresh")
    begun.__enter__()
    left = iter(zip(points, traces, strict=True))

    def measured(seconds):
        for _, trace in [*zip(range(4), left, strict=False)]:
            store.add(trace[0], *trace[1])
        if store.finished:
            store.close()

    monkeypatch.setattr(runs.time, "sleep", measured)
    status, out, _ = run("runs show --follow --store runs.sqlite")
    assert status == 0
    followed = [line for line in out.splitlines() if " of 11 points" in line]
    assert [line.split()[0] for line in followed] == ["0", "4", "8", "11"]
    assert "killed" in out
    assert not Path("runs.sqlite-wal").exists()


def test_where_most_holds_were_extrapolated_it_says_how_long_they_should_be(run, answer):
    run(f"{PLAN.replace('30', '100')} --input 'voltage [V]' --save long.csv")
    run(f"{RUN.replace('plan.csv', 'long.csv')} --store runs.sqlite")
    found = answer("runs show --store runs.sqlite")
    assert 2 * found["extrapolated"] > found["points"]
    assert 100 < found["enough_hold_s"] < 400
    assert "holds that would settle" in run("runs show --store runs.sqlite")[1]
    run(f"{RUN} --store short.sqlite")
    assert answer("runs show --store short.sqlite")["enough_hold_s"] is None
