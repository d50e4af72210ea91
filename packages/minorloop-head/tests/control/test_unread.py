import numpy as np
import pytest

from minorloop.errors import ParameterError
from minorloop_head.control.head import camera_control
from minorloop_head.control.unread import Unread, UnreadWatch
from wires import made_up

WHERE = np.array([10.0, 20.0])


def after(gaps, watch):
    """The state after steps with so many steps without a reading at each."""
    state = Unread()
    for k, gap in enumerate(gaps):
        state = watch.step(state, gap, WHERE + k)
    return state


def test_a_gap_keeps_the_head_where_it_was_when_the_gap_became_unusual():
    watch = UnreadWatch(after=3)
    before, state = after([0, 1, 2], watch), after([0, 1, 2, 3, 4], watch)
    wanted = np.array([40.0, 0.0])
    assert watch.near(before, wanted).tolist() == [40.0, 0.0]
    assert watch.near(state, wanted).tolist() == [13.5, 22.5]
    assert watch.near(state, WHERE + 3.1).tolist() == pytest.approx([13.1, 23.1])
    assert watch.near(watch.step(state, 0, WHERE), wanted).tolist() == [40.0, 0.0]


def test_a_head_that_is_not_seen_for_long_goes_back_towards_the_cold_one():
    watch, wanted = UnreadWatch(after=3, stays=50), np.array([40.0, 30.0])
    stays, goes = after(range(51), watch), after(range(100), watch)
    assert watch.near(stays, wanted).tolist() == [13.5, 23.5]
    assert (np.abs(goes.kept - 0.5 * stays.kept) < 1.0).all()
    assert watch.near(watch.step(goes, 0, WHERE), wanted).tolist() == [40.0, 30.0]
    skipped = watch.step(stays, 60, WHERE)
    assert skipped.kept == pytest.approx(after(range(61), watch).kept)


def test_a_head_whose_camera_shows_nothing_stays_until_it_can_be_looked_for():
    watch = UnreadWatch(after=3, stays=50)
    state = after(range(10), watch)
    for gap in range(10, 100):
        state = watch.step(state, gap, WHERE, searched=False)
    assert state.kept.tolist() == (WHERE + 3).tolist()
    for gap in range(100, 141):
        state = watch.step(state, gap, WHERE)
    assert state.kept.tolist() == (WHERE + 3).tolist()
    assert watch.step(state, 141, WHERE).kept == pytest.approx(0.985 * (WHERE + 3))
    assert watch.step(state, 0, WHERE).dark == 0


def test_steps_that_take_several_intervals_go_back_after_the_same_time():
    each, third = UnreadWatch(after=3), UnreadWatch(after=3, takes=3)
    assert third.step(Unread(16, 0.0, WHERE), 17, WHERE).kept == pytest.approx(WHERE * 0.985**3)
    assert each.step(Unread(16, 0.0, WHERE), 17, WHERE).kept == pytest.approx(WHERE)


def test_a_sensor_with_few_readings_may_have_its_usual_gaps():
    watch = UnreadWatch(after=3)
    usual = [0, 1, 2, 3, 4] * 20
    assert after([*usual, 0, 1, 2, 3, 4, 5, 6, 7], watch).kept is None
    assert after([*usual, *range(9)], watch).kept is not None
    one_loss = [*range(200), 0, 0, 0, 0, 0, 0, 0]
    assert after([*one_loss, *range(4)], watch).kept is not None


def test_a_head_that_is_not_seen_stops_and_goes_on_when_it_is():
    wires = made_up(), made_up()
    control = camera_control("observer", wires, interval=0.04)
    blind = camera_control("observer", wires, interval=0.04, unread=None)
    reached = {}
    for name, each in (("watched", control), ("not", blind)):
        state, seen = each.begin(), np.zeros(2)
        angles = []
        for k in range(400):
            lost = 90 <= k < 230
            _, state = each.step(state, [40.0, 0.0], np.full(2, np.nan) if lost else seen)
            seen = np.array([axis.estimate.wire.angle for axis in state.axes])
            angles.append(float(seen[0]))
        reached[name] = angles
    assert 5.0 < reached["watched"][90] < 30.0
    assert reached["watched"][229] < reached["watched"][90] + 2.0
    assert reached["not"][229] > 35.0
    assert reached["watched"][-1] == pytest.approx(40.0, abs=1.0)


def test_steps_out_of_range_are_refused():
    with pytest.raises(ParameterError, match="after"):
        UnreadWatch(after=0)
    with pytest.raises(ParameterError, match="stays"):
        UnreadWatch(stays=0)
