import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from minorloop import Linear, Polynomial, Preisach
from minorloop.dynamics.trajectory import Trajectory

UP, DOWN = Linear.lags(3.0, 1.0), Linear.lags(8.0)
PLANE = Preisach(np.linspace(-1, 1, 5), np.tril(np.arange(1.0, 17).reshape(4, 4)))


def holds(values, seconds, interval=0.5):
    u = np.repeat(values, round(seconds / interval))
    return interval * np.arange(1, u.size + 1), np.asarray(u, dtype=float)


@given(st.lists(st.floats(-1, 1), min_size=1, max_size=6))
def test_settled_where_the_operator_says(values):
    t, u = holds(values, 150)
    ends = slice(299, None, 300)
    y = Trajectory(PLANE, UP, DOWN).simulate(t, u, before=0.0)
    wanted = PLANE.simulate([0.0, *values])[1:]
    np.testing.assert_allclose(y[ends], wanted, atol=1e-6 * np.ptp(PLANE.range))


def test_each_direction_has_its_response():
    line = Polynomial([0.0, 2.0], -1.0, 1.0)
    t, u = holds([0.0, 1.0, 0.0], 100)
    y = Trajectory(line, UP, DOWN).simulate(t, u) / 2
    since = 0.5 * np.arange(1, 201)
    np.testing.assert_allclose(y[200:400], UP.step_response(since), atol=1e-9)
    np.testing.assert_allclose(y[400:], 1 - DOWN.step_response(since), atol=1e-5)
    one = Trajectory(line, UP).simulate(t, u) / 2
    np.testing.assert_allclose(one[400:], 1 - UP.step_response(since), atol=1e-6)
