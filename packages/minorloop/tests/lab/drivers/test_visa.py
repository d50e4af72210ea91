import json
from pathlib import Path

import pytest

from minorloop.connect import connect
from minorloop.errors import InstrumentError, MissingExtraError, ParameterError
from minorloop.lab.drivers import visa
from minorloop.lab.drivers.link import VisaLink, _short

pytest.importorskip("pyvisa_sim", reason="needs pyvisa and pyvisa-sim: minorloop[instruments]")
SIMULATION = Path(__file__).parent / "bench.yaml"
LIBRARY = f"{SIMULATION}@sim"


def description(**changes):
    return {
        "library": LIBRARY,
        "source": {
            "resource": "ASRL1::INSTR",
            "set": "VOLT {:.9f}",
            "on": ["OUTP ON"],
            "safe": ["VOLT 0.000000000", "OUTP OFF"],
            "confirm": "VOLT?",
        },
        "meter": {"resource": "ASRL2::INSTR", "scale": 0.001},
        "input": {"name": "voltage", "unit": "V", "low": -1.2, "high": 1.2},
        "output": {"name": "displacement", "unit": "m", "low": 0.0, "high": 0.03},
        "tick": 0.2,
        "timeout": 0.2,
        **changes,
    }


@pytest.fixture
def opened(tmp_path):
    def opened(**changes):
        path = tmp_path / "bench.json"
        path.write_text(json.dumps(description(**changes)))
        return connect(f"visa:{path}")

    return opened


def supply():
    return VisaLink("ASRL1::INSTR", library=LIBRARY, timeout=0.2)


def test_a_simulated_bench_is_an_actuator(opened):
    plant = opened()
    record = plant.apply(0.5, 0.4, 0.2)
    assert list(record.y) == [0.0025, 0.0025]
    assert list(record.u) == [0.5, 0.5]
    assert plant.exchange(-0.25) == 0.0025
    plant.safe()


def test_a_meter_that_talks_nonsense_leaves_the_source_safe(opened):
    plant = opened()
    plant._meter._link = VisaLink("ASRL3::INSTR", library=LIBRARY, timeout=0.2)
    with pytest.raises(InstrumentError, match=r"ASRL3::INSTR answers '\?\?\?'"):
        plant.exchange(0.5)
    assert float(plant._source.source._link.ask("VOLT?")) == 0.0
    with pytest.raises(InstrumentError, match=r"'\?\?\?'"):
        opened(meter={"resource": "ASRL3::INSTR"})


def test_a_meter_that_does_not_answer_leaves_the_source_safe(opened):
    plant = opened()
    plant._meter._read = "NOTHING"
    with pytest.raises(InstrumentError, match=r"ERROR|no answer"):
        plant.exchange(0.5)
    assert float(plant._source.source._link.ask("VOLT?")) == 0.0


def test_silence_is_an_error_and_what_comes_late_is_forgotten():
    link = VisaLink("ASRL2::INSTR", library=LIBRARY, timeout=0.1)
    with pytest.raises(InstrumentError, match=r"no answer within 0.1 s"):
        link.read()
    assert link.ask("READ?") == "+2.500000E+00"
    link.close()


def test_an_answer_that_comes_after_it_was_given_up_is_not_taken_for_the_next():
    link = VisaLink("ASRL2::INSTR", library=LIBRARY, timeout=0.1)
    with pytest.raises(InstrumentError, match="no answer"):
        link.read()
    link._resource.write("READ?")  # what it answers is on the line now
    assert link.ask("*IDN?") == "meter"
    link.close()


def test_an_instrument_that_is_not_there(opened):
    with pytest.raises(InstrumentError, match="ASRL9::INSTR"):
        opened(meter={"resource": "ASRL9::INSTR"})
    with pytest.raises(InstrumentError, match="nothing at all cannot be opened"):
        opened(meter={"resource": "nothing at all"})


def test_what_a_library_says_is_not_cut_off_in_the_middle():
    said = _short(ValueError(f"{'Please install a library. ' * 8}\nNo module named 'gpib'"))
    assert said.endswith("No module named 'gpib'")
    assert _short(ValueError("x " * 300)).endswith(" ...")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"meter": None}, "needs a source and a meter, or a board"),
        ({"board": {"resource": "ASRL1::INSTR"}}, "a board and a source or a meter"),
        ({"colour": "red"}, "unknown field `colour`"),
        ({"colour": "red"}, r"the fields there are input, .*, timeout, safe_within$"),
        (
            {"source": {"resource": "ASRL1::INSTR", "safe": [], "timeout": 1}},
            r"`timeout` - at `\$.source`; the fields there are resource, safe, .*, done, baud$",
        ),
        ({"tick": "fast"}, "does not describe a bench"),
        ({"tick": -1}, "tick is -1"),
        ({"timeout": 0}, "timeout is 0"),
        ({"rest": 5.0}, "rest 5 is beyond"),
        ({"source": {"resource": "ASRL1::INSTR"}}, "missing required field `safe`"),
        ({"input": {"name": "voltage", "low": 1.0, "high": -1.0}}, "low below high"),
        ({"meter": {"resource": "ASRL2::INSTR", "scale": 0}}, "scale is 0.0"),
        ({"input": {"name": "voltage"}}, "missing required field `low`"),
    ],
)
def test_files_that_describe_no_bench(opened, changes, message):
    with pytest.raises(ParameterError, match=message):
        opened(**changes)


@pytest.mark.parametrize("text", ["", "{", "[]", "\0", "null"])
def test_files_that_are_not_json(tmp_path, text):
    (tmp_path / "bench.json").write_text(text)
    with pytest.raises(ParameterError, match="does not describe a bench"):
        visa.open_bench(tmp_path / "bench.json")


def test_a_simulation_is_named_relative_to_the_file(tmp_path):
    (tmp_path / "sim.yaml").write_bytes(SIMULATION.read_bytes())
    (tmp_path / "bench.json").write_text(json.dumps(description(library="sim.yaml@sim")))
    assert visa.open_bench(tmp_path / "bench.json").exchange(0.1) == 0.0025


def test_without_pyvisa_the_extra_is_named(opened, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pyvisa", None)
    with pytest.raises(MissingExtraError, match=r"minorloop\[instruments\]"):
        opened()
