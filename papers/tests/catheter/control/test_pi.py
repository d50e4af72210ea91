import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from papers.catheter.control.pi import ProportionalIntegral


@given(seconds=st.floats(1.0, 600.0))
def test_the_integral_does_not_wind_up(seconds):
    law = ProportionalIntegral()
    state = law.begin()
    for _ in range(round(min(seconds, 60.0) / law.interval)):
        current, state = law.step(state, 50.0, 0.0)
    assert current == law.highest
    # The wanted power stays near what is achieved, so one second is enough to leave the limit.
    assert state.wanted <= law.highest**2 + 50.0 * (law.proportional + law.integral)
    for _ in range(round(1.0 / law.interval)):
        current, state = law.step(state, 50.0, 60.0)
    assert current < law.highest


def test_the_applied_current_counts_and_not_the_requested_one():
    law = ProportionalIntegral()
    wanted, state = law.step(law.begin(), 20.0, 0.0)
    cut = type(state)(state.integral, state.wanted, 0.1)
    assert law.step(cut, 20.0, 0.0)[0] < law.step(state, 20.0, 0.0)[0]
    assert wanted > 0.1


def test_a_missing_reading_holds_the_current():
    law = ProportionalIntegral()
    current, state = law.step(law.begin(20.0, 0.3), 21.0, 20.0)
    held, state = law.step(state, 21.0, math.nan)
    assert held == current
    assert law.step(state, 20.0, 20.0)[0] == pytest.approx(current, abs=0.01)
