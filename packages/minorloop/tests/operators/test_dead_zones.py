import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop.errors import NotInvertibleError, ParameterError
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
    np.testing.assert_allclose(zones.inverse()(x), zones.invert(x), atol=1e-8)


def test_zones_on_one_side_have_no_linear_term():
    zones = DeadZones([-1.0, 2.0], [1.0, 3.0])
    np.testing.assert_array_equal(zones(np.array([-3.0, 0.0, 1.5, 3.0])), [-2.0, 0.0, 0.0, 3.0])
    np.testing.assert_array_equal(zones.slopes, [1.0, 0.0, 3.0])
    assert not zones.invertible
    with pytest.raises(NotInvertibleError, match="piece 1"):
        zones.inverse()
    with pytest.raises(NotInvertibleError, match="piece 1"):
        zones.invert(0.0)


@pytest.mark.parametrize(
    ("knots", "slopes", "what"),
    [([0.0], [1.0, 2.0], "knot is zero"), ([1.0], [1.0], "need \\(2,\\)")],
)
def test_refuses_wrong_knots_and_slopes(knots, slopes, what):
    with pytest.raises(ParameterError, match=what):
        DeadZones.from_slopes(knots, slopes)


def test_refuses_thresholds_that_do_not_increase():
    with pytest.raises(ParameterError, match="thresholds are not strictly increasing"):
        DeadZones([1.0, 0.0], [1.0, 1.0])


def test_equality_is_of_values():
    assert DeadZones([0.0], [1.0]) == DeadZones([0.0], [1.0])
    assert DeadZones([0.0], [1.0]) != DeadZones([0.0], [2.0])
    assert DeadZones([0.0], [1.0]) != 1.0
