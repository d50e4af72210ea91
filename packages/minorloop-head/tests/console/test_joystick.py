import math

from hypothesis import given
from hypothesis import strategies as st

from minorloop_head.console.joystick import StickMap, push

TICK = 0.04
deflections = st.floats(-1, 1)
maps = st.builds(StickMap, dead_band=st.floats(0, 0.5), expo=st.floats(0, 1))


@given(maps, deflections, deflections)
def test_more_deflection_is_never_less_rate(how, one, other):
    low, high = sorted((one, other))
    assert how.shaped(low) <= how.shaped(high) + 1e-12


@given(maps, st.floats(allow_nan=True, allow_infinity=True))
def test_no_number_asks_for_more_than_the_full_rate(how, deflection):
    assert -1 <= how.shaped(deflection) <= 1


@given(maps, deflections)
def test_both_ways_are_alike(how, deflection):
    assert how.shaped(-deflection) == -how.shaped(deflection)


@given(st.lists(st.one_of(st.none(), st.tuples(deflections, deflections)), max_size=50))
def test_the_catheter_never_goes_off_with_a_jerk(pushes):
    how, rates = StickMap(), (0.0, 0.0)
    for deflection in pushes:
        after = push(how, rates, deflection, TICK)
        if deflection is None:
            assert after == (0.0, 0.0)
        else:
            assert abs(after[0] - rates[0]) <= how.advance_acceleration * TICK + 1e-12
            assert abs(after[1] - rates[1]) <= how.roll_acceleration * TICK + 1e-12
        assert abs(after[0]) <= how.advance
        assert abs(after[1]) <= how.roll
        rates = after


def test_motors_stop_from_the_full_rate_in_time():
    how = StickMap()
    assert max(how.advance / 40e-3, how.roll / math.pi) <= 0.15 + 1e-12
