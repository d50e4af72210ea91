"""A run on instruments that fail in the middle loses nothing."""

import json
from pathlib import Path

import pytest

from minorloop import InstrumentError, Plan, Store
from minorloop.cli import main
from minorloop.lab.drivers.bench import Bench
from minorloop.lab.drivers.link import VisaLink
from minorloop.lab.drivers.visa import ScpiSource
from simulated_plant import Plant


@pytest.fixture
def simulated(tmp_path, monkeypatch):
    """A folder with a simulated bench and a plan of two levels; the line that runs it."""
    pytest.importorskip("pyvisa_sim", reason="needs pyvisa and pyvisa-sim: minorloop[instruments]")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bench.yaml").write_bytes((Path(__file__).parent / "bench.yaml").read_bytes())
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
        "tick": 0.2,
        "timeout": 0.1,
    }
    (tmp_path / "bench.json").write_text(json.dumps(bench))
    Plan([0.5, -0.5], 0.4, input="voltage [V]").to_csv("plan.csv")
    monkeypatch.setattr(Bench, "answer_time", lambda bench: 0.0)  # a busy machine answers late
    line = "run --actuator visa:bench.json --plan plan.csv --store s.sqlite --holds interval=0.04"
    return line.split()


def test_the_command_line_runs_on_a_simulated_bench(simulated, capsys):
    assert main([*simulated, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["points"] == 2


def test_a_plan_that_the_meter_cannot_keep_leaves_no_store(simulated, monkeypatch, capsys):
    monkeypatch.setattr(Bench, "answer_time", lambda bench: 0.11)
    assert main(simulated) == 2
    assert "the shortest hold possible is" in capsys.readouterr().err
    assert not Path("s.sqlite").exists()


def test_a_run_is_not_resumed_on_a_bench_that_was_changed(simulated, monkeypatch, capsys):
    def stopped(link, text):
        raise InstrumentError("enough")

    with monkeypatch.context() as patch:
        patch.setattr(VisaLink, "ask", failing_at("VOLT -0.5", stopped))
        assert main(simulated) == 2
    described = json.loads(Path("bench.json").read_text())
    changed = {**described, "meter": {**described["meter"], "scale": 2.0}}
    Path("bench.json").write_text(json.dumps(changed))
    capsys.readouterr()
    assert main(["resume", "--store", "s.sqlite"]) == 2
    said = capsys.readouterr().err
    assert "another bench: meter.scale was left out and is 2.0 now; restore the bench" in said
    with Store.open("s.sqlite") as store:
        assert len(store) == 1
        assert store.bench()["meter"] == described["meter"]
    same = {**described, "timeout": 0.2, "safe_within": 5, "rest": 0}
    Path("bench.json").write_text(json.dumps(same, indent=4))
    assert main(["resume", "--store", "s.sqlite"]) == 0


def failing_at(level, trouble):
    """In place of `VisaLink.ask`: trouble with readings while a level is on."""
    told, ask = [], VisaLink.ask

    def ask_or_fail(link, text):
        if text == "VOLT?":
            told.append(ask(link, text))
            return told[-1]
        at = f"VOLT {float(told[-1]):g}" if told else ""
        return trouble(link, text) if at == level else ask(link, text)

    return ask_or_fail


def test_a_meter_that_becomes_slow_is_warned_of(tmp_path, monkeypatch, capsys):
    class Tiring(Plant):
        def read(self):
            self.lag = 0.3 if self.value == 0.5 else 0.01
            return super().read()

    bench = Tiring().bench()
    bench.check()
    monkeypatch.setattr("minorloop.lab.drivers.visa.open_bench", lambda path: bench)
    monkeypatch.chdir(tmp_path)
    Plan([0.25, 0.5], 10.0, input="voltage [V]").to_csv("plan.csv")
    assert main(["run", "--actuator", "visa:x", "--plan", "plan.csv", "--store", "s.sqlite"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "read every 0.179 s, times known to 0.15 s" in said
    assert "the meter was slow at times: samples were up to 0.309 s apart, not 0.05 s" in said
    assert main(["runs", "show", "--store", "s.sqlite"]) == 0
    assert "read every 0.179 s" in capsys.readouterr().out


def stays_on(monkeypatch, after):
    """Let a source say that it is safe so many times, and then nothing."""
    times, safe = iter(range(100)), ScpiSource.safe

    def safe_or_not(source):
        safe(source)
        if next(times) >= after:
            raise InstrumentError("no answer")

    monkeypatch.setattr(ScpiSource, "safe", safe_or_not)


@pytest.mark.parametrize(
    ("trouble", "message"),
    [
        (InstrumentError("gave no answer"), "gave no answer"),
        (KeyboardInterrupt("SIGTERM"), "SIGTERM"),
        (ValueError("a defect"), "the driver failed: ValueError: a defect"),
    ],
)
def test_a_source_that_stays_on_does_not_hide_what_came_before_nor_the_other_way_round(
    trouble, message, simulated, monkeypatch, capsys
):
    described = json.loads(Path("bench.json").read_text())
    Path("bench.json").write_text(json.dumps({**described, "safe_within": 0.05}))

    def stop(link, text):
        raise trouble

    monkeypatch.setattr(VisaLink, "ask", failing_at("VOLT -0.5", stop))
    stays_on(monkeypatch, 1)
    assert main(simulated) == 3
    said = capsys.readouterr().err.splitlines()[-1]
    assert "may still be on, switch it off by hand" in said
    assert f"the error before: {message}" in said.replace("asked 'READ?', ", "")
    assert said.endswith("1 of 2 levels are kept; continue with minorloop resume --store s.sqlite")


def test_a_source_that_answers_nothing_is_said_at_the_beginning(simulated, capsys):
    described = json.loads(Path("bench.json").read_text())
    source = {**described["source"], "done": None}
    del source["confirm"]
    Path("bench.json").write_text(json.dumps({**described, "source": source}))
    assert main([*simulated, "--json"]) == 0
    shown = capsys.readouterr()
    assert shown.err.startswith("! ASRL1::INSTR answers nothing, so it cannot confirm")
    assert json.loads(shown.out)["warnings"][0].startswith("ASRL1::INSTR answers nothing")
