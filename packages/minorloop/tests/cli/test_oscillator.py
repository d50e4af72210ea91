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
