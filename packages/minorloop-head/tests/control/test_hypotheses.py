import numpy as np
import pytest

from minorloop_head.control.hypotheses import Hypotheses
from minorloop_head.control.observer import PowerObserver
from wires import made_up

RISE = 676.0


def bank_of(ratio=1.0):
    wire = made_up()
    return wire, Hypotheses(wire=wire, rise=RISE, cold_resistance=ratio)


def followed(ambient, cooling, seconds=10.0):
    """A bank after the full heating of a cold wire in some surroundings."""
    wire, hypotheses = bank_of()
    estimate = PowerObserver(wire=wire).found()
    bank = hypotheses.begin(estimate, moving=False)
    plant = wire.moved(wire.begin(), ambient / RISE)
    for _ in range(round(seconds / 0.04)):
        plant = wire.step(plant, 0.16, 0.04, ambient=ambient / RISE, cooling=cooling)
        bank = hypotheses.step(bank, 0.4, plant.angle, 0.04)
    return hypotheses, bank, plant


def test_each_hypothesis_is_the_wire_in_its_surroundings():
    hypotheses, bank, _ = followed(0.0, 1.0, seconds=6.0)
    wire = made_up()
    alike = np.abs(hypotheses.resistance - 1.0) < 0.01  # the resistance of this wire is constant
    near = np.flatnonzero(alike & (np.abs(hypotheses.ambient * RISE + 10) < 31))
    assert near.size > 100
    for k in near[::20]:
        a, c = hypotheses.ambient[k], hypotheses.cooling[k]
        plant = wire.moved(wire.begin(), a)
        for _ in range(150):
            plant = wire.step(plant, 0.16, 0.04, ambient=a, cooling=c)
        assert bank.power[k] == pytest.approx(plant.power, abs=1.5e-3)
