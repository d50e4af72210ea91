import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop.errors import InstrumentError, LimitError, MinorloopError
from minorloop.lab.actuator import Channel
from minorloop.lab.drivers.limited import LimitedSource

TICK = 0.04
PAN, TILT = Channel("pan", "A", 0.0, 0.4, rate=5.0), Channel("tilt", "A", 0.0, 0.4)


class Clock:
    time = 0.0

    def now(self):
        return self.time


class Recorder:
    """A source that keeps what it was set to, or fails."""

    def __init__(self):
        self.sent, self.broken = [], False

    def set(self, value):
        if self.broken:
            raise InstrumentError("no answer")
        self.sent.append(np.atleast_1d(value).copy())

    def safe(self):
        self.sent.append("safe")


def limited(*channels):
    source, clock = Recorder(), Clock()
    rest = np.zeros(len(channels))
    return LimitedSource(source, channels, rest, TICK, clock), source, clock


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf, 0.41, -0.01, 1e308])
def test_nothing_is_sent_beyond_a_limit(wrong):
    one, source, _ = limited(TILT, TILT)
    with pytest.raises(LimitError, match="beyond the limits"):
        one.set([0.1, wrong])
    assert source.sent == []


def test_a_change_is_refused_that_is_faster_than_the_rate_over_a_tick_or_since_the_last():
    one, source, clock = limited(PAN)
    with pytest.raises(LimitError, match=r"from 0 to 0.3 A is faster than the limit 5 A/s"):
        one.set(0.3)
    one.set(0.2)
    clock.time += 0.01
    with pytest.raises(LimitError):
        one.set(0.26)
    one.set(0.25)
    clock.time += 3600.0  # a long hold allows no larger step
    with pytest.raises(LimitError):
        one.set(0.0)
    one.safe()
    assert [*map(str, source.sent)] == ["[0.2]", "[0.25]", "safe"]
    assert one.present == 0.0


def test_the_nearest_allowed_input_is_accepted():
    one, _, clock = limited(PAN, TILT)
    for seconds in (0.0, 0.013, 0.04, 1.0):
        clock.time += seconds
        one.set(one.nearest([0.4, 0.4]))
    assert one.present == pytest.approx([0.4, 0.4])


def test_after_a_failure_nothing_is_set_until_it_is_safe():
    one, source, _ = limited(TILT)
    source.broken = True
    with pytest.raises(InstrumentError, match="no answer"):
        one.set(0.1)
    source.broken = False
    with pytest.raises(InstrumentError, match="make the source safe first"):
        one.set(0.1)
    one.safe()
    one.set(0.1)
    assert source.sent == ["safe", 0.1]


@given(
    st.lists(
        st.tuples(
            st.one_of(st.floats(), st.floats(-0.1, 0.5)),
            st.one_of(st.floats(), st.floats(-0.1, 0.5)),
            st.floats(0.0, 0.1),
        ),
        max_size=30,
    )
)
def test_whatever_is_asked_for_what_is_sent_is_within_the_limits(asked):
    one, source, clock = limited(PAN, TILT)
    times, values = [], []
    for pan, tilt, seconds in asked:
        clock.time += seconds
        try:
            one.set([pan, tilt])
        except MinorloopError:
            continue
        times.append(clock.time)
        values.append(source.sent[-1])
    sent = np.array([[0.0, 0.0], *values])
    assert ((sent >= -1e-12) & (sent <= 0.4 + 1e-12)).all()
    gone = np.minimum(np.diff([-1.0, *times]), TICK)
    assert (np.abs(np.diff(sent[:, 0])) <= 5.0 * gone + 1e-9).all()
