"""Times in a store are those of the instrument, however slow it is."""

import numpy as np
import pytest

from minorloop import Channel, ParameterError, Plan, Record, Setup, Store, run
from minorloop.lab.records import Timing
from minorloop.lab.run import check_plan
from simulated_plant import Plant

SETUP = Setup("bench", "voltage [V]", "tip [mm]")
LEVELS = [0.5, -0.25, -0.25, 0.75, 0.0]


class Noisy(Plant):
    """A source and a meter with noise, on a clock that runs already."""

    def __init__(self, answer, noise=0.0):
        super().__init__(answer)
        self.clock.time, self.noise, self.chance = 50.0, noise, np.random.default_rng(0)

    def read(self):
        return super().read() + 1.0 + self.noise * self.chance.normal()


def _bench(plant):
    bench = plant.bench()
    bench.check()
    plant.reads.clear()
    plant.sent.clear()
    return bench


def _plan(hold, levels=LEVELS, **options):
    return Plan(levels, hold, input="voltage [V]", **options)


def _measured(path, bench, plan):
    with Store.create(path, plan, SETUP) as store:
        run(bench, plan, store)
        return store.points(), [store.trace(k) for k in range(len(plan))]


@pytest.mark.parametrize("answer", [0.001, 0.03, 1.0])
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_stored_times_are_true_and_no_constant_is_unsettled(tmp_path, answer, noise):
    plant = Noisy(answer, noise)
    hold = max(1.0, 10 * answer)
    plan = _plan(hold).slowed(answer)
    points, traces = _measured(tmp_path / "a", _bench(plant), plan)
    assert {p.verdict for p in points} <= {"settled", "extrapolated"}
    stored = np.concatenate([t + p.t - p.held for p, (t, _) in zip(points, traces, strict=True)])
    np.testing.assert_allclose(stored, np.array(plant.reads) - plant.sent[0][0], atol=1e-9)
    for point, (t, _) in zip(points, traces, strict=True):
        shortest = 0.25 * hold - plan.sample_interval / 2
        assert shortest <= point.held <= hold + 1e-9
        assert 0 < t[0] < t[-1] <= point.held
        assert point.time_uncertainty == pytest.approx(answer / 2)
        assert point.sample_interval == pytest.approx(plan.sample_interval, rel=0.3)


class Cooling(Plant):
    """The output follows the input in 3 s."""

    def read(self):
        found = super().read()
        return found * (1 - np.exp((self.sent[-1][0] - self.clock.now()) / 3.0))


def test_the_longest_hold_ends_by_the_clock(tmp_path):
    plant = Cooling(0.1)
    points, traces = _measured(tmp_path / "a", _bench(plant), _plan(2.0, [1.0], window=1.0))
    assert points[0].held == pytest.approx(2.0)
    assert traces[0][0].size == 20
    assert points[0].verdict == "unsettled"
    assert plant.reads[-1] - plant.sent[0][0] == pytest.approx(2.0, abs=0.1)


def test_the_shortest_hold_that_is_named_is_possible():
    for answer in (0.001, 0.0123, 0.1, 0.7):
        plant = Noisy(answer)
        with pytest.raises(ParameterError, match="possible is") as refused:
            check_plan(_bench(plant), _plan(4 * answer))
        words = str(refused.value).split("possible is ")[1].split()
        shortest, interval = float(words[0]), float(words[3])
        assert 8 * answer <= shortest <= 10 * answer
        check_plan(_bench(plant), _plan(shortest, sample_interval=interval))
        check_plan(_bench(plant), _plan(20 * answer).slowed(answer))


def test_a_replay_takes_as_long_as_the_holds_took(tmp_path):
    plan = _plan(1.0, sample_interval=0.1)

    def stop(progress):
        if progress.index == 3:
            raise KeyboardInterrupt

    with Store.create(tmp_path / "a", plan, SETUP) as store:
        with pytest.raises(KeyboardInterrupt):
            run(_bench(Noisy(0.1)), plan, store, watch=stop)
        before = store.points()
        again = Noisy(0.1)
        assert run(_bench(again), plan, store) == "replayed"
        held = [point.held for point in before]
        # The second and third level are the same, so that the source is set once for both.
        replayed = [held[0], held[1] + held[2]]
        np.testing.assert_allclose(np.diff([t for t, _ in again.sent])[:2], replayed)
        assert store.points()[:3] == before
        assert store.points()[3].t == pytest.approx(before[-1].t + store.points()[3].held)


class Lag:
    """A lag of 0.3 s; the clock of its records runs on, or begins anew with each call."""

    inputs = (Channel("voltage", "V", 0.0, 100.0),)
    outputs = (Channel("tip", "mm"),)
    tick = 0.01

    def __init__(self, clock, timed=False):
        self.clock, self.timed, self.time, self.output = clock, timed, 0.0, 0.0

    def apply(self, u, duration, sample_interval):
        count = max(1, round(duration / sample_interval))
        t = np.arange(1, count + 1) * (duration / count)
        y = 0.1 * u + (self.output - 0.1 * u) * np.exp(-t / 0.3)
        self.output = y[-1]
        began = {"anew": 0.0, "from zero": -duration / count, "runs on": self.time}[self.clock]
        self.time += duration
        timing = Timing(began, began + duration, 0.0) if self.timed else None
        return Record(np.full(t.size, u), y, t + began, timing=timing)

    def exchange(self, u):
        return float(self.apply(u, self.tick, self.tick).y[-1])

    def safe(self):
        self.apply(0.0, self.tick, self.tick)


@pytest.mark.parametrize(
    ("clock", "timed"),
    [("anew", False), ("from zero", False), ("runs on", False), ("anew", True), ("runs on", True)],
)
def test_times_that_begin_anew_with_each_call_are_joined(tmp_path, clock, timed):
    plan = _plan(10.0, [0.0, 50.0, 100.0, 20.0])
    points, traces = _measured(tmp_path / "a", Lag(clock, timed), plan)
    np.testing.assert_allclose([p.value for p in points], [0.0, 5.0, 10.0, 2.0], atol=0.002)
    assert {p.verdict for p in points} == {"settled"}
    for point, (t, _) in zip(points, traces, strict=True):
        assert (np.diff(t) > 0).all()
        assert t[0] == pytest.approx(plan.sample_interval)
        assert t[-1] == point.held
    assert np.diff([p.t for p in points]) == pytest.approx([p.held for p in points[1:]])
