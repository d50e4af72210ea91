"""A model with after-effect through the verbs."""

import numpy as np
import pytest

from minorloop import modelfile
from minorloop.operators.after_effect import AfterEffect
from minorloop.operators.preisach import Preisach

LEVELS = np.linspace(-1, 1, 5)
COLUMNS = "--input voltage --output length --time time"


@pytest.fixture
def creeping():
    """A model that creeps in the file creep.json, and a record of its holds in holds.csv."""
    weights = np.tril(np.random.default_rng(1000).uniform(0.2, 1, (4, 4)))
    plane = Preisach(LEVELS, weights, relay="unipolar", diagonal="reversible")
    model = AfterEffect(plane, times=[5.0], creep=[0.4 * weights])
    modelfile.save(model, "creep.json", input="voltage [V]", output="length [um]")
    u = np.repeat(np.random.default_rng(1001).uniform(-1, 1, 60), 10)
    t = np.arange(1.0, u.size + 1)
    y = model.simulate(t, u) + 1e-3 * np.random.default_rng(1002).normal(size=t.size)
    rows = np.column_stack([t, u, y])
    header = "time [s],voltage [V],length [um]"
    np.savetxt("holds.csv", rows, "%.17g", ",", header=header, comments="")
    return model


def test_identify_writes_model_and_report(creeping, run):
    line = f"identify holds.csv {COLUMNS} --law viscosity:creep=spectrum,levels=4"
    status, out, err = run(f"{line} --save m.json --report r.html")
    assert (status, err) == (0, "")
    assert "law" in out
    assert "spectrum" in out
    found = modelfile.load("m.json")
    t = np.arange(1.0, 31.0)
    u = np.repeat([0.7, -0.4, 0.2], 10)
    wanted = creeping.simulate(t, u)
    np.testing.assert_allclose(found.simulate(t, u), wanted, atol=0.01 * np.ptp(creeping.range))
    with open("r.html") as report:
        assert "time explains" in report.read()
    assert modelfile.read("m.json").provenance.scores["left_out_nrmse"] < 0.005


def test_holds_that_are_too_short_to_settle_still_reach_their_targets(creeping, run):
    status, _, _ = run("invert creep.json targets.csv --target length --hold 2 --save in.csv")
    assert status == 2
    status, _, _ = run(
        "invert creep.json targets.csv --target length --hold 2 --clip --save in.csv"
    )
    rows = np.genfromtxt("in.csv", delimiter=",", skip_header=1)
    u, hold, reachable = rows[:, 0], rows[:, 4], rows[1:, 3] == 1
    # The first row saturates for five time constants, as the model begins settled.
    assert hold.tolist() == [25.0, 2.0, 2.0, 2.0]
    y = creeping.simulate(2.0 * np.arange(1, 4), u[1:])
    assert reachable.sum() == 2
    np.testing.assert_allclose(y[reachable], np.array([0.3, 1.5])[reachable[:2]], atol=1e-9)


def spoilt(name, change):
    """The record with other rows, in another file."""
    rows = change(np.loadtxt("holds.csv", delimiter=",", skiprows=1))
    header = "time [s],voltage [V],length [um]"
    np.savetxt(name, rows, "%.17g", ",", header=header, comments="")
    return f"identify {name} {COLUMNS} --law viscosity:creep=spectrum,levels=4"


def test_the_row_of_a_time_that_repeats_counts_as_in_the_file(creeping, refused, run):
    """Comments, a row of units, and rows without an input from another logger count too."""
    rows = np.loadtxt("holds.csv", delimiter=",", skiprows=1)
    lines = [",".join(f"{value:.17g}" for value in row) for row in rows]
    lines = [line for row in lines for line in (row, f"{float(row.split(',')[0]) + 0.5},,")]
    time = lines[98].split(",")[0]
    lines[99:101] = (f"{time},{line.partition(',')[2]}" for line in lines[99:101])
    text = ["# of the bench", "time,voltage,length", "s,V,um", *lines, ""]
    with open("merged.csv", "w") as file:
        file.write("\n".join(text))
    line = f"identify merged.csv {COLUMNS} --law viscosity:creep=spectrum,levels=4"
    assert "of merged.csv has the same time in row 104 as before it" in refused(line)
    assert run(f"{line} --record rows=51:550")[0] == 0


def test_pauses_without_samples_show_creep_if_both_ends_are_read(creeping, answer, refused):
    place = np.arange(600) % 10
    line = spoilt("ends.csv", lambda rows: rows[(place == 0) | (place == 9)])
    found = answer(line)
    assert found["law"] == "spectrum"
    assert found["left_out_nrmse"] < 0.005
    assert "no input is held" in refused(spoilt("last.csv", lambda rows: rows[place == 9]))
