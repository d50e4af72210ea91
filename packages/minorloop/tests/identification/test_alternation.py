import numpy as np

import minorloop as ml
from fixed_options import Plane, identify
from minorloop import Record, Smooth
from minorloop.identification.alternation import alternate, without
from minorloop.identification.dynamic_parts import DynamicParts, DynamicRecord

T = 0.01 * np.arange(800)
U = np.repeat(np.random.default_rng(1000).uniform(0, 1, 40), 20)
U[:20] = 0
PLANE = ml.Preisach(np.linspace(0, 1, 7), np.tril(np.ones((6, 6))))
TRUE = DynamicParts(0.01, 2.0, (float(np.log(0.03)),), (float(np.log(0.08)),))


def record():
    return DynamicRecord.of(Record(U, TRUE.cascade(PLANE).simulate(T, U), T), 0.0)


def static(u, y):
    return identify(u, y, Plane(PLANE.levels), prior=Smooth(0.0))


def test_the_record_without_its_dynamics_is_that_of_the_operator():
    u, y = without(TRUE, record(), PLANE)
    np.testing.assert_array_equal(u, TRUE.before(U))
    np.testing.assert_allclose(y, PLANE.simulate(u), atol=1e-5)


def test_alternation_finds_poles_on_both_sides():
    begin = DynamicParts(0.01, 1.0, (float(np.log(0.05)),), (float(np.log(0.05)),))
    found = alternate(record(), begin, static)
    np.testing.assert_allclose(found.dynamics.time_constants, [0.08, 0.03], rtol=0.1)
    assert found.error < 3e-3
    assert found.result.model is found.operator
