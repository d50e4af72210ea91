from dataclasses import replace

import numpy as np
import pytest

import minorloop as ml
from fixed_options import Plane, identify
from minorloop import Cascade, Linear
from minorloop.identification.dynamic_result import DynamicIdentification, TriedDynamics

T = 0.01 * np.arange(200)
U = -np.cos(5 * T) * np.exp(-T)
PLANE = ml.Preisach(np.linspace(-1, 1, 5), np.tril(np.ones((4, 4))))
CHOSEN = TriedDynamics(1, 0, 0.01, True, 0.002, True)


def result(linear, first="operator", creep=None, off=0.0):
    model = Cascade(PLANE, linear, first, creep, 0.01)
    y = model.simulate(T, U) + off * np.sin(50 * T)
    static = identify(U, PLANE.simulate(U), Plane(4))
    fitted = T < 1.5
    return DynamicIdentification(
        model=model,
        static=static,
        t=T,
        u=U,
        y=y,
        fitted=fitted,
        held_out=~fitted,
        curves=static.curves,
        tried=(CHOSEN,),
    )


@pytest.mark.parametrize("near", [True, False])
def test_another_structure_may_be_too_close_to_call(near):
    contains = TriedDynamics(2, 0, 0.0, True, 0.001)
    other = TriedDynamics(0, 2, 0.0, False, 0.0021, near=near)
    found = replace(result(Linear.lags(0.2), "linear"), tried=(CHOSEN, contains, other))
    rows = dict(found.summary())
    assert rows["chosen"] == "1 pole, operator, creep: 0.200% of range on left-out pieces"
    assert any("of the dynamics is uncertain" in text for text in found.advice) == near


def test_advice_is_about_the_time_constants_too():
    assert any("sample faster" in text for text in result(Linear.lags(0.004)).advice)
    assert any("at least three time" in text for text in result(Linear.lags(1.0)).advice)
    static = result(Linear.lags())
    assert not static.dynamic
    assert "no better than with the operator alone" in static.advice[-1]
