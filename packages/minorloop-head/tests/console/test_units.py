import pytest

from minorloop_head.console import units

SHOWN, SI = (
    (180.0, -90.0, 12.5, 45.0),
    (3.141592653589793, -1.5707963267948966, 0.0125, 0.7853981633974483),
)


def test_a_position_is_converted_both_ways():
    assert units.to_si(SHOWN) == pytest.approx(SI)
    assert units.to_shown(SI) == pytest.approx(SHOWN)


def test_lengths_and_angles_of_messages_are_rounded():
    assert (units.mm(0.00123456789), units.degrees(1.0, 2)) == (1.2346, 57.3)
