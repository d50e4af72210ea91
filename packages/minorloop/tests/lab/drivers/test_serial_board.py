from dataclasses import replace

import numpy as np
import pytest

from board_process import commands, simulated_board
from minorloop import InstrumentError, LimitError, ParameterError, SafetyError, connect
from minorloop.lab.drivers.device import DeviceChannel, DevicePlan
from minorloop.lab.drivers.scripted import Script
from minorloop.lab.drivers.serial_board import SerialBoard
from minorloop.lab.drivers.serial_line import write


def asked(*exchanges):
    """A script of questions and the words of their answers."""
    lines = []
    for sequence, (question, answer) in enumerate(exchanges, 1):
        kind = [] if answer[:1] == ["ERR"] else ["OK"]
        lines.append((write(sequence, *question.split()), write(sequence, *kind, *answer)))
    return Script(lines)


GREETING = (
    ("HELLO", ["minorloop", "3", "2", "2", "1", "1000"]),
    ("INPUT 0", ["V", "0", "0.4", "0"]),
    ("INPUT 1", ["V", "0", "0.4", "0"]),
    ("OUTPUT 0", ["um"]),
    ("OUTPUT 1", ["um"]),
)


def channel(name, unit="V", **known):
    return DeviceChannel(name, {}, unit, **known)


PLAN = DevicePlan(
    "board",
    {},
    (channel("x voltage", low=0.0, high=0.4), channel("y voltage", low=0.0, high=0.4)),
    (channel("x", "um"), channel("y", "um")),
    (DeviceChannel("lamp", {}, rest=1.0),),
)


def test_a_board_follows_targets_within_its_own_limits():
    script = asked(*GREETING, ("FOLLOW 20 30", ["20", "30"]), ("FOLLOW 90 30", ["ERR", "out"]))
    board = SerialBoard(script, PLAN)
    board.follow(np.array([20.0, 30.0]))
    with pytest.raises(InstrumentError, match="out"):
        board.follow(np.array([90.0, 30.0]))
    sources = (PLAN.sources[0], replace(PLAN.sources[1], high=0.3))
    narrow = SerialBoard(asked(*GREETING), replace(PLAN, sources=sources))
    with pytest.raises(ParameterError, match="y voltage has narrower limits in the bench"):
        narrow.follow(np.array([20.0, 30.0]))
    sources = (replace(PLAN.sources[0], rate=0.5), PLAN.sources[1])
    slow = SerialBoard(asked(*GREETING), replace(PLAN, sources=sources))
    with pytest.raises(ParameterError, match="x voltage has a rate limit"):
        slow.follow(np.array([20.0, 30.0]))


def test_a_board_of_protocol_2_has_one_input_and_one_output():
    script = asked(
        ("HELLO", ["minorloop", "2", "-1", "1", "30"]),
        ("SET 0.25", ["0.25"]),
        ("GET", ["7"]),
        ("SAFE", []),
    )
    board = SerialBoard(
        script, DevicePlan("b", {}, (channel("u", low=-1.0, high=1.0),), (channel("y"),))
    )
    board.set(np.array([0.25]))
    assert board.read() == 7.0
    board.safe()
    assert board.patience == 0.03


@pytest.mark.parametrize(
    ("answers", "plan", "sentence"),
    [
        ({"INPUT 0": "mV 0 400 0"}, PLAN, "x voltage is in V, and script has mV; correct"),
        ({"OUTPUT 1": "rad"}, PLAN, "y is in um, and script has rad"),
        ({"INPUT 1": "V 0 0.2 0"}, PLAN, r"may be \[0, 0.4\], and script allows \[0, 0.2\]"),
        ({"INPUT 0": "V 0 0.4 0.1"}, PLAN, "rests at 0, and script goes to 0.1 by itself"),
        ({"HELLO": "minorloop 3 1 2 0 1000"}, PLAN, "is input 1 of the board, which has 1"),
        ({"HELLO": "minorloop 4 1 2 0 1000"}, PLAN, "another protocol than minorloop 2 or 3"),
    ],
)
def test_a_board_that_is_not_that_of_the_file_is_refused(answers, plan, sentence):
    greeting = [(question, answers.get(question, " ".join(a)).split()) for question, a in GREETING]
    with pytest.raises((ParameterError, InstrumentError), match=sentence):
        SerialBoard(asked(*greeting), plan)


