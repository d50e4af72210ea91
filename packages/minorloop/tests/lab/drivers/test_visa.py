import json
import re
import sys
from contextlib import nullcontext
from pathlib import Path

import pytest

from minorloop import InstrumentError, MissingExtraError, ParameterError, connect
from minorloop.lab.drivers.device import DeviceChannel, DevicePlan
from minorloop.lab.drivers.link import VisaLink, number
from minorloop.lab.drivers.scripted import SILENCE, Script
from minorloop.lab.drivers.visa import Commands, ScpiMeter, ScpiSource, open_device

SIMULATION = Path(__file__).parent / "bench.yaml"
LIBRARY = f"{SIMULATION}@sim"
OUTPUT = {"safe_query": "OUTP?", "safe_answer": "0"}
simulated = pytest.mark.skipif(
    "not __import__('importlib').util.find_spec('pyvisa_sim')",
    reason="needs pyvisa and pyvisa-sim: minorloop[instruments]",
)


def source(script, span=None, rest=0.0, **commands):
    how = Commands(**{"safe": ["VOLT 0", "OUTP OFF"], **commands})
    return ScpiSource(script, how, rest=rest, span=span)


def refused(message, *errors):
    """Expect an error, or none without a message."""
    return pytest.raises(errors, match=message) if message else nullcontext()


def test_a_source_is_switched_on_once_confirmed_and_made_safe():
    confirmed = [("VOLT?", "+5.0000E-01"), ("SYST:ERR?", '+0,"No error"')]
    script = Script(
        [
            *[(line, None) for line in ("VOLT 0.5", "CURR 0.1", "OUTP ON")],
            *confirmed,
            ("VOLT -0.25", None),
            *[("VOLT?", "-0.25"), ("SYST:ERR?", "0")],
            *[("VOLT 0", None), ("OUTP OFF", None)],
            *[("VOLT?", "0"), ("SYST:ERR?", "0")],
        ]
    )
    one = source(script, on=["CURR 0.1", "OUTP ON"], confirm="VOLT?", errors="SYST:ERR?")
    one.set(0.5)
    one.set(-0.25)
    one.safe()
    assert script.finished()


@pytest.mark.parametrize(
    ("options", "questions", "message"),
    [
        ({"confirm": "VOLT?"}, [("VOLT?", "0.4")], r"set to 0.5 and answers 0.4"),
        ({"confirm": "VOLT?"}, [("VOLT?", "nan")], r"set to 0.5 and answers nan"),
        ({"on": ["ON"], **OUTPUT}, [("ON", None), ("OUTP?", "0")], "switched on and answers '0'"),
        *(
            ({"errors": "E?"}, [("E?", said)], re.escape(f"reports {said!r}"))
            for said in ('-222,"Data out of range"', '05e-3,"x"', "0.5", "", "o")
        ),
    ],
)
def test_an_input_that_is_not_confirmed_is_an_error(options, questions, message):
    script = Script([("VOLT 0.5", None), *questions])
    with pytest.raises(InstrumentError, match=message):
        source(script, **options).set(0.5)
    assert script.finished()


@pytest.mark.parametrize("answer", ["", "1,2", "1 V", "abc", "1_0", "٣", "0x10", "1e", SILENCE])
def test_an_answer_is_one_number(answer):
    assert ScpiMeter(Script([("READ?", "1.5")])).read() == number("1.5", "x") == 1.5
    with pytest.raises(InstrumentError):
        ScpiMeter(Script([("READ?", answer)])).read()


@pytest.mark.parametrize(
    ("options", "questions", "message"),
    [
        ({}, [("*OPC?", "1")], None),
        ({"done": "*IDN?"}, [("*IDN?", "a supply")], None),
        ({"done": None}, [], None),
        ({"errors": "E?"}, [("E?", "0")], None),
        ({"confirm": "VOLT?", "rest": 0.1}, [("VOLT?", "0.1001")], None),
        ({"confirm": "VOLT?", **OUTPUT}, [("OUTP?", "0")], None),
        (OUTPUT, [("OUTP?", "0"), ("*OPC?", "1")], None),
        ({"errors": "E?", **OUTPUT}, [("OUTP?", "0"), ("E?", "0")], None),
        ({}, [("*OPC?", SILENCE)], "no answer"),
        ({"errors": "E?"}, [("E?", "-113"), ("E?", "-113"), ("E?", "0")], "reports '-113' after"),
        ({"confirm": "VOLT?"}, [("VOLT?", "0.5")], "answers 0.5 to 'VOLT\\?', not rest, 0"),
        ({"confirm": "VOLT?"}, [("VOLT?", "nan")], "answers nan"),
        (OUTPUT, [("OUTP?", "1")], "answers '1' to 'OUTP"),
    ],
)
def test_a_source_is_safe_when_it_says_so_and_no_other_is_taken_for_safe(
    options, questions, message
):
    script = Script([("OFF", None), *questions])
    one = source(script, safe=["OFF"], **options)
    with refused(message, InstrumentError):
        one.safe()
    assert script.finished()
    assert one._commands.answers == bool(questions)


def test_a_late_answer_is_not_taken_for_the_one_that_says_safe():
    script = Script([("OFF", None), *[("*OPC?", "1")] * 3])
    script.owed = 2
    source(script, safe=["OFF"]).safe()
    assert script.finished()


