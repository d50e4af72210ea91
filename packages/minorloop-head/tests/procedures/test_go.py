import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from minorloop_head.procedures.go import Go

from .fakes import Loop

PLACES = st.tuples(st.floats(0.0, 0.06), st.floats(-3.1, 3.1))
ANGLES = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))


@settings(max_examples=30, deadline=None)
@given(PLACES, PLACES, ANGLES)
def test_it_reaches_place_and_angles_within_the_rate_limits(start, place, angles):
    go, loop = Go(), Loop(place=start)
    state = loop.run(go, go.begin(place=place, angles=angles))
    assert state.reached
    assert (np.abs(loop.place - place) < go.near).all()
    assert (np.abs(loop.angles - angles) < go.close).all()
    rates = np.array([request.rates for request in loop.asked])
    assert (np.abs(rates) <= go.fastest).all()


def test_a_catheter_that_is_stuck_is_left_where_it_is():
    go, loop = Go(), Loop(stuck=True)
    state = loop.run(go, go.begin(place=(0.02, 0.0)))
    assert not state.reached
    assert loop.t == pytest.approx(go.patience + go.rest, abs=0.1)
    assert not loop.asked[-1].rates.any()


def test_a_head_is_turned_while_the_catheter_travels_and_stays_where_no_turn_is_asked():
    go, loop = Go(), Loop()
    loop.run(go, go.begin(place=(0.005, 0.0), angles=(0.2, 0.1)))
    assert loop.asked[0].angles == pytest.approx([0.2, 0.1])
    loop = Loop(angles=(0.1, 0.0))
    loop.run(go, go.begin(place=(0.005, 0.0)))
    assert all(request.angles is None for request in loop.asked)


def test_an_unknown_place_stops_the_catheter():
    go, loop = Go(), Loop(place=(np.nan, 0.0))
    state, request = go.step(go.begin(place=(0.02, 0.1)), loop.reading())
    assert request.rates[0] == 0.0
    assert not state.done
