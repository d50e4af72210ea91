import math
import os
import signal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop.errors import (
    InstrumentError,
    LimitError,
    MinorloopError,
    ParameterError,
    SafetyError,
)
from minorloop.lab.actuator import Actuator, Channel
from minorloop.lab.drivers.bench import LimitedSource
from minorloop.lab.signals import Stopped
from simulated_plant import Plant


class Unreliable(Plant):
    """Fails, or reads something else, when it is told to."""

    answer, broken, safe_fails = None, None, 0

    def set(self, value):
        if self.broken:
            raise self.broken
        super().set(value)

    def safe(self):
        if self.safe_fails:
            self.safe_fails -= 1
            raise InstrumentError("no answer")
        super().safe()

    def read(self):
        found = super().read()
        return found if self.answer is None else self.answer


@pytest.fixture
def plant():
    return Unreliable()


def test_a_hold_is_sampled_every_interval_and_at_its_end(plant):
    record = plant.bench().apply(0.5, 1.0, 0.3)
    np.testing.assert_allclose(record.t, [0.3, 0.6, 0.9, 1.0])
    assert (record.u == 0.5).all()
    assert (record.y == 1.0).all()
    assert str(record.input) == "voltage [V]"
    assert str(record.output) == "tip [mm]"
    assert plant.sent == [(0.0, 0.5)]


@pytest.mark.parametrize("lag", [0.0, 0.03, 0.3, 0.31, 0.45, 0.7, 1.0])
def test_no_reading_is_begun_that_would_end_after_the_hold(plant, lag):
    plant.lag = lag
    slow = plant.bench()
    slow.check()
    began = plant.clock.now()
    record = slow.apply(0.5, 1.0, 0.3)
    assert plant.clock.now() - began == pytest.approx(1.0)
    assert record.t[-1] + lag / 2 - began <= 1.0 + 1e-9
    assert len(record) >= min(4, int(1.0 / max(lag, 0.3)))
    assert (np.diff(record.t) >= lag - 1e-9).all()


def test_an_input_is_on_in_the_middle_of_the_exchange_that_sets_it(plant):
    put = plant.set

    def slowly(value):
        plant.clock.sleep(0.2)
        put(value)
        plant.clock.sleep(0.2)

    plant.set = slowly
    record = plant.bench().apply(0.5, 1.0, 0.1)
    assert record.timing.began == pytest.approx(0.2)
    assert record.timing.ended == pytest.approx(1.2)
    assert record.timing.uncertainty == pytest.approx(0.2)
    again = plant.bench().apply(0.0, 1.0, 0.1)  # it is on already
    assert (again.timing.began, again.timing.uncertainty) == (0.0, 0.0)


def test_a_tick_that_is_shorter_than_an_answer_is_refused(plant):
    plant.answer, plant.lag = 1.0, 0.1
    slow = plant.bench(tick=0.05)
    slow.check()
    plant.sent.clear()
    with pytest.raises(ParameterError, match=r"takes 0\.1 s .* tick is 0\.05 s; give .* 0\.1 s"):
        slow.exchange(0.5)
    assert plant.sent == []


def test_a_tick_includes_its_reading(plant):
    plant.answer, plant.lag = 1.0, 0.04
    slow = plant.bench(tick=0.1)
    slow.check()
    assert isinstance(slow, Actuator)
    began = plant.clock.now()
    assert [slow.exchange(0.1 * k) for k in range(5)] == [1.0] * 5
    assert plant.clock.now() - began == pytest.approx(0.5)


def test_a_change_is_no_faster_than_the_rate(plant):
    record = plant.bench(rate=2.0, tick=0.1).apply(1.0, 1.0, 0.25)
    times, values = np.array(plant.sent).T
    np.testing.assert_allclose(values, [0.2, 0.4, 0.6, 0.8, 1.0])
    assert (np.diff(values) / np.diff(times) <= 2.0 + 1e-9).all()
    assert (record.u == 1.0).all()
    assert (record.y == 2.0).all()  # the hold begins when its input is reached
    assert record.t[-1] == pytest.approx(times[-1] + 1.0)


@pytest.mark.parametrize(
    ("answer", "message"),
    [(9.9e37, "overloaded"), (math.nan, "overloaded"), (-math.inf, "overloaded"), (6.0, "beyond")],
)
def test_a_reading_that_cannot_be_makes_safe_and_says_so(plant, answer, message):
    plant.answer = answer
    with pytest.raises(InstrumentError, match=message):
        plant.bench().exchange(0.5)
    assert plant.sent[-1][1] == "safe"


@pytest.mark.parametrize("error", [InstrumentError("no answer"), KeyboardInterrupt(), OSError()])
def test_whatever_goes_wrong_the_source_is_made_safe(plant, error):
    plant.broken = error
    with pytest.raises(type(error)):
        plant.bench().apply(0.5, 1.0, 0.5)
    assert plant.sent == [(0.0, "safe")]


