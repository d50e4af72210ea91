import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from minorloop.operators.dead_zones import DeadZones

points = st.lists(st.floats(-20, 20), min_size=1, max_size=40).map(np.array)


@st.composite
def curves(draw):
    below = draw(st.lists(st.floats(0.05, 3), max_size=4))
    above = draw(st.lists(st.floats(0.05, 3), max_size=4))
    knots = np.concatenate([-np.cumsum(below)[::-1], np.cumsum(above)])
    count = knots.size + 1
    slopes = draw(st.lists(st.floats(0.05, 5), min_size=count, max_size=count))
    return DeadZones.from_slopes(knots, slopes)


def by_definition(zones, x):
    total = np.zeros_like(x)
    for threshold, weight in zip(zones.thresholds, zones.weights, strict=True):
        if threshold > 0:
            total += weight * np.maximum(x - threshold, 0)
        elif threshold < 0:
            total += weight * np.minimum(x - threshold, 0)
        else:
            total += weight * x
    return total


@given(curves(), points)
def test_is_the_weighted_sum_of_dead_zones(zones, x):
    np.testing.assert_allclose(zones(x), by_definition(zones, x), atol=1e-11)


@given(curves(), points)
def test_inverse_undoes_and_is_undone(zones, x):
    np.testing.assert_allclose(zones.invert(zones(x)), x, atol=1e-10)
    np.testing.assert_allclose(zones(zones.invert(x)), x, atol=1e-12)


def test_zones_on_one_side_have_no_linear_term():
    zones = DeadZones([-1.0, 2.0], [1.0, 3.0])
    np.testing.assert_array_equal(zones(np.array([-3.0, 0.0, 1.5, 3.0])), [-2.0, 0.0, 0.0, 3.0])
    np.testing.assert_array_equal(zones.slopes, [1.0, 0.0, 3.0])
    assert not zones.invertible
