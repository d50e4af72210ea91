import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop.errors import LimitError, ParameterError
from minorloop.lab.actuator import Channel, check_input

VOLTAGE = Channel("voltage", "V", -1.2, 1.2)
AXES = (Channel("x", "V", 0.0, 1.2, rate=0.5), Channel("y", "V", -0.6, 0.6))


@given(st.floats(-1.2, 1.2))
def test_an_input_within_limits_passes_unchanged(u):
    np.testing.assert_array_equal(check_input((VOLTAGE,), u), [u])


@given(st.floats(allow_nan=True, allow_infinity=True).filter(lambda u: not abs(u) <= 1.2000001))
def test_anything_beyond_is_refused_and_never_clipped(u):
    with pytest.raises(LimitError, match=r"voltage .* V is beyond the limits"):
        check_input((VOLTAGE,), u)


def test_rounding_carries_no_input_past_a_limit():
    sweep = 0.1 * np.arange(13)
    assert sweep[-1] > 1.2
    assert check_input((VOLTAGE,), sweep[-1])[0] == sweep[-1]


def test_several_channels_take_an_array():
    np.testing.assert_array_equal(check_input(AXES, [0.1, -0.5]), [0.1, -0.5])
    with pytest.raises(LimitError, match=r"y -0\.7 V"):
        check_input(AXES, [0.1, -0.7])


@pytest.mark.parametrize("u", [0.1, [0.1], [0.1, 0.2, 0.3], [[0.1, 0.2]], "x", None, [1j, 0]])
def test_refuses_what_is_not_one_number_a_channel(u):
    with pytest.raises(ParameterError, match=r"x \[V\], y \[V\]"):
        check_input(AXES, u)


def test_a_rate_limit_is_a_limit_too():
    check_input(AXES, [0.5, 0.6], before=[0.0, -0.6], interval=1.0)
    with pytest.raises(LimitError, match=r"x from 0 to 0\.5 V in 0\.9 s is faster .* 0\.5 V/s"):
        check_input(AXES, [0.5, 0.0], before=[0.0, 0.0], interval=0.9)
