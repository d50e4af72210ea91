import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from minorloop.errors import UnreachableError
from minorloop.operators.inversion import refuse_unreachable, within_reach


def test_the_message_names_value_index_range_and_remedy():
    targets = np.array([0.0, 1.0, 2.0, 12.4, -11.0])
    reachable = within_reach(targets, -9.8, 9.7)
    np.testing.assert_array_equal(reachable, [True, True, True, False, False])
    with pytest.raises(UnreachableError) as caught:
        refuse_unreachable(targets, -9.8, 9.7, reachable, "1/m")
    assert str(caught.value) == (
        "target 12.4 1/m at index 3 is beyond what the model can reach, [-9.8, 9.7] 1/m; "
        'pass unreachable="clip" to go as near as it can'
    )
    refuse_unreachable(targets[:3], -9.8, 9.7, reachable[:3])


@given(st.floats(-1e6, 1e6), st.floats(1e-3, 1e6), st.floats(2e-12, 1.0))
def test_the_message_shows_that_the_target_is_outside(low, width, beyond):
    high = low + width
    targets = np.array([high + beyond * (high - low)])
    reachable = within_reach(targets, low, high)
    assume(not reachable[0])
    with pytest.raises(UnreachableError) as caught:
        refuse_unreachable(targets, low, high, reachable)
    words = str(caught.value).replace("[", "").replace("]", "").replace(";", " ").split()
    assert float(words[1]) > float(words[words.index("reach,") + 2])


@given(st.floats(-1e3, 1e3), st.floats(1.0, 1e3))
def test_rounding_at_an_end_is_within_reach(low, width):
    high = low + width
    ends = np.array([low - 0.9e-12 * width, high + 0.9e-12 * width])
    slack = np.spacing(max(abs(low), abs(high)))
    if slack < 1e-14 * width:
        assert within_reach(ends, low, high).all()
    assert not within_reach(ends + np.array([-1, 1]) * 1e-9 * width, low, high).any()
