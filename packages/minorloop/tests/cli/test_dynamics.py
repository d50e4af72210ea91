"""A model with dynamics through the verbs."""

from pathlib import Path

import numpy as np
import pytest

from minorloop import modelfile
from minorloop.dynamics.cascade import Cascade
from minorloop.dynamics.creep import Creep
from minorloop.dynamics.linear import Linear
from minorloop.lab.records import Quantity

T = 0.01 * np.arange(300)
UNITS = {"input": "voltage [V]", "output": "length [um]"}


@pytest.fixture
def cascade(model):
    """A cascade in the file dynamic.json, and times with inputs and targets in moves.csv."""
    found = Cascade(model, Linear.lags(0.05, 0.02, delay=0.02))
    modelfile.save(found, "dynamic.json", **UNITS)
    u = -np.cos(2 * T)
    targets = model.simulate([-1.0])[0] + 4 * (1 - np.cos(2 * T))
    rows = np.column_stack([1e3 * T, u, targets])
    np.savetxt(
        "moves.csv", rows, "%.17g", ",", header="time [ms],voltage [V],length [um]", comments=""
    )
    return found


def columns(name):
    return np.loadtxt(name, delimiter=",", skiprows=1).T


def test_simulate_writes_the_times(cascade, run):
    status, _, err = run("simulate dynamic.json moves.csv --input voltage --time time --save o.csv")
    assert (status, err) == (0, "")
    t, u, y = columns("o.csv")
    np.testing.assert_allclose(t, T)
    np.testing.assert_allclose(y, cascade.simulate(T, u))


def test_invert_follows_targets_in_time(cascade, run):
    status, _, _ = run("invert dynamic.json moves.csv --target length --time time --save in.csv")
    assert status == 0
    t, u, targets, _, reachable = columns("in.csv")
    assert reachable.all()
    y = cascade.simulate(t, u, before=-1.0)
    assert np.abs(y - targets).max() < 0.03 * np.ptp(targets)


def test_the_inputs_of_a_model_with_a_lag_are_ahead_of_the_targets(cascade, model, run):
    names = (Quantity.parse(name) for name in UNITS.values())
    late = modelfile.ModelFile(model, *names, 20, modelfile.Provenance(), lag_seconds=0.2)
    modelfile.save(late, "late.json")
    line = "invert late.json moves.csv --target length --time time"
    status, _, err = run(f"{line} --save in.csv")
    assert status == 0
    assert "the inputs are 0.195 s ahead of the targets, as the output is late" in err
    assert "the targets still move there: add rows to follow them on" in err
    t, u, targets, _, _ = columns("in.csv")
    late = np.interp(t - 0.195, t, model.simulate(u))
    assert np.abs(late - targets)[25:].max() < 1e-3 * np.ptp(targets)
    assert "ahead" not in run("invert late.json moves.csv --target length")[2]


def test_targets_out_of_reach_in_time_are_those_of_the_file(cascade, run, refused):
    rows = np.column_stack([T, np.full(T.size, 6.0)])
    np.savetxt("jump.csv", rows, delimiter=",", header="time [s],length [um]", comments="")
    err = refused("invert dynamic.json jump.csv --target length --time time")
    assert "target 6 at index 0" in err
    assert "rests at" in err
    assert "--clip" in err


def test_without_times_invert_settles_at_the_targets(cascade, model, run):
    status, out, _ = run("invert dynamic.json moves.csv --target length --save in.csv")
    assert status == 0
    assert "each output settles at its target; --time follows targets in time" in out
    u, targets, _, _ = columns("in.csv")
    np.testing.assert_array_equal(u, model.invert(targets).u)


def test_c_says_that_creep_is_missing(model, run):
    creeping = Cascade(model, Linear.lags(0.05), creep=Creep([3.0], [0.1], 0.9))
    modelfile.save(creeping, "creeping.json", **UNITS)
    assert "this creep is not in the C" in run("export c creeping.json --out c --interval 0.01")[1]


def test_identify_finds_dynamics(cascade, run, answer, refused):
    t = 0.01 * np.arange(400)
    u = -np.cos(2 * t) * np.exp(-t / 6) * np.where(t < 2, 1, np.cos(25 * t))
    rows = np.column_stack([t, u, cascade.simulate(t, u)])
    np.savetxt("log.csv", rows, delimiter=",", header="time [s],voltage [V],length [um]",
               comments="")  # fmt: skip
    line = "identify log.csv --input voltage --output length --time time --law dynamics:levels=8"
    found = answer(f"{line} --save new.json --report new.html")
    assert found["dynamics"]["first"] == "operator"
    late = sum(found["dynamics"]["time_constants"]) + found["dynamics"]["dead_time"]
    assert late == pytest.approx(0.09, abs=0.01)
    assert found["nrmse_train"] < 5e-3
    assert modelfile.load("new.json").linear.order > 0
    assert "Dynamics that were compared" in Path("new.html").read_text()
    assert "lag cannot be combined with dynamics" in refused(f"{line} --law lag=2")
    assert "cannot be combined with dynamics" in refused(f"{line} --record groups=time")
