import math

import numpy as np

from minorloop.head.control.feedforward import Feedforward
from wires import made_up


def angles(law, wire, reference):
    state, plant, y = law.begin(), wire.begin(), []
    for each in reference:
        current, state = law.step(state, float(each), math.nan)
        plant = wire.step(plant, current**2, law.interval)
        y.append(plant.angle)
    return np.array(y)


def test_a_slow_target_is_followed_as_if_there_were_neither_lag_nor_hysteresis():
    wire = made_up()
    law = Feedforward(wire=wire)
    t = law.interval * np.arange(2500)
    target = 30.0 - 12.0 * np.cos(2 * np.pi * t / 50.0)
    error = angles(law, wire, target) - target
    assert np.abs(error[t > 15]).max() < 1.0


def test_the_sensor_is_not_read():
    law = Feedforward(wire=made_up())
    state = law.begin()
    assert law.step(state, 20.0, 50.0)[0] == law.step(state, 20.0, math.nan)[0]


def test_the_model_follows_the_current_that_was_achieved():
    wire = made_up()
    law = Feedforward(wire=wire)
    _, state = law.step(law.begin(), 40.0, math.nan)
    cut = type(state)(state.wire, 0.1)
    assert law.step(cut, 40.0, math.nan)[1].wire.power < law.step(state, 40.0, 0.0)[1].wire.power
