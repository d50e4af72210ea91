import re

import pytest

from minorloop.errors import InstrumentError, ParameterError
from minorloop.lab.drivers.scpi import ScpiMeter, ScpiSource, number
from minorloop.lab.drivers.scripted import SILENCE, Script


def test_a_source_is_switched_on_once_confirmed_and_made_safe():
    script = Script(
        [
            ("VOLT 0.5", None),
            ("CURR 0.1", None),
            ("OUTP ON", None),
            ("VOLT?", "+5.0000E-01"),
            ("SYST:ERR?", '+0,"No error"'),
            ("VOLT -0.25", None),
            ("VOLT?", "-0.25"),
            ("SYST:ERR?", "0"),
            ("VOLT 0", None),
            ("OUTP OFF", None),
            ("VOLT?", "0"),
            ("SYST:ERR?", "0"),
        ]
    )
    source = ScpiSource(script, on=["CURR 0.1", "OUTP ON"], confirm="VOLT?", errors="SYST:ERR?")
    source.set(0.5)
    source.set(-0.25)
    source.safe()
    assert script.finished()


def test_a_meter_is_scaled():
    meter = ScpiMeter(Script([("READ?", "12.5")]), scale=0.001, zero=2.5)
    assert meter.read() == pytest.approx(0.01)


def test_another_input_than_the_one_set_is_an_error():
    source = ScpiSource(Script([("VOLT 0.5", None), ("VOLT?", "0.4")]), confirm="VOLT?")
    with pytest.raises(InstrumentError, match=r"set to 0.5 and answers 0.4"):
        source.set(0.5)


def test_what_is_not_a_number_confirms_nothing():
    source = ScpiSource(Script([("VOLT 0.5", None), ("VOLT?", "nan")]), confirm="VOLT?")
    with pytest.raises(InstrumentError, match=r"set to 0.5 and answers nan"):
        source.set(0.5)


@pytest.mark.parametrize("said", ['-222,"Data out of range"', '05e-3,"x"', "0.5", "", "o"])
def test_an_error_of_the_instrument_is_an_error(said):
    script = Script([("VOLT 0.5", None), ("E?", said)])
    with pytest.raises(InstrumentError, match=re.escape(f"reports {said!r}")):
        ScpiSource(script, errors="E?").set(0.5)


@pytest.mark.parametrize("said", ["0", "+0", '0,"No error"', '00 "No error"'])
def test_zero_is_no_error(said):
    script = Script([("VOLT 0.5", None), ("E?", said)])
    ScpiSource(script, errors="E?").set(0.5)
    assert script.finished()


@pytest.mark.parametrize("answer", ["", "1,2", "1 V", "abc", "1_0", "٣", "0x10", "1e", SILENCE])
def test_what_is_no_number_is_no_reading(answer):
    with pytest.raises(InstrumentError):
        ScpiMeter(Script([("READ?", answer)])).read()


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_what_is_no_number_is_not_sent(value):
    with pytest.raises(InstrumentError, match="nothing was sent"):
        ScpiSource(Script([])).set(value)


@pytest.mark.parametrize(
    ("options", "questions"),
    [
        ({}, [("*OPC?", "1")]),
        ({"done": "*IDN?"}, [("*IDN?", "a supply")]),
        ({"done": None}, []),
        ({"errors": "E?"}, [("E?", "0")]),
        ({"confirm": "VOLT?", "rest": 0.1}, [("VOLT?", "0.1001")]),
        ({"confirm": "VOLT?", "safe_query": "OUTP?", "safe_answer": "0"}, [("OUTP?", "0")]),
        ({"safe_query": "OUTP?", "safe_answer": "0"}, [("OUTP?", "0"), ("*OPC?", "1")]),
        (
            {"errors": "E?", "safe_query": "OUTP?", "safe_answer": "0"},
            [("OUTP?", "0"), ("E?", "0")],
        ),
    ],
)
def test_a_source_says_that_it_is_safe(options, questions):
    script = Script([("OFF", None), *questions])
    source = ScpiSource(script, safe=["OFF"], **options)
    source.safe()
    assert script.finished()
    assert source.answers == bool(questions)


