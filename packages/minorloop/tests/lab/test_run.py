import os
import signal

import numpy as np
import pytest

from minorloop.connect import connect
from minorloop.errors import InstrumentError, LimitError, ParameterError, SafetyError, StoreError
from minorloop.lab.actuator import Channel
from minorloop.lab.plan import Plan
from minorloop.lab.records import Record
from minorloop.lab.run import run
from minorloop.lab.signals import Stopped
from minorloop.lab.store import Setup, Store

LEVELS = [-1.2, 0.3, -0.6, 1.2, 0.0, 0.7]
PLAN = Plan(LEVELS, 40.0, sample_interval=0.5, input="voltage [V]")
SETUP = Setup("twin:ipmc", "voltage [V]", "curvature [1/m]", specimen=3, seed=5)


class Bench:
    """An instrument: a first-order lag that cannot be checkpointed, and records what it is sent."""

    inputs = (Channel("voltage", "V", -2.0, 2.0),)
    outputs = (Channel("curvature", "1/m"),)
    tick = 0.1

    def __init__(self, fails_after=None):
        self.sent, self.state, self.clock = [], 0.0, 17.0
        self.fails_after = fails_after

    def apply(self, u, duration, sample_interval):
        if self.fails_after is not None and len(self.sent) >= self.fails_after:
            raise OSError("the cable was pulled")
        self.sent.append((u, duration))
        t = np.arange(1, round(duration / sample_interval) + 1) * sample_interval
        y = u + (self.state - u) * np.exp(-t / 2.0)
        self.state, began = float(y[-1]), self.clock
        self.clock += duration
        return Record(np.full(t.size, u), y, began + t, "voltage [V]", "curvature [1/m]")

    def exchange(self, u):
        return self.apply(u, self.tick, self.tick).y[-1]

    def safe(self):
        self.sent.append("safe")


@pytest.fixture
def twin():
    return connect("twin:ipmc", specimen=3, noise=0.02, seed=5)


@pytest.fixture
def store(tmp_path):
    with Store.create(tmp_path / "runs.sqlite", PLAN, SETUP) as opened:
        yield opened


def _rows(store):
    return [(p.index, p.input, p.value, p.sd, p.verdict, p.t, p.held) for p in store.points()]


def _undisturbed(tmp_path, actuator):
    with Store.create(tmp_path / "whole.sqlite", PLAN, SETUP) as whole:
        run(actuator, PLAN, whole)
        return _rows(whole), [whole.trace(k) for k in range(len(PLAN))]


class Dead(Bench):
    """Its meter repeats a reading from some hold on."""

    def __init__(self, since, repeated=None):
        super().__init__()
        self.levels, self.since, self.reading, self.repeated = [], since, None, repeated

    def apply(self, u, duration, sample_interval):
        record = super().apply(u, duration, sample_interval)
        if not self.levels or u != self.levels[-1]:
            self.levels.append(u)
        if len(self.levels) <= self.since:
            self.reading = record.y[-1]
            return record
        repeated = np.full(record.y.size, self.repeated or self.reading or 0.25)
        return Record(record.u, repeated, record.t, "voltage [V]", "curvature [1/m]")


@pytest.mark.parametrize(
    ("since", "repeated", "said"), [(0, None, "in every"), (4, None, "in every"), (4, np.nan, "no")]
)
def test_a_dead_meter_is_warned_of_and_then_ends_the_run(tmp_path, since, repeated, said):
    plan = Plan([-1.0, 1.0] * 5, 40.0, sample_interval=0.5, input="voltage [V]")
    bench, warnings = Dead(since, repeated), []
    with Store.create(tmp_path / "dead.sqlite", plan, SETUP) as store:
        with pytest.raises(InstrumentError, match=said + r" reading of holds \d to \d, while vol"):
            run(bench, plan, store, watch=lambda now: warnings.append(now.warning))
        assert len(store) == since + 3
        assert store.points()[-1].value in (bench.reading, 0.25) or repeated
        assert "check the meter and its range" in store.sessions()[0].end
        run(Bench(), plan, store)
        assert store.finished
    assert bench.sent[-1] == "safe"
    (warning,) = filter(None, warnings)
    assert f"holds {since + 1} to {since + 2}, while voltage went from -1 to 1 V" in warning


def test_an_actuator_that_does_not_move_within_a_small_part_of_its_limits_is_only_warned_of(store):
    plan = Plan([-0.4, 0.4] * 3, 40.0, sample_interval=0.5, input="voltage [V]")
    warnings = []
    with Store.create(store.path.with_name("small.sqlite"), plan, SETUP) as other:
        run(Dead(0), plan, other, watch=lambda now: warnings.append(now.warning))
        assert other.finished
    assert len([*filter(None, warnings)]) == 1


