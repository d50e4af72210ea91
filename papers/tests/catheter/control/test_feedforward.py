import math

from minorloop_head.twins.wire import Wire
from papers.catheter.control.laws import Feedforward
from wires import angle, identified, made_up


def test_a_slow_target_is_followed_although_the_wire_lags_and_has_hysteresis():
    law, plant, squares = Feedforward(wire=identified().model), Wire(), []
    state = law.begin()
    for k in range(2500):
        target = 30.0 - 12.0 * math.cos(2 * math.pi * k * law.interval / 50.0)
        current, state = law.step(state, target, math.nan)
        plant.exchange(current)
        squares.append((angle(plant) - target) ** 2)
    rms = math.sqrt(sum(squares[375:]) / len(squares[375:]))
    assert rms < 2.0


def test_the_sensor_is_not_read():
    law = Feedforward(wire=made_up())
    state = law.begin()
    assert law.step(state, 20.0, 50.0)[0] == law.step(state, 20.0, math.nan)[0]
