import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop.dynamics.cascade import Cascade
from minorloop.dynamics.linear import Linear
from minorloop.dynamics.trajectory import Trajectory
from minorloop.errors import ParameterError, SignalError
from minorloop.operators.polynomial import Polynomial
from minorloop.operators.preisach import Preisach

UP, DOWN = Linear.lags(3.0, 1.0), Linear.lags(8.0)
PLANE = Preisach(np.linspace(-1, 1, 5), np.tril(np.arange(1.0, 17).reshape(4, 4)))


def holds(values, seconds, interval=0.5):
    u = np.repeat(values, round(seconds / interval))
    return interval * np.arange(1, u.size + 1), np.asarray(u, dtype=float)


@given(st.lists(st.floats(-1, 1), min_size=1, max_size=6))
def test_settled_where_the_operator_says(values):
    t, u = holds(values, 150)
    ends = slice(299, None, 300)
    for joining in ("settled", "superposed"):
        y = Trajectory(PLANE, UP, DOWN).simulate(t, u, before=0.0, joining=joining)
        wanted = PLANE.simulate([0.0, *values])[1:]
        np.testing.assert_allclose(y[ends], wanted, atol=1e-6 * np.ptp(PLANE.range))


@given(st.lists(st.floats(-1, 1), min_size=1, max_size=8), st.floats(1, 6))
def test_superposed_steps_of_one_response_are_the_cascade(values, seconds):
    t, u = holds(values, seconds)
    joined = Trajectory(PLANE, UP).simulate(t, u, before=0.3, joining="superposed")
    cascade = Cascade(PLANE, UP).simulate(t, u, before=0.3)
    np.testing.assert_allclose(joined, cascade, atol=1e-5)


def test_each_direction_has_its_response():
    line = Polynomial([0.0, 2.0], -1.0, 1.0)
    t, u = holds([0.0, 1.0, 0.0], 100)
    y = Trajectory(line, UP, DOWN).simulate(t, u) / 2
    since = 0.5 * np.arange(1, 201)
    np.testing.assert_allclose(y[200:400], UP.step_response(since), atol=1e-9)
    np.testing.assert_allclose(y[400:], 1 - DOWN.step_response(since), atol=1e-5)
    one = Trajectory(line, UP).simulate(t, u) / 2
    np.testing.assert_allclose(one[400:], 1 - UP.step_response(since), atol=1e-6)


@pytest.mark.parametrize(
    "response", [Linear.lags(2.0, dc_gain=1.1), Linear([-1.0], [1.0, -1.0]), Linear([1], [1, 0])]
)
def test_refuses_responses_that_do_not_settle_at_one(response):
    with pytest.raises(ParameterError, match="give a stable one with DC gain 1"):
        Trajectory(PLANE, UP, response)


def test_refuses_signals_and_options():
    with pytest.raises(SignalError, match="does not increase"):
        Trajectory(PLANE, UP).simulate([0, 0], [0, 1])
    with pytest.raises(ParameterError, match="'settled', 'superposed'"):
        Trajectory(PLANE, UP).simulate([0, 1], [0, 1], joining="glued")
