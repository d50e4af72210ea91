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


def test_a_bank_that_begins_in_motion_continues_from_there():
    wire, hypotheses = bank_of(ratio=0.8)
    warm = wire.begin(0.12)
    estimate = PowerObserver(wire=wire).found(warm.angle, np.sqrt(0.12))
    bank = hypotheses.begin(estimate, moving=True)
    np.testing.assert_allclose(bank.power, 0.12)
    assert bank.branch[0] == pytest.approx(warm.angle)
    assert bank.branch[-1] == pytest.approx(wire.operator.range[1])


def test_the_final_angle_is_that_at_which_the_heat_balances():
    wire, hypotheses = bank_of(ratio=0.8)
    bank = hypotheses.begin(PowerObserver(wire=wire).found(), moving=False)
    final = hypotheses.final(bank, 0.0, 0.4)
    low, top = wire.operator.range
    resistance = hypotheses.resistance
    # A hotter wire has more resistance: the same ambient takes less of its power away.
    ambient = hypotheses.ambient / (resistance + (1.0 - resistance) * (final - low) / (top - low))
    grid = np.linspace(*wire.operator.levels[[0, -1]], bank.branch.size)
    start = grid[np.flatnonzero(bank.branch - bank.branch[0] < 0.5)[-1]]
    power = start + hypotheses.steeper * (ambient + 0.16 / hypotheses.cooling - start)
    some = (hypotheses.ambient < 0.0) & (final > 3.0) & (final < top - 1.0)
    assert some.sum() > 500
    np.testing.assert_allclose(final[some], np.interp(power, grid, bank.branch)[some], atol=0.02)


def test_an_error_of_the_branch_feeds_back_in_the_cold():
    wire, hypotheses = bank_of(ratio=0.7)
    bank = hypotheses.begin(PowerObserver(wire=wire).found(), moving=False)
    final = hypotheses.final(bank, 0.0, 0.4)
    more = hypotheses.final(bank, 0.0, 0.4, beyond=0.5) - final
    between = (final > 15.0) & (final < 45.0)
    warm = between & (np.abs(hypotheses.ambient * RISE) < 2.0)
    cold = between & (hypotheses.ambient * RISE < -25.0)
    assert more[warm] == pytest.approx(0.5, abs=0.1)
    assert np.median(more[cold]) > 0.7