def test_safe_is_tried_until_a_deadline(plant):
    plant.safe_fails = 9
    plant.bench().safe()
    assert [what for _, what in plant.sent] == ["safe"]
    began, plant.safe_fails = plant.clock.now(), math.inf
    with pytest.raises(SafetyError, match=r"by hand: in 10 s it did not confirm .*: no answer"):
        plant.bench().safe()
    assert 10 <= plant.clock.now() - began <= 11


def test_a_source_that_stays_on_is_said_before_what_came_before(plant):
    plant.safe_fails, plant.answer = math.inf, 6.0
    with pytest.raises(SafetyError, match=r"may still be on.*the error before: the meter reads 6"):
        plant.bench().exchange(0.5)
    plant.broken = KeyboardInterrupt()
    with pytest.raises(SafetyError, match=r"the error before: KeyboardInterrupt"):
        plant.bench().exchange(0.5)


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_no_signal_interrupts_making_safe(plant, name):
    def safe():
        for _ in range(3):
            os.kill(os.getpid(), getattr(signal, name))
        plant.sent.append("safe")

    plant.safe = safe
    before = signal.getsignal(getattr(signal, name))
    with pytest.raises(Stopped, match=name):
        plant.bench().safe()
    assert plant.sent == ["safe"]
    assert signal.getsignal(getattr(signal, name)) is before


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"low": -math.inf, "high": math.inf}, "has no limits"),
        ({"rest": 2.0}, "rest 2 is beyond"),
        ({"tick": 0.0}, "tick is 0"),
        ({"tick": math.nan}, "tick is nan"),
        ({"safe_within": 0.0}, "safe_within is 0"),
    ],
)
def test_benches_that_make_no_sense(plant, options, message):
    with pytest.raises(ParameterError, match=message):
        plant.bench(**options)


@pytest.mark.parametrize(
    "times", [(0.0, 0.1), (1.0, 0.0), (math.nan, 0.1), (1.0, -1.0), (1e9, 1e-9)]
)
def test_times_that_make_no_sense(plant, times):
    with pytest.raises(ParameterError):
        plant.bench().apply(0.5, *times)
    assert plant.sent == []


# The limits that every command passes.

TICK = 0.04
X, Y = Channel("x", "A", 0.0, 0.4, rate=5.0), Channel("y", "A", 0.0, 0.4)


def limited(*channels):
    plant = Unreliable()
    return LimitedSource(plant, channels, np.zeros(len(channels)), TICK, plant.clock), plant


def test_a_change_is_refused_that_is_faster_than_the_rate_over_a_tick_or_since_the_last():
    one, plant = limited(X)
    with pytest.raises(LimitError, match=r"from 0 to 0.3 A in 0.04 s is faster than the limit 5 A"):
        one.set(0.3)
    one.set(0.2)
    plant.clock.time += 0.01
    with pytest.raises(LimitError):
        one.set(0.26)
    one.set(0.25)
    plant.clock.time += 3600.0  # a long hold allows no larger step
    with pytest.raises(LimitError):
        one.set(0.0)
    one.safe()
    assert [what for _, what in plant.sent] == [0.2, 0.25, "safe"]
    assert one.present == 0.0


def test_after_a_failure_nothing_is_set_until_it_is_safe():
    one, plant = limited(Y)
    plant.broken = InstrumentError("no answer")
    with pytest.raises(InstrumentError, match="no answer"):
        one.set(0.1)
    plant.broken = None
    with pytest.raises(InstrumentError, match="make the source safe first"):
        one.set(0.1)
    one.safe()
    one.set(0.1)
    assert [what for _, what in plant.sent] == ["safe", 0.1]


ANY = st.one_of(st.floats(), st.floats(-0.1, 0.5))


@given(st.lists(st.tuples(ANY, ANY, st.floats(0.0, 0.1), st.booleans()), max_size=30))
def test_whatever_is_asked_for_what_is_sent_is_within_the_limits(asked):
    one, plant = limited(X, Y)
    times, values = [], []
    for x, y, seconds, nearest in asked:
        plant.clock.time += seconds
        try:
            one.set(one.nearest([x, y]) if nearest else [x, y])
        except MinorloopError:
            continue
        times.append(plant.clock.time)
        values.append(plant.sent[-1][1])
    sent = np.array([[0.0, 0.0], *values])
    assert ((sent >= -1e-12) & (sent <= 0.4 + 1e-12)).all()
    gone = np.minimum(np.diff([-1.0, *times]), TICK)
    assert (np.abs(np.diff(sent[:, 0])) <= 5.0 * gone + 1e-9).all()
