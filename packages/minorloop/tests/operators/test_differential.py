import numpy as np
import pytest

from minorloop.operators.differential import BoucWen, Duhem

HARDENING = BoucWen(5e4, 800.0, -1100.0)
SOFTENING = BoucWen(5e4, 800.0, 1100.0)
SQUARE = BoucWen(1.0, 0.5, 0.3, 2.0)
FREE = Duhem([-1.0, -0.2, 0.5, 1.2], [2.0, 1.0, 0.5, -0.1], [-0.1, 0.5, 1.0, 2.0])
EVERY = [(HARDENING, 1e-3), (SOFTENING, 1e-3), (SQUARE, 2.0), (FREE, 1.0)]


def walk(scale, count=60, seed=1000):
    return scale * np.cumsum(np.random.default_rng(seed).normal(size=count)) / 8


@pytest.mark.parametrize(("operator", "scale"), EVERY)
def test_outputs_are_those_of_many_small_steps_of_the_law(operator, scale):
    u = walk(scale, 8)
    z, before = 0.0, 0.0
    for target in u:
        step = (target - before) / 800
        for _ in range(800):  # the midpoint rule: its error is of the order of step^2
            side = 0 if step > 0 else 1
            middle = z + step / 2 * float(operator.slopes([z])[side][0])
            z += step * float(operator.slopes([middle])[side][0])
        before = target
    assert operator.simulate(u)[-1] == pytest.approx(z, rel=1e-5)


def test_steps_with_an_exponent_of_one_are_exact():
    z = SOFTENING.simulate([1e-3])[0]
    assert z == pytest.approx(5e4 / 1900 * (1 - np.exp(-1.9)), rel=1e-14)
    assert SOFTENING.range == pytest.approx((-5e4 / 1900, 5e4 / 1900))
    assert SOFTENING.invert([z]).u[0] == pytest.approx(1e-3, rel=1e-13)


def test_a_memory_that_came_from_far_is_at_the_limit():
    low, high = SOFTENING.range
    assert SOFTENING.simulate([0.3, 0.4], "negative") == pytest.approx([high, high])
    assert SOFTENING.simulate([-0.3], "positive") == pytest.approx([low])
    assert FREE.range == pytest.approx((-1 + 0.8 / 6, 0.5 + 0.7 * 5 / 6))
