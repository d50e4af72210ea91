import threading
from multiprocessing import Pipe

import pytest

from minorloop.errors import InstrumentError
from minorloop_head.console.bench_lines import RemoteWires, carry_out
from minorloop_head.console.channel import NewestPipe


class Lamp:
    def __init__(self):
        self.done = []

    def light(self, lights):
        self.done.append(list(lights))

    def flood(self, on):
        raise InstrumentError("the bench has no line 'pump'")


def test_lights_and_pump_are_switched_in_the_other_process_before_the_call_returns():
    ours, theirs = Pipe()
    lamp, wires = Lamp(), RemoteWires(NewestPipe(ours), 60.0)
    both = threading.Thread(target=lambda: [carry_out(lamp, theirs) for _ in range(2)])
    both.start()
    wires.light((True, False, True))
    assert lamp.done == [[True, False, True]]
    with pytest.raises(InstrumentError, match="were not switched: the bench has no line 'pump'"):
        wires.flood(True)
    both.join()


def test_a_plant_that_is_silent_or_gone_is_an_error_and_a_late_answer_is_forgotten():
    ours, theirs = Pipe()
    lamp, wires = Lamp(), RemoteWires(NewestPipe(ours), 0.0)
    with pytest.raises(InstrumentError, match="the plant does not answer"):
        wires.light((True,))
    carry_out(lamp, theirs)
    with pytest.raises(InstrumentError, match="the plant does not answer"):
        wires.light((False,))
    theirs.close()
    with pytest.raises(InstrumentError, match="the plant does not answer"):
        wires.light((True,))
    with pytest.raises(InstrumentError, match="the plant does not answer"):
        RemoteWires(NewestPipe(), 0.0).light((True,))
    assert lamp.done == [[True]]


def test_an_answer_that_comes_during_the_next_command_is_not_taken_for_its_answer():
    ours, theirs = Pipe()
    wires = RemoteWires(NewestPipe(ours), 0.0)
    with pytest.raises(InstrumentError, match="the plant does not answer"):
        wires.light((True,))

    def answer_both():
        for _ in range(2):
            theirs.recv_bytes()
        theirs.send_bytes(b"1 the lamp is stuck")
        theirs.send_bytes(b"2 ")

    plant = threading.Thread(target=answer_both)
    plant.start()
    wires._patience = 60.0
    wires.light((False,))
    plant.join()
