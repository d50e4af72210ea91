import csv
from pathlib import Path

import numpy as np
import pytest

from minorloop import Plan, Preisach, Setup, Store, connect, modelfile
from minorloop.lab import sines
from minorloop.lab.run import run as carry_out

PLAN = "plan sines:samples=40,frequencies=0.2,1,amplitudes=0.7,1,preamble=-1.2"
RUN = "run --actuator twin:ipmc,specimen=1001 --plan sines.csv --store s.sqlite"


@pytest.fixture(autouse=True)
def _planned(_somewhere, run):
    assert run(f'{PLAN} --hold 5 --input "voltage [V]" --save sines.csv')[0] == 0
    model = Preisach(np.linspace(-1.2, 1.2, 9), np.tril(np.full((8, 8), 0.24)))
    modelfile.save(model, "strip.json", input="voltage [V]", output="curvature [1/m]")


@pytest.fixture
def store(run):
    status, out, err = run(RUN)
    assert status == 0
    assert "4 of 4 sines measured" in out
    assert err.count("\n") == 4
    assert err.startswith("1/4  0.2 Hz, 0.7 V  ")
    return "s.sqlite"


def test_from_a_plan_to_gain_and_phase(store, run, answer):
    status, out, _ = run(f"frequency {store} --model strip.json --save bode.csv --report b.html")
    assert "808 samples written" in run(f"runs export --store {store} --save log.csv")[1]
    assert status == 0
    assert "gains differ by" in out
    with open("bode.csv", newline="") as file:
        header, *rows = csv.reader(file)
    assert header[:4] == ["frequency [Hz]", "amplitude [V]", "gain [dB]", "phase [deg]"]
    known = [(float(row[0]), float(row[1])) for row in rows]
    assert known == [(0.2, 0.7), (0.2, 1.0), (1.0, 0.7), (1.0, 1.0)]
    found = answer(f"frequency {store} --model strip.json")
    np.testing.assert_allclose(np.ravel(found["gain_db"], "F"), [float(row[2]) for row in rows])
    assert found["gain_spread_before_db"] > 0
    for said in ("Bode plot", "from the output of the model", "data:image/svg"):
        assert said in Path("b.html").read_text()
    line = "frequency log.csv --input voltage --output curvature --model strip.json"
    again = answer(line)
    for key in ("gain_db", "phase_deg", "after_gain_db", "after_phase_deg"):
        np.testing.assert_allclose(again[key], found[key], rtol=1e-6)
    alone = answer(f"frequency {store}")
    assert (alone["after_gain_db"], alone["gain_spread_before_db"]) == (None, None)
    before = Path(store).read_bytes()
    assert "nothing was applied" in run(f"resume --store {store}")[1]
    known = answer(f"resume --store {store}")
    assert (known["sines"], known["planned"], known["mode"]) == (4, 4, "finished")
    assert Path(store).read_bytes() == before


class Streamed:
    """A twin to which inputs can only be given tick by tick, as to a bench."""

    def __init__(self, twin):
        self.apply, self.exchange, self.safe = twin.apply, twin.exchange, twin.safe
        self.inputs, self.outputs, self.tick = twin.inputs, twin.outputs, twin.tick


def test_held_inputs_stay_held_in_the_log_of_a_store(answer):
    planned = sines.grid([1.0], [0.7, 1.0], tick=0.05, preamble=-1.2, hold=5.0)
    plan = Plan.of_sines(planned, "voltage [V]")
    strip = Streamed(connect("twin:ipmc", specimen=1001, tick=0.05, substeps=8))
    setup = Setup("", "voltage [V]", "curvature [1/m]")
    with Store.create("held.sqlite", plan, setup) as store:
        carry_out(strip, plan, store)
    found = answer("frequency held.sqlite --model strip.json")
    answer("runs export --store held.sqlite --save log.csv")
    with open("log.csv", newline="") as file:
        header, *rows = csv.reader(file)
    assert header[-1] == "input held"
    assert {float(row[-1]) for row in rows} == {1.0}
    log = "--input voltage --output curvature --model strip.json"
    again = answer(f"frequency log.csv {log}")
    for key in ("gain_db", "phase_deg", "after_gain_db", "after_phase_deg"):
        np.testing.assert_allclose(again[key], found[key], rtol=1e-9)
    lines = [",".join(row[:-1]) for row in [header, *rows]]
    Path("linear.csv").write_text("\n".join(lines) + "\n")
    linear = answer(f"frequency linear.csv {log}")
    half = np.subtract(linear["phase_deg"], found["phase_deg"])
    np.testing.assert_allclose(half, 180 / 20, atol=1e-6)
