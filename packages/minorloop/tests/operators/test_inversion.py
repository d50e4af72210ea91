import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from minorloop.operators.inversion import within_reach


@given(st.floats(-1e3, 1e3), st.floats(1.0, 1e3))
def test_rounding_at_an_end_is_within_reach(low, width):
    high = low + width
    ends = np.array([low - 0.9e-12 * width, high + 0.9e-12 * width])
    slack = np.spacing(max(abs(low), abs(high)))
    if slack < 1e-14 * width:
        assert within_reach(ends, low, high).all()
    assert not within_reach(ends + np.array([-1, 1]) * 1e-9 * width, low, high).any()