@pytest.mark.parametrize(
    ("exchange", "act", "sentence"),
    [
        (("SET 0.1 0.2", ["0.1"]), lambda b: b.set(np.array([0.1, 0.2])), "with 1 word"),
        (("GET", ["1", "2mm"]), lambda b: b.read(), "'2mm', which is not a number"),
        (("LINE 0 0", ["1"]), lambda b: b.switch({0: False}), "to switch line 0 to 0"),
    ],
)
def test_answers_that_cannot_be_used(exchange, act, sentence):
    board = SerialBoard(asked(*GREETING, exchange), PLAN)
    with pytest.raises(InstrumentError, match=sentence):
        act(board)


def test_a_board_that_is_not_at_its_safe_inputs_is_not_safe_and_its_lines_are_switched_still():
    script = asked(*GREETING, ("SAFE", ["0", "0.1"]), ("LINE 0 1", ["1"]))
    with pytest.raises(InstrumentError, match=r"answers '0 0.1', not its safe inputs \[0.0, 0.0\]"):
        SerialBoard(script, PLAN).safe()
    assert script.finished()


# The simulated board of the examples, which knows the protocol only.


@pytest.fixture
def pyvisa():
    pytest.importorskip("pyvisa_py", reason="needs pyvisa-py: minorloop[instruments]")


@pytest.mark.usefixtures("pyvisa")
def test_a_stage_on_a_board_is_an_actuator_that_is_refused_what_is_beyond_its_limits(tmp_path):
    with simulated_board(tmp_path) as (address, _):
        plant = connect(address)
        assert (plant.serial, plant.lines) == ("S-01", ("lamp", "valve"))
        record = plant.apply([100.0, 25.0], 0.3, 0.1)
        assert record.y.shape == record.u.shape == (2, len(record))
        assert record.y[0, -1] > record.y[0, 0]
        plant.switch({"valve": True})
        for wrong in ([125.0, 0.0], [0.0, -1.0], [np.nan, 0.0], [np.inf, 0.0], [1e308, 0.0]):
            for act in (plant.exchange, plant.at_once, lambda u: plant.apply(u, 0.1, 0.05)):
                with pytest.raises(LimitError):
                    act(wrong)
        with pytest.raises(LimitError):
            plant._source.set([125.0, 0.0])
        with pytest.raises(InstrumentError, match="cannot be opened: another program uses it"):
            connect(address)
        plant.safe()
        plant.close()
        said = commands(tmp_path)
    assert ["LINE", "3", "1"] in said
    assert said[-3:] == [["SAFE"], ["LINE", "0", "1"], ["LINE", "3", "0"]]
    sent = np.array([words[1:] for words in said if words[0] == "SET"], float)
    assert (sent >= 0).all()
    assert (sent <= 100).all()
    assert ["BEYOND"] not in [words[:1] for words in said]


@pytest.mark.usefixtures("pyvisa")
@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--half", "6"], "gave no (whole )?answer within 0.1 s|no valid answer"),
        (["--unit", "mV"], "x voltage is in V, and ASRL.* has mV"),
    ],
)
def test_a_board_that_cannot_be_used_is_named_in_one_sentence(tmp_path, options, sentence):
    with (
        simulated_board(tmp_path, *options) as (address, _),
        pytest.raises((InstrumentError, ParameterError), match=sentence) as found,
    ):
        connect(address)
    assert "\n" not in str(found.value)
    assert not [words for words in commands(tmp_path) if words[0] == "SET"]


@pytest.mark.usefixtures("pyvisa")
def test_a_board_that_is_pulled_is_missing_and_says_that_it_may_be_on(tmp_path):
    with simulated_board(tmp_path) as (address, process):
        plant = connect(address)
        plant.at_once([25.0, 25.0])
        process.kill()
        process.wait()
        (tmp_path / "board").unlink()  # the number of its terminal may be given to another
        with pytest.raises(SafetyError, match=r"may still be on, switch it off by hand: in 0\.5 s"):
            plant.at_once([25.0, 25.0])
        plant.close()
        with pytest.raises(InstrumentError, match="cannot be opened") as found:
            connect(address)
        assert str(found.value).count("Errno") == 1  # libraries repeat the error inside theirs