@pytest.mark.parametrize(
    ("options", "questions", "message"),
    [
        ({}, [("*OPC?", SILENCE)], "no answer"),
        ({"errors": "E?"}, [("E?", "-113"), ("E?", "-113"), ("E?", "0")], "reports '-113' after"),
        ({"confirm": "VOLT?"}, [("VOLT?", "0.5")], "answers 0.5 to 'VOLT\\?', not rest, 0"),
        ({"confirm": "VOLT?"}, [("VOLT?", "nan")], "answers nan"),
        ({"safe_query": "OUTP?", "safe_answer": "0"}, [("OUTP?", "1")], "answers '1' to 'OUTP"),
    ],
)
def test_a_source_that_does_not_say_so_is_not_taken_for_safe(options, questions, message):
    script = Script([("OFF", None), *questions])
    with pytest.raises(InstrumentError, match=message):
        ScpiSource(script, safe=["OFF"], **options).safe()
    assert script.finished()


def test_a_source_that_stays_off_is_an_error():
    script = Script([("VOLT 0.5", None), ("OUTP ON", None), ("OUTP?", "0")])
    source = ScpiSource(script, on=["OUTP ON"], safe_query="OUTP?", safe_answer="0")
    with pytest.raises(InstrumentError, match="was switched on and answers '0'"):
        source.set(0.5)
    assert script.finished()


def test_a_late_answer_is_not_taken_for_the_one_that_says_safe():
    script = Script([("OFF", None), *[("*OPC?", "1")] * 3])
    script.owed = 2
    ScpiSource(script, safe=["OFF"]).safe()
    assert script.finished()


@pytest.mark.parametrize("given", [{"safe_query": "OUTP?"}, {"safe_answer": "0"}])
def test_a_question_or_an_answer_alone_is_refused(given):
    with pytest.raises(ParameterError, match="give both or neither"):
        ScpiSource(Script([]), **given)


def test_making_safe_goes_on_after_a_line_that_fails():
    class Broken(Script):
        def send(self, text):
            super().send(text)
            if text == "VOLT 0":
                raise InstrumentError("no answer")

    script = Broken([("VOLT 0", None), ("OUTP OFF", None)])
    with pytest.raises(InstrumentError, match="no answer"):
        ScpiSource(script).safe()
    assert script.finished()


@pytest.mark.parametrize(
    ("line", "span", "value"),
    [
        ("VOLT {:.1g}", None, -1.15),
        ("VOLT {:.1g}", 2.4, -1.15),
        ("VOLT {:.3f}", 2.4, 0.0001),
        ("VOLT {0:.9g};CURR {0:.1f}", 2.4, 0.55),
        ("VOLT {0:.0f}", 1e4, 1.5),
    ],
)
def test_a_line_that_says_another_number_is_not_sent(line, span, value):
    with pytest.raises(ParameterError, match="another input; write more digits"):
        ScpiSource(Script([]), set=line, span=span).set(value)


@pytest.mark.parametrize(
    ("line", "span", "value", "sent"),
    [
        ("VOLT {:.1f}", 2.4, -0.3, "VOLT -0.3"),
        ("VOLT {:.6g}", 2.4, 1.1234564999, "VOLT 1.12346"),
        ("VOLT {0:+.3e}", None, 0.5, "VOLT +5.000e-01"),
        ("VOLT {!r}", None, 0.1 + 0.2, "VOLT 0.30000000000000004"),
        ("VOLT {:.9g}", None, 0.0, "VOLT 0"),
    ],
)
def test_a_line_that_says_the_number_is_sent(line, span, value, sent):
    script = Script([(sent, None), ("*OPC?", "1")])
    ScpiSource(script, set=line, span=span).set(value)
    assert script.finished()


@pytest.mark.parametrize("line", ["VOLT {:%}", "VOLT {:a<9}"])
def test_a_line_that_writes_no_plain_number_is_refused(line):
    with pytest.raises(ParameterError, match="which writes"):
        ScpiSource(Script([]), set=line)


@pytest.mark.parametrize(
    "wrong",
    [{"scale": 0.0}, {"scale": float("nan")}, {"zero": float("inf")}, {"zero": float("nan")}],
)
def test_a_meter_that_could_say_nothing_is_refused(wrong):
    (name,) = wrong
    with pytest.raises(ParameterError, match=f"{name} is "):
        ScpiMeter(Script([]), **wrong)


@pytest.mark.parametrize("line", ["VOLT", "VOLT {", "VOLT {x}", "VOLT {:q}", "VOLT {1}"])
def test_a_line_that_takes_no_number_is_refused(line):
    with pytest.raises(ParameterError, match="has no number"):
        ScpiSource(Script([]), set=line)


def test_a_source_without_safety_is_refused():
    with pytest.raises(ParameterError, match="makes the source safe"):
        ScpiSource(Script([]), safe=[])


def test_an_answer_is_one_number():
    assert number(" 1.5 ".strip(), "x") == 1.5
