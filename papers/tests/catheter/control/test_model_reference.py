import math
from dataclasses import replace

import numpy as np
import pytest

from papers.catheter.control.model_reference import ModelReference
from wires import made_up


def followed(law, plant, references):
    """Readings and angles of the reference model while a simulated wire is driven."""
    state, wire = law.begin(), plant.begin()
    readings, models = [], []
    for reference in references:
        current, state = law.step(state, reference, wire.angle)
        wire = plant.step(wire, current**2, law.interval)
        readings.append(wire.angle)
        models.append(state.model)
    return np.array(readings), np.array(models), state


def stairs(*targets, hold=8.0):
    return np.repeat(targets, round(hold / 0.04))


def test_a_lag_behind_the_operator_follows_the_reference_model_without_adaptation():
    wire = made_up(latent=0.0)
    law = ModelReference(wire=wire, adaptation=0.0, delay=0)
    state, plant, y = law.begin(), wire.operator.track(), 0.0
    keep = math.exp(-law.interval / wire.lag)
    for reference in stairs(20.0, 30.0, 25.0):
        current, state = law.step(state, reference, y)
        assert state.model == pytest.approx(y, abs=0.5)
        settled = plant.push(current**2)
        y = settled + (y - settled) * keep
    assert y == pytest.approx(25.0, abs=0.1)


def test_adaptation_removes_what_a_bias_of_the_plant_leaves():
    wire = made_up(latent=0.0)
    weaker = replace(wire, operator=wire.operator.__class__(
        wire.operator.levels, 0.8 * wire.operator.weights, relay="unipolar"
    ))  # fmt: skip
    wanted = stairs(20.0, 30.0, 20.0, 30.0, 20.0, 30.0, hold=12.0)
    errors = {}
    for adaptation in (0.0, 4.0):
        law = ModelReference(wire=wire, adaptation=adaptation)
        readings, _, _ = followed(law, weaker, wanted)
        errors[adaptation] = abs(readings[-1] - 30.0)
    assert errors[4.0] < 0.2 * errors[0.0]


@pytest.mark.parametrize("reading", [-5.0, 0.0, 80.0])
def test_weights_stay_bounded_while_the_plant_does_not_answer(reading):
    law = ModelReference(wire=made_up())
    state = law.begin()
    first = np.array(state.weights)
    for _ in range(2000):
        current, state = law.step(state, 40.0, reading)
        assert 0.0 <= current <= law.highest
    assert (np.abs(state.weights[:2]) <= 2.0 * np.abs(first[:2]) + 1e-9).all()
    assert abs(state.weights[2]) <= 60.0 + 1e-9


def test_a_missing_reading_adapts_nothing():
    law = ModelReference(wire=made_up())
    _, state = law.step(law.begin(), 20.0, 3.0)
    assert law.step(state, 20.0, math.nan)[1].weights == state.weights
