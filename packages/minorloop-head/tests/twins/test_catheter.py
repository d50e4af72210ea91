import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from minorloop_head.twins.catheter import TRAVEL, TURNS, Catheter


def go(twin, advance, roll, seconds):
    """Where the tip is after some seconds at two rates."""
    return twin.apply(np.array([advance, roll]), seconds, seconds).y[:, -1]


def test_the_motor_takes_up_a_rate_with_a_limited_acceleration():
    twin = Catheter(log_truth=True)
    rates = []
    for _ in range(25):
        twin.exchange(np.array([20.0, 60.0]))
        rates.append(twin._truth()["motor_rate"][-1])
    rates = np.array(rates)
    np.testing.assert_allclose(rates[:5, 0], 40.0 * 0.04 * np.arange(1, 6))
    np.testing.assert_allclose(rates[-1], [20.0, 60.0])
    assert np.all(np.diff(rates, axis=0) <= np.array([40.0, 180.0]) * 0.04 + 1e-9)


def test_the_tip_sticks_until_the_motor_has_gone_the_breakaway_and_then_jumps():
    record = Catheter(log_truth=True).apply(np.array([0.5, 0.0]), 6.0, 0.01)
    stuck = record.t < 1.2 / 0.5
    assert np.all(record.y[0, stuck] == 0.0)
    speed = np.diff(record.y[0]) / 0.01
    assert speed.max() > 3 * 0.5
    assert speed[-1] == pytest.approx(0.5, rel=0.01)
    assert np.all(record.y[1] == 0.0)


def test_stops_at_the_ends_of_its_travel():
    twin = Catheter(log_truth=True)
    go(twin, -20.0, 60.0, 30.0)
    motor = twin._truth()["motor"][-1]
    np.testing.assert_allclose(motor, [0.0, TURNS])
    tip = go(twin, 20.0, -60.0, 100.0)
    assert TRAVEL - 5 < tip[0] <= TRAVEL
    assert -TURNS <= tip[1] < -TURNS + 20
    np.testing.assert_allclose(twin._truth()["motor"][-1], [TRAVEL, -TURNS])


@given(st.lists(st.tuples(st.floats(-20, 20), st.floats(-60, 60)), min_size=1, max_size=12))
@settings(max_examples=30)
def test_the_tip_is_never_further_from_the_motor_than_friction_holds(rates):
    twin = Catheter(tick=1.0, log_truth=True)
    for rate in rates:
        twin.exchange(np.array(rate))
    truth = twin._truth()
    stretch = 1 + 1e-3 * truth["tip"][:, [0]]
    # Sliding adds what the tip relaxes behind a moving motor: rate times relaxation time.
    most = stretch * [1.2, 6.0] + np.array([20.0 * 0.11, 60.0 * 0.07])
    assert np.all(np.abs(truth["motor"] - truth["tip"]) <= most)
