import pytest

from minorloop.errors import InstrumentError
from minorloop.lab.drivers.scripted import SILENCE, Script


def test_a_script_gives_its_answers_and_knows_when_it_is_finished():
    script = Script([("VOLT 1", None), ("READ?", "1\n2"), ("LATE?", SILENCE)])
    script.send("VOLT 1")
    assert script.ask("READ?") == "1"
    assert not script.finished()
    assert script.read() == "2"
    with pytest.raises(InstrumentError, match="no answer"):
        script.ask("LATE?")
    assert script.finished()


def test_a_driver_that_sends_something_else_fails():
    with pytest.raises(AssertionError, match="the script has 'B'"):
        Script([("B", None)]).send("A")
    with pytest.raises(AssertionError, match="after the end"):
        Script([]).send("A")
