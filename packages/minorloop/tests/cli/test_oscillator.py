"""An oscillator with hysteresis through the verbs."""

import json

import numpy as np
import pytest

from minorloop import modelfile
from minorloop.dynamics.oscillator import Oscillator
from minorloop.operators.differential import BoucWen

COLUMNS = "--input force --output displacement --time time"
PLANT = Oscillator(2.0, 10.0, 5e4, BoucWen(5e4, 800.0, 900.0))
ROUGH = Oscillator(3.0, 5.0, 3e4, BoucWen(7e4, 500.0, 1300.0))


@pytest.fixture(scope="module")
def rows():
    """Times, forces and displacements of two periods of a multisine of 256 samples."""
    rng = np.random.default_rng(1000)
    lines = np.zeros(129, dtype=complex)
    lines[2:50] = np.exp(2j * np.pi * rng.random(48))
    t = np.arange(512) / 750
    u = np.tile(2e3 * np.fft.irfft(lines), 2)
    y = np.tile(PLANT.simulate(t[:256], u[:256], periodic=True), 2)
    return np.column_stack([t, u, y + 2e-6 * rng.normal(size=t.size)])


@pytest.fixture
def record(rows):
    """Those rows in record.csv, and a rough start in rough.json."""
    header = "time [s],force [N],displacement [m]"
    np.savetxt("record.csv", rows, "%.17g", ",", header=header, comments="")
    modelfile.save(ROUGH, "rough.json")


def test_identify_finds_the_plant_and_simulate_moves_it(record, rows, run, answer):
    line = f"identify record.csv {COLUMNS} --law vibration:rough=rough.json,period=256"
    found = answer(f"{line} --save m.json --report r.html")
    assert found["parameters"]["mass"] == pytest.approx(2.0, rel=0.02)
    assert found["nrmse"] < 0.005
    assert found["noise"] == pytest.approx(2e-6 / np.sqrt(2), rel=0.1)
    assert modelfile.read("m.json").provenance.scores["nrmse"] == found["nrmse"]
    with open("r.html") as report:
        assert "Displacement, what the model misses" in report.read()
    status, out, err = run("simulate m.json record.csv --time time --save moved.csv --json")
    assert (status, err) == (0, "")
    assert json.loads(out)["samples"] == 512
    moved = np.loadtxt("moved.csv", delimiter=",", skiprows=1)[:, 2]
    np.testing.assert_array_equal(moved, modelfile.load("m.json").simulate(*rows[:, :2].T))
    run("simulate m.json record.csv --time time --record between=held --save held.csv")
    assert (np.loadtxt("held.csv", delimiter=",", skiprows=1)[:, 2] != moved).any()


def test_what_cannot_be_used_is_refused(record, refused):
    line = f"identify record.csv {COLUMNS} --law vibration:rough="
    assert "give unknown, or a model file" in refused(f"{line}unknow")
    assert "the law vibration has no 'levels'" in refused(f"{line}unknown,levels=4")
    assert "not a whole number of periods of 200" in refused(f"{line}unknown,period=200")
    assert "between is 'flat'" in refused(f"{line}unknown,between=flat")
    assert "--time is missing; --law vibration needs" in refused(
        f"{line.replace('--time time', '--time none')}unknown"
    )
    with open("record.csv") as file:
        text = file.read().replace("displacement [m]", "displacement [mm]")
    with open("mm.csv", "w") as file:
        file.write(text)
    assert "displacement is in mm" in refused(line.replace("record", "mm") + "unknown")
    assert "give unknown, or a model file" in refused(line.replace("record", "mm") + "unknow")


def test_an_oscillator_is_not_inverted_and_needs_times(record, refused):
    assert "needs times" in refused("simulate rough.json record.csv --input force")
    line = "invert rough.json record.csv --target displacement"
    assert "an oscillator, whose output depends" in refused(line)
    line = "simulate rough.json record.csv --input force --time time"
    assert "begins at rest" in refused(f"{line} --record start=positive")
    assert "grows without bound" in refused(unstable(line))


def unstable(line):
    """The same line with a model whose damping is negative."""
    modelfile.save(Oscillator(1.0, -500.0, 1.0, ROUGH.operator), "unstable.json")
    return line.replace("rough", "unstable")
