import json
from pathlib import Path

import numpy as np
import pytest

from minorloop import AfterEffect, Preisach, Store, modelfile

MODEL = Preisach(np.linspace(-1.2, 1.2, 9), np.tril(np.full((8, 8), 0.24)))
TWIN = "--actuator twin:ipmc,specimen=1001,noise=0.02"
DRIVE = f"drive strip.json wanted.csv --target curvature {TWIN} --hold 60 --store d.sqlite"


@pytest.fixture(autouse=True)
def _strip(_somewhere):
    modelfile.save(MODEL, "strip.json", input="voltage [V]", output="curvature [1/m]")
    Path("wanted.csv").write_text("curvature [1/m]\n2\n-3\n")


def test_targets_and_what_was_achieved_are_printed_kept_and_reported(run, answer):
    status, out, _ = run(f"{DRIVE} --corrections 4 --within 0.2 --report d.html")
    assert status == 0
    for said in ("target", "achieved", "rms", "in saturation", "kept in d.sqlite"):
        assert said in out
    assert Path("d.html").read_text().count("<img") == 1
    again = answer("resume --store d.sqlite")
    assert (again["mode"], again["warnings"]) == ("finished", [])
    assert answer("identify d.sqlite --law levels=4,diagonal=reversible")["samples"] >= 3


def test_a_plan_of_inputs_is_what_run_takes(run, answer):
    assert run("invert strip.json wanted.csv --target curvature --hold 30 --save in.csv")[0] == 0
    # The first row saturates, as the inverse assumes.
    assert run(f"run {TWIN} --plan in.csv --store runs.sqlite")[0] == 0
    points = answer("runs export --store runs.sqlite")["columns"]
    np.testing.assert_allclose(points["voltage [V]"], [-1.2, *MODEL.invert([2.0, -3.0]).u])


def test_a_sensor_that_cannot_be_that_of_the_model_stops_before_the_first_target(run, answer):
    laser = DRIVE.replace("twin:ipmc", "twin:ipmc-laser").replace("0.02", "0.0028")
    status, _, err = run(f"{laser} --convert laser:20,15")
    assert status == 2
    assert "more than the model in saturation" in err
    assert "the geometry of a laser" in err
    assert "begin a new drive with another --store" in err
    assert "continue with" not in err
    assert "begin a new drive" in run("resume --store d.sqlite")[2]
    assert answer("runs export --store d.sqlite")["columns"]["voltage [V]"] == [-1.2]


@pytest.fixture
def creeping():
    """A model of the strip that creeps, in creep.json, and targets in wanted.csv."""
    weights = np.tril(np.random.default_rng(1000).uniform(0.05, 0.2, (4, 4)))
    plane = Preisach(np.linspace(-1.2, 1.2, 5), weights, diagonal="reversible")
    model = AfterEffect(plane, times=[30.0], creep=[-0.1 * weights])
    modelfile.save(model, "creep.json", input="voltage [V]", output="curvature [1/m]")
    np.savetxt("wanted.csv", [0.3, -0.4], header="curvature [1/m]", comments="")
    return model


def test_a_model_with_creep_delivers_its_targets_in_time(creeping, run, answer):
    line = (
        "drive creep.json wanted.csv --target curvature --actuator twin:ipmc --store d.sqlite "
        "--every 10 --hold 30"
    )
    run(f"{line} --report d.html")
    with Store.open("d.sqlite") as store:
        points = store.points()
    assert [point.held for point in points] == [150.0] + 6 * [10.0]
    # The inputs are those of the exact inverse at the end of each interval.
    start = creeping.settled.step("negative", -1.2)[1]
    wanted = np.repeat([0.3, -0.4], 3)
    expected = creeping.invert(10.0 * np.arange(1, 7), wanted, start, "clip").u
    np.testing.assert_allclose([point.input for point in points[1:]], expected, atol=1e-9)
    shown = json.loads(run("resume --store d.sqlite --json")[1])
    assert shown["mode"] == "finished"
    assert [one["tries"] for one in shown["targets"]] == [3, 3]