def test_an_instrument_is_taken_through_its_history_again(tmp_path, store):
    whole, _ = _undisturbed(tmp_path, Bench())
    first = Bench(fails_after=6)
    with pytest.raises(OSError, match="the cable was pulled"):
        run(first, PLAN, store)
    assert first.sent[-1] == "safe"
    settled = len(store)
    assert 0 < settled < len(PLAN)
    second = Bench()
    assert run(second, PLAN, store) == "replayed"
    replayed = [(point.input, point.held) for point in store.points()[:settled]]
    assert second.sent[:settled] == replayed
    assert [row[:2] for row in _rows(store)] == [row[:2] for row in whole]
    np.testing.assert_allclose([r[2] for r in _rows(store)], [r[2] for r in whole], atol=1e-9)
    assert [session.mode for session in store.sessions()] == ["fresh", "replayed"]
    assert [session.end for session in store.sessions()] == ["the cable was pulled", "finished"]


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_leaves_the_actuator_safe(store, name):
    bench = Bench()

    def watch(progress):
        if progress.index == 2:
            os.kill(os.getpid(), getattr(signal, name))

    before = signal.getsignal(getattr(signal, name))
    with pytest.raises(Stopped, match=name):
        run(bench, PLAN, store, watch=watch)
    assert bench.sent[-1] == "safe"
    assert len(store) == 2
    assert store.sessions()[0].end == "interrupted"
    assert signal.getsignal(getattr(signal, name)) == before


@pytest.mark.parametrize("fails_after", [2, None])
def test_an_actuator_that_cannot_be_made_safe_is_an_error_of_its_own(store, fails_after):
    class Stuck(Bench):
        def safe(self):
            raise OSError("the relay sticks")

    with pytest.raises(
        SafetyError, match=r"may still be on, .*by hand: the relay sticks"
    ) as caught:
        run(Stuck(fails_after), PLAN, store)
    assert store.finished == (fails_after is None)
    said = str(caught.value).partition("the run ended because of: ")[2]
    assert said == ("the cable was pulled" if fails_after == 2 else "")


def test_refuses_before_anything_is_applied(store, twin):
    bench = Bench()
    far = Plan([0.0, 2.5], 40.0, input="voltage [V]")
    with pytest.raises(LimitError, match=r"voltage 2.5 V is beyond the limits \[-2, 2\] V"):
        run(bench, far, store)
    milli = Plan([0.0, 100.0], 40.0, input="voltage [mV]")
    with pytest.raises(ParameterError, match=r"'voltage \[mV\]' and the actuator takes"):
        run(bench, milli, store)
    other = Plan(LEVELS[::-1], 40.0, sample_interval=0.5, input="voltage [V]")
    with pytest.raises(StoreError, match=r"another run: inputs.0 was -1.2 and is 0.7 now"):
        run(bench, other, store)
    bench.inputs = bench.inputs * 2
    with pytest.raises(ParameterError, match="2 inputs and 1 output;"):
        run(bench, PLAN, store)
    assert bench.sent == []
    assert len(store) == 0


def test_levels_that_the_source_would_round_are_refused_before_anything_is_applied(store):
    bench = Bench()
    bench.written = lambda u: round(u, 4)
    fine = Plan([0.0, 0.25, 0.123456], 40.0, input="voltage [V]")
    with pytest.raises(ParameterError, match=r"level 3 of the plan is 0.123456 and the source wou"):
        run(bench, fine, store)
    assert bench.sent == []
    assert len(store) == 0


OPEN = Plan([-1.2, *[np.nan] * 6, 0.5], 20.0, sample_interval=0.5, input="voltage [V]")


def test_a_chosen_level_beyond_the_limits_is_refused_and_the_points_are_kept(tmp_path):
    bench = Bench()
    with Store.create(tmp_path / "open.sqlite", OPEN, SETUP) as store:
        with pytest.raises(LimitError, match="voltage 3 V"):
            run(bench, OPEN, store, choose=lambda points: 3.0)
        assert len(store) == 1
        assert bench.sent[-1] == "safe"
        assert bench.sent[-2][0] == -1.2


def test_open_levels_need_somebody_who_chooses(tmp_path):
    with (
        Store.create(tmp_path / "open.sqlite", OPEN, SETUP) as store,
        pytest.raises(ParameterError, match="level 1 of the plan is open"),
    ):
        run(Bench(), OPEN, store)


def test_a_store_of_another_actuator_is_refused(store):
    fibre = connect("twin:fibre")
    plan = Plan([0.2, 0.5], 40.0, input="voltage [V]")
    with (
        Store.create(store.path.with_name("other.sqlite"), plan, SETUP) as other,
        pytest.raises(StoreError, match=r"the actuator has .* 'length change \[um\]'"),
    ):
        run(fibre, plan, other)
