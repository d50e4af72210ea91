import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from minorloop_head.procedures.go import _CLOSE, _FASTEST, NEAR, go

from .fakes import Loop

PLACES = st.tuples(st.floats(0.0, 0.06), st.floats(-3.1, 3.1))
ANGLES = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))


@settings(max_examples=30, deadline=None)
@given(PLACES, PLACES, ANGLES)
def test_it_reaches_place_and_angles_within_the_rate_limits(start, place, angles):
    loop = Loop(place=start)
    assert loop.run(go(place, angles))
    assert (np.abs(loop.place - place) < NEAR).all()
    assert (np.abs(loop.angles - angles) < _CLOSE).all()
    rates = np.array([request.rates for request in loop.asked])
    assert (np.abs(rates) <= _FASTEST).all()


def test_a_catheter_that_is_stuck_is_left_where_it_is():
    loop = Loop(stuck=True)
    assert not loop.run(go((0.02, 0.0), patience=5.0))
    assert loop.t == pytest.approx(5.4, abs=0.1)
    assert not loop.asked[-1].rates.any()


def test_a_head_is_turned_while_the_catheter_travels_and_stays_where_no_turn_is_asked():
    loop = Loop()
    loop.run(go((0.005, 0.0), (0.2, 0.1)))
    assert loop.asked[0].angles == pytest.approx([0.2, 0.1])
    loop = Loop(angles=(0.1, 0.0))
    loop.run(go((0.005, 0.0)))
    assert all(request.angles is None for request in loop.asked)


def test_an_unknown_place_stops_the_catheter():
    loop = Loop(place=(np.nan, 0.0))
    assert not loop.run(go((0.02, 0.1), patience=0.2))
    assert all(request.rates[0] == 0.0 for request in loop.asked)
