import json
import os
import random
from pathlib import Path

import numpy as np
import pytest

from minorloop import Preisach, save
from offspring import started

KILLED_RUNS = int(os.environ.get("MINORLOOP_KILLED_RUNS", "2"))
TWIN = "--actuator twin:ipmc,noise=0.05,specimen=3,seed=4"
RUN = f"run {TWIN} --plan plan.csv"
WITHIN = "--corrections 2 --within 3 --hold 30"
DRIVE = f"drive strip.json wanted.csv --target curvature {TWIN} {WITHIN}"
WANTED = [3.0, -4.0, 6.0, 0.5, -7.0]


@pytest.fixture(autouse=True)
def _planned(planned):
    model = Preisach(np.linspace(-1.2, 1.2, 5), np.tril(np.full((4, 4), 0.9)))
    save(model, "strip.json", input="voltage [V]", output="curvature [1/m]")
    Path("wanted.csv").write_text("\n".join(["curvature [1/m]", *map(str, WANTED)]) + "\n")


def _killed(line, points, delay):
    """Kill a process soon after its log has this number of points; return whether it was killed."""
    with started(line) as (process, log):
        for _ in range(points):
            if not log.readline():
                break
        process.join(delay)
        process.kill()
        process.join()
        return process.exitcode != 0


def _killed_until_done(chance, begin):
    """Begin a run and kill it at random instants until it ends; how often it was so far."""
    for kills in range(1, 41):
        begun = Path("runs.sqlite").exists()
        line = "resume --store runs.sqlite" if begun else f"{begin} --store runs.sqlite"
        points = chance.choice([0, 1, 1, 2, 3])
        if not _killed(line, points, chance.uniform(0, 0.02 if points else 0.2)):
            break
        yield kills


@pytest.mark.parametrize("number", range(KILLED_RUNS))
def test_a_run_killed_many_times_ends_like_one_that_was_not(number, run, answer):
    """SIGKILL at random instants loses nothing, repeats nothing and changes nothing."""
    chance, begin = random.Random(number), (RUN, DRIVE)[number % 2]
    assert run(f"{begin} --store whole.sqlite")[0] == 0
    run("runs export --store whole.sqlite --save whole.csv")
    kills = 0
    while kills < 2:  # On a busy machine a run may end before it can be killed.
        Path("runs.sqlite").unlink(missing_ok=True)
        for kills in _killed_until_done(chance, begin):  # noqa: B007
            if Path("runs.sqlite").exists():
                status, out, _ = run("runs export --store runs.sqlite --json")
                assert status == 0
                columns = json.loads(out)["columns"]
                assert columns["index"] == list(range(len(columns["index"])))
    arrived = answer("resume --store runs.sqlite").get("targets", [])
    run("runs export --store runs.sqlite --save points.csv")
    assert Path("points.csv").read_bytes() == Path("whole.csv").read_bytes()
    voltages = np.loadtxt("points.csv", delimiter=",", skiprows=1, usecols=1)
    if begin == RUN:
        planned = np.loadtxt("plan.csv", delimiter=",", skiprows=1)[:, 0]
        np.testing.assert_array_equal(voltages, planned)
    else:
        assert [one["target"] for one in arrived] == WANTED
        assert sum(one["tries"] for one in arrived) == len(voltages) - 1
        assert max(abs(one["achieved"] - one["target"]) for one in arrived) <= 3
