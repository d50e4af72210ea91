import math

import pytest

from papers.catheter.control.laws import FeedforwardPI, ProportionalIntegral
from wires import made_up

BOTH = pytest.mark.parametrize("law", [ProportionalIntegral(), FeedforwardPI(wire=made_up())])


@BOTH
@pytest.mark.parametrize("seconds", [4.0, 60.0])
def test_the_integral_does_not_wind_up(law, seconds):
    """One second is enough to leave the limit, however long the current was there."""
    state = law.begin()
    for _ in range(round(seconds / law.interval)):
        current, state = law.step(state, 50.0, 0.0)
    assert current == law.highest
    for _ in range(round(1.0 / law.interval)):
        current, state = law.step(state, 20.0, 60.0)
    assert current < law.highest


def test_the_applied_current_counts_and_not_the_requested_one():
    law = ProportionalIntegral()
    wanted, state = law.step(law.begin(), 20.0, 0.0)
    cut = type(state)(state.integral, state.wanted, 0.1)
    assert law.step(cut, 20.0, 0.0)[0] < law.step(state, 20.0, 0.0)[0]
    assert wanted > 0.1


@BOTH
def test_a_missing_reading_holds_the_current(law):
    current, state = law.step(law.begin(), 30.0, 29.0)
    assert law.step(state, 30.0, math.nan)[0] == current


def test_without_gains_it_is_the_inverse_of_the_operator():
    wire = made_up()
    law = FeedforwardPI(wire=wire, proportional=0.0, integral=0.0)
    state, inverse = law.begin(), wire.operator.track()
    for reference in (20.0, 45.0, 30.0, 38.0, 5.0):
        current, state = law.step(state, reference, 0.0)
        power = inverse.aim(reference)
        inverse.push(power)
        assert current**2 == pytest.approx(power)


def test_its_feedback_is_that_of_pi_on_top_of_the_inverse():
    gains = {"proportional": 2e-4, "integral": 1e-5}
    wire = made_up()
    law, beside = FeedforwardPI(wire=wire, **gains), ProportionalIntegral(**gains)
    state, other, ahead = law.begin(), beside.begin(), wire.operator.track().aim(30.0)
    for reading in (5.0, 12.0, 20.0, 26.0):
        current, state = law.step(state, 30.0, reading)
        extra, other = beside.step(other, 30.0, reading)
        assert current**2 == pytest.approx(ahead + extra**2)