def test_making_safe_goes_on_after_a_line_that_fails():
    class Broken(Script):
        def send(self, text):
            super().send(text)
            if text == "VOLT 0":
                raise InstrumentError("no answer")

    script = Broken([("VOLT 0", None), ("OUTP OFF", None)])
    with pytest.raises(InstrumentError, match="no answer"):
        source(script).safe()
    assert script.finished()


ANOTHER = "another input; write more digits|nothing was sent"


@pytest.mark.parametrize(
    ("line", "span", "value", "sent"),
    [
        ("VOLT {:.1f}", 2.4, -0.3, "VOLT -0.3"),
        ("VOLT {:.6g}", 2.4, 1.1234564999, "VOLT 1.12346"),
        ("VOLT {0:+.3e}", None, 0.5, "VOLT +5.000e-01"),
        ("VOLT {!r}", None, 0.1 + 0.2, "VOLT 0.30000000000000004"),
        ("VOLT {:.9g}", None, 0.0, "VOLT 0"),
        ("VOLT {:.1g}", None, -1.15, None),
        ("VOLT {:.1g}", 2.4, -1.15, None),
        ("VOLT {:.3f}", 2.4, 0.0001, None),
        ("VOLT {0:.9g};CURR {0:.1f}", 2.4, 0.55, None),
        ("VOLT {0:.0f}", 1e4, 1.5, None),
        *[("VOLT {:.9g}", None, value, None) for value in (float("nan"), float("inf"))],
    ],
)
def test_a_line_is_sent_if_it_says_the_number(line, span, value, sent):
    script = Script([(sent, None), ("*OPC?", "1")] if sent else [])
    with refused(None if sent else ANOTHER, ParameterError, InstrumentError):
        source(script, set=line, span=span).set(value)
    assert script.finished()


@pytest.mark.parametrize(
    ("commands", "sentence"),
    [
        ({"safe": []}, "makes the source safe"),
        ({"safe_query": "OUTP?"}, "give both or neither"),
        *[({"set": line}, "which writes") for line in ("VOLT {:%}", "VOLT {:a<9}")],
        *[
            ({"set": line}, "has no number")
            for line in ("VOLT", "VOLT {", "VOLT {x}", "VOLT {:q}", "VOLT {1}")
        ],
    ],
)
def test_commands_that_make_no_sense(commands, sentence):
    wire = DeviceChannel("voltage", {"safe": ["OFF"], **commands}, what="source")
    plan = DevicePlan("supply", {"resource": "ASRL1::INSTR"}, (wire,))
    with pytest.raises(ParameterError, match=f"source 'voltage' does not .*{sentence}"):
        open_device(plan)


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


@simulated
@pytest.mark.parametrize("library", [LIBRARY, "sim.yaml@sim"])
def test_a_simulated_bench_is_an_actuator(opened, tmp_path, library):
    (tmp_path / "sim.yaml").write_bytes(SIMULATION.read_bytes())  # beside the file
    plant = opened(library=library)
    record = plant.apply(0.5, 0.4, 0.2)
    assert list(record.y) == [0.0025, 0.0025]
    assert list(record.u) == [0.5, 0.5]
    assert plant.exchange(-0.25) == 0.0025
    assert plant.written(0.1234567891) == 0.123456789
    plant.safe()


@simulated
@pytest.mark.parametrize(
    ("meter", "says"),
    [
        ({"resource": "ASRL3::INSTR"}, r"ASRL3::INSTR answers '\?\?\?'"),
        ({"resource": "ASRL2::INSTR", "read": "NOTHING"}, r"ERROR|no answer"),
        ({"resource": "ASRL9::INSTR"}, "ASRL9::INSTR"),
        ({"resource": "nothing at all"}, "nothing at all cannot be opened"),
    ],
)
def test_a_meter_that_cannot_be_read_leaves_the_source_safe(opened, meter, says):
    with pytest.raises(InstrumentError, match=says):
        opened(meter=meter)
    assert float(VisaLink("ASRL1::INSTR", library=LIBRARY, timeout=0.2).ask("VOLT?")) == 0.0


@simulated
def test_an_answer_that_comes_after_it_was_given_up_is_not_taken_for_the_next():
    link = VisaLink("ASRL2::INSTR", library=LIBRARY, timeout=0.1)
    with pytest.raises(InstrumentError, match=r"no answer within 0.1 s"):
        link.read()
    link._resource.write("READ?")  # what it answers is on the line now
    assert link.ask("*IDN?") == "meter"
    link.close()


@simulated
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"meter": None}, "needs a source and a meter, or a board"),
        (
            {"source": {"resource": "ASRL1::INSTR", "safe": ["OFF"], "timeout": 1}},
            r"unknown field `timeout`; the fields there are name, .*, safe, .*, done$",
        ),
        ({"source": {"safe": ["OFF"]}}, "has no resource; give its VISA address"),
        ({"source": {"resource": "ASRL1::INSTR"}}, "missing required field `safe`"),
    ],
)
def test_files_that_describe_no_bench(opened, changes, message):
    with pytest.raises(ParameterError, match=message):
        opened(**changes)


@simulated
def test_without_pyvisa_the_extra_is_named(opened, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyvisa", None)
    with pytest.raises(MissingExtraError, match=r"minorloop\[instruments\]"):
        opened()
