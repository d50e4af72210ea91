import pytest

from minorloop.errors import InstrumentError
from minorloop.lab.actuator import Channel
from minorloop.lab.drivers.bench import Bench
from minorloop.lab.drivers.scripted import SILENCE, Script
from minorloop.lab.drivers.template import Amplifier, Laser


class NoTime:
    def now(self):
        return 0.0

    def sleep(self, seconds):
        pass


def bench(amplifier, laser):
    return Bench(
        Amplifier(amplifier),
        Laser(laser),
        Channel("voltage", "V", -1.2, 1.2),
        Channel("displacement", "m", 0.0, 0.03),
        clock=NoTime(),
    )


def test_the_conversation_of_the_manual():
    amplifier = Script([("MV=250", "OK"), ("MV=0", "OK"), ("OPEN", "OK")])
    laser = Script([("MEASURE", "DIST=12.500mm STATUS=0")])
    plant = bench(amplifier, laser)
    assert plant.exchange(0.25) == pytest.approx(0.0125)
    plant.safe()
    assert amplifier.finished()
    assert laser.finished()


@pytest.mark.parametrize(
    "answer",
    ["DIST=12.500mm STATUS=3", "DIST=12.5", "garbage", "", SILENCE, "DIST=99.000mm STATUS=0"],
)
def test_a_reading_that_is_wrong_or_missing_makes_safe(answer):
    amplifier = Script([("MV=250", "OK"), ("MV=0", "OK"), ("OPEN", "OK")])
    with pytest.raises(InstrumentError):
        bench(amplifier, Script([("MEASURE", answer)])).exchange(0.25)
    assert amplifier.finished()


def test_an_amplifier_that_does_not_say_ok_is_not_believed():
    amplifier = Script([("MV=250", "BUSY"), ("MV=0", "OK"), ("OPEN", "OK")])
    with pytest.raises(InstrumentError, match="'BUSY' to 'MV=250'"):
        bench(amplifier, Script([])).exchange(0.25)
    assert amplifier.finished()


def test_a_voltage_that_the_amplifier_cannot_give_is_refused():
    amplifier = Script([("MV=0", "OK"), ("OPEN", "OK")])
    with pytest.raises(InstrumentError, match=r"whole millivolts, not 1\.49"):
        bench(amplifier, Script([])).exchange(0.00149)
    assert amplifier.finished()


def test_the_output_is_opened_even_if_the_voltage_is_not_taken_off():
    amplifier = Script([("MV=0", "BUSY"), ("OPEN", "OK")])
    with pytest.raises(InstrumentError, match="'BUSY'"):
        Amplifier(amplifier).safe()
    assert amplifier.finished()
