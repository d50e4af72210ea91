import math

import numpy as np
import pytest

from minorloop import InstrumentError
from minorloop.lab.drivers.bench import Bench
from minorloop_head.procedures.actuator_plant import ActuatorPlant, BenchTip
from minorloop_head.procedures.values import Plant, Tip
from minorloop_head.twins.head import Head
from simulated_plant import Clock

from .fakes import ANGLES, CURRENTS


class Wires:
    """Sources, sensors and lines that keep what they are told."""

    def __init__(self, angles=(45.0, 90.0), names=()):
        self.angles, self.names, self.done = np.array(angles), names, []

    def set(self, values):
        self.done.append(values.tolist())

    def read(self):
        return self.angles

    def safe(self):
        self.done.append("safe")

    def switch(self, values):
        self.done.append(values)


def bench(wires, inputs=CURRENTS, outputs=ANGLES):
    return Bench(wires, wires, inputs, outputs, tick=0.04, lines=wires, serial="H-07")


def test_a_bench_with_two_wires_is_a_plant_whose_catheter_stands_still():
    wires = Wires()
    plant = ActuatorPlant(bench(wires))
    assert isinstance(plant, Plant)
    y = plant.exchange(np.array([0.1, 0.2, 5e-3, 0.1]))
    assert y == pytest.approx([math.pi / 4, math.pi / 2, 0.0, 0.0])
    assert (plant.tick, plant.serial, plant.stance()) == (0.04, "H-07", ())
    plant.safe()
    assert wires.done == [[0.1, 0.2], "safe"]


def test_its_time_is_that_of_the_last_exchange_in_whole_ticks_and_a_twin_has_its_own():
    clock = Clock()
    clock.time = 10.0
    plant, twin = ActuatorPlant(bench(Wires()), clock), ActuatorPlant(Head(), clock)
    times = []
    for late in (0.0, 0.025, 0.025, 0.025, 0.3, 0.0):
        for one in (plant, twin):
            one.exchange(np.zeros(4))
        times.append(round(plant.time / plant.tick))
        clock.time += 0.04 + late
    assert times == [0, 1, 3, 4, 6, 14]
    assert twin.time is None
    assert ActuatorPlant(bench(Wires())).time is None


def test_lights_and_pump_are_the_lines_of_these_names():
    wires = Wires(names=("led 2", "fan", "pump", "led 1"))
    tip = BenchTip(ActuatorPlant(bench(wires)))
    assert isinstance(tip, Tip)
    tip.switch((True, False, True))
    tip.flood(True)
    assert wires.done == [{"led 1": True, "led 2": False}, {"pump": True}]
    for act in (tip.frame, lambda: tip.shots(1)):
        with pytest.raises(InstrumentError, match=r"no camera|no ultrasonic probe"):
            act()


def test_without_a_line_lights_stay_as_they_are_and_the_pipe_cannot_be_flooded():
    wires = Wires()
    tip = BenchTip(ActuatorPlant(bench(wires)))
    tip.switch((True, True, True))
    with pytest.raises(InstrumentError, match="no line 'pump'"):
        tip.flood(True)
    assert wires.done == []
