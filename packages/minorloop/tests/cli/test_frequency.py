import csv
import json
from pathlib import Path

import numpy as np
import pytest

from minorloop import modelfile
from minorloop.connect import connect
from minorloop.lab import sines
from minorloop.lab.drivers.bench import Bench
from minorloop.lab.plan import Plan
from minorloop.lab.run import run as carry_out
from minorloop.lab.store import Setup, Store
from minorloop.operators.preisach import Preisach

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


def test_without_a_model_there_is_no_operator(store, answer):
    found = answer(f"frequency {store}")
    assert found["after_gain_db"] is None
    assert found["gain_spread_before_db"] is None


def test_resume_knows_a_finished_run_of_sines(store, run, answer):
    assert "nothing was applied" in run(f"resume --store {store}")[1]
    known = answer(f"resume --store {store}")
    assert (known["sines"], known["planned"], known["mode"]) == (4, 4, "finished")


def test_a_plan_is_printed_as_json(answer):
    found = answer(f"{PLAN},tick=0.03,offset=0.1,settling=20,measured=3 --hold 5")
    assert [sine["measured"] for sine in found["sines"]] == [3] * 4
    assert found["sines"][3]["discarded"] == 20
    assert found["sines"][0]["offset"] == 0.1
    assert found["sines"][2]["samples"] == 33


def test_a_simulated_bench_measures_sines(run, refused, monkeypatch):
    pytest.importorskip("pyvisa_sim", reason="needs pyvisa and pyvisa-sim: minorloop[instruments]")
    simulated = Path(__file__).parent.parent / "lab/drivers/bench.yaml"
    Path("bench.yaml").write_bytes(simulated.read_bytes())
    bench = {
        "library": "bench.yaml@sim",
        "source": {
            "resource": "ASRL1::INSTR",
            "set": "VOLT {:.9f}",
            "safe": ["VOLT 0.000000000", "OUTP OFF"],
            "confirm": "VOLT?",
        },
        "meter": {"resource": "ASRL2::INSTR"},
        "input": {"name": "voltage", "unit": "V", "low": -1.2, "high": 1.2},
        "output": {"name": "tip", "unit": "mm"},
        "tick": 0.05,
        "timeout": 0.1,
    }
    monkeypatch.setattr(Bench, "answer_time", lambda bench: 0.0)
    monkeypatch.setattr(sines, "FEWEST_SAMPLES", 4)
    Path("bench.json").write_text(json.dumps(bench))
    Path("s.csv").write_text(
        "frequency [Hz],voltage amplitude [V],voltage offset [V],voltage preamble [V],"
        "preamble hold [s],discarded periods,measured periods,samples per period\n"
        "5,1,0,-1.2,0.05,0,2,4\n"
    )
    status, out, _ = run("run --actuator visa:bench.json --plan s.csv --store b.sqlite")
    assert status == 0
    assert "1 of 1 sines measured" in out
    # Its meter always reads the same.
    assert "the output does not oscillate at 5 Hz" in refused("frequency b.sqlite")


@pytest.mark.parametrize(
    ("line", "says"),
    [
        (f"{PLAN},measured=2.5", "measured periods are 2.5; give a whole number"),
        (PLAN.replace("=40", "=8"), "samples per period are 8"),
        (f"{PLAN},tick=0.1", "a tick of 0.1 s is too slow for 1 Hz"),
        (f"{PLAN} --low -1", "--low is not for a plan of sines"),
        (
            PLAN.replace("0.7,1", "0.7;1"),
            "amplitudes is '0.7;1'; give F1,F2,..., numbers separated",
        ),
        (PLAN.replace(",preamble=-1.2", ""), "plan sines needs preamble"),
        (f"{PLAN},cycles=3", "plan sines has no 'cycles'; it has frequencies"),
        (f"{RUN} --holds tolerance=1", "tolerance is for plans of holds"),
        ("frequency none.csv", "none.csv does not exist"),
        ("frequency good.csv --input voltage", "output (--output) is missing"),
        ("frequency good.csv --input voltage --output length", "good.csv has no column 'freq"),
    ],
)
def test_bad_input_is_one_sentence(line, says, refused):
    assert says in refused(line)


def test_an_amplitude_beyond_the_limits_leaves_no_store(run, refused):
    run(f'{PLAN.replace("0.7,1", "1.5")} --hold 5 --input "voltage [V]" --save sines.csv --force')
    assert "sine 1 (0.2 Hz): voltage -1.5 V is beyond the limits" in refused(RUN)
    assert not Path("s.sqlite").exists()


def test_a_store_of_sines_is_used_for_sines_only(store, refused, run):
    assert "evaluate it with minorloop frequency" in refused(f"identify {store}")
    assert "leave input, output and time out" in refused(f"frequency {store} --input u")
    modelfile.save(Preisach([0, 1], [[1.0]]), "amps.json", input="current [A]", output="y")
    assert "identify a model in V" in refused(f"frequency {store} --model amps.json")


def test_a_plan_that_cannot_be_evaluated_is_refused_before_the_first_sine(run, refused):
    header, *rows = Path("sines.csv").read_text().splitlines()
    Path("sines.csv").write_text("\n".join([header, rows[0], rows[3]]) + "\n")
    said = refused(RUN)
    assert "no frequency is measured at all of the 2 amplitudes (0.7, 1)" in said
    assert "give each frequency the same amplitudes" in said
    assert not Path("s.sqlite").exists()
    Path("sines.csv").write_text("\n".join([header, *rows[:3]]) + "\n")
    status, _, err = run(RUN)
    assert status == 0
    assert "note: when this run is evaluated, 1 Hz left out: not measured at every amp" in err


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
