import numpy as np
import pytest

from minorloop.connect import connect
from minorloop.errors import InstrumentError, LimitError, ParameterError, StoreError
from minorloop.lab.actuator import Channel
from minorloop.lab.drivers.bench import Bench
from minorloop.lab.plan import Plan
from minorloop.lab.records import Record
from minorloop.lab.sine_run import SLOW, check_sines, measured_sines, run_sines, sine_design
from minorloop.lab.sines import SinePlan
from minorloop.lab.store import Setup, Store

GRID = {"preamble": -1.2, "hold": 5.0, "samples": 20, "input": "voltage [V]"}
PLAN = SinePlan.grid([0.2, 1.0], [0.7, 1.0], **GRID)


class Clock:
    def __init__(self):
        self.time = 0.0

    def now(self):
        return self.time

    def sleep(self, seconds):
        self.time += seconds


class Plant:
    """An output of twice the input; reading fails after a number of readings."""

    def __init__(self, clock, answer=0.0):
        self.clock, self.answer = clock, answer
        self.value, self.left, self.applied = 0.0, np.inf, []

    def set(self, value):
        self.value = value
        self.applied.append(value)

    def safe(self):
        self.value = 0.0

    def read(self):
        self.clock.sleep(self.answer)
        self.left -= 1
        if self.left < 0:
            raise InstrumentError("the meter gave no answer within 2 s")
        return 2.0 * self.value


def bench(answer=0.0, rate=np.inf, tick=0.05):
    clock = Clock()
    plant = Plant(clock, answer)
    voltage, tip = Channel("voltage", "V", -1.2, 1.2, rate), Channel("tip", "mm", -5.0, 5.0)
    return plant, Bench(plant, plant, voltage, tip, clock=clock, tick=tick)


def strip():
    return connect("twin:ipmc", specimen=1001, noise=0.05, seed=3)


def created(path, actuator, plan=PLAN):
    names = str(actuator.inputs[0]), str(actuator.outputs[0])
    setup = Setup("twin:ipmc", *names, 1001, 3, {}, sine_design(plan, actuator))
    return Store.create(path, plan.holds(), setup)


def outputs(store):
    return [one.y for one in measured_sines(store)]


class Enough(Exception):
    pass


def after(count):
    def watch(progress):
        if progress.point is not None and progress.index == count - 1:
            raise Enough

    return watch


def test_a_stopped_run_on_a_twin_ends_like_one_that_was_not(tmp_path):
    with created(tmp_path / "whole.sqlite", strip()) as store:
        assert run_sines(strip(), store) == "fresh"
        whole = outputs(store)
    with created(tmp_path / "parts.sqlite", strip()) as store:
        with pytest.raises(Enough):
            run_sines(strip(), store, watch=after(2))
        assert len(store) == 2
        assert run_sines(strip(), store) == "restored"
        assert run_sines(strip(), store) == "finished"
        for one, other in zip(whole, outputs(store), strict=True):
            np.testing.assert_array_equal(one, other)


def test_a_bench_gets_every_sample_and_continues_at_the_next_sine(tmp_path):
    plant, actuator = bench()
    with created(tmp_path / "s.sqlite", actuator) as store:
        plant.left = 700  # readings: the second of the four sines is being measured
        with pytest.raises(InstrumentError, match="no answer"):
            run_sines(actuator, store)
        assert plant.value == 0.0
        assert len(store) == 1
        plant.left, plant.applied = np.inf, []
        assert run_sines(actuator, store) == "fresh"
        assert plant.applied[0] == -1.2  # the preamble of the second sine
        for one in measured_sines(store):
            np.testing.assert_allclose(one.y, 2 * one.u, atol=1e-12)
            assert one.held
            assert one.slow == pytest.approx(1.0)
        assert [session.end for session in store.sessions()][1] == "finished"
    assert plant.value == 0.0


def test_a_bench_that_took_longer_than_planned_is_found(tmp_path, monkeypatch):
    plant, actuator = bench()
    with created(tmp_path / "s.sqlite", actuator) as store:
        monkeypatch.setattr(plant, "set", lambda value: plant.clock.sleep(0.06))
        run_sines(actuator, store)
        assert all(one.slow > SLOW for one in measured_sines(store))


@pytest.mark.parametrize(
    ("frequency", "amplitude", "options", "error", "says"),
    [
        (0.5, 1.5, {}, LimitError, r"sine 1 \(0.5 Hz\): voltage -1.5 V is beyond the limits"),
        (2.0, 1.0, {}, ParameterError, "a tick of 0.05 s is too slow for 20 samples in a period"),
        (0.7, 1.0, {}, ParameterError, "a sample must take a whole number of ticks; plan the sin"),
        (1.0, 1.0, {"rate": 5.0}, LimitError, "faster than the limit 5 V/s; lower its amplitude"),
        (1.0, 1.0, {"answer": 0.1}, ParameterError, "the meter takes 0.1 s for an answer"),
    ],
)
def test_what_a_bench_cannot_do_is_refused_before(frequency, amplitude, options, error, says):
    plant, actuator = bench(**options)
    plan = SinePlan.grid([frequency], [amplitude], **GRID)
    with pytest.raises(error, match=says):
        check_sines(actuator, plan)
    assert plant.applied == []


def test_a_source_that_writes_few_digits_is_found():
    plant, actuator = bench()
    plant.written = lambda value: round(value, 2)
    with pytest.raises(ParameterError, match="write more digits"):
        check_sines(actuator, PLAN)


def test_another_unit_is_refused():
    plan = SinePlan.grid([1.0], [0.5], **{**GRID, "input": "current [A]"})
    with pytest.raises(ParameterError, match="the plan is for 'current"):
        check_sines(strip(), plan)


def test_a_store_of_holds_or_of_another_kind_of_actuator_is_refused(tmp_path):
    holds = Store.create(
        tmp_path / "h.sqlite", Plan([0.5], 5.0), Setup("twin:ipmc", "voltage [V]", "tip [mm]")
    )
    with holds, pytest.raises(StoreError, match="settled points and no sines"):
        run_sines(strip(), holds)
    sines = created(tmp_path / "s.sqlite", strip())
    with sines, pytest.raises(StoreError, match="another kind of actuator"):
        run_sines(bench()[1], sines)


@pytest.mark.parametrize("streamed", [False, True])
def test_a_sine_without_readings_stays_open_and_is_measured_by_the_next_call(tmp_path, streamed):
    if streamed:
        plant, actuator = bench(tick=0.01)
        read = actuator.exchange
        actuator.exchange = lambda u: np.nan if len(plant.applied) > 300 else read(u)
    else:
        actuator = strip()
        drive = actuator.drive

        def lost(t, u):
            record = drive(t, u)
            y = np.where(record.t > 40.0, np.nan, record.y)
            return Record(record.u, y, record.t, record.inputs, record.outputs)

        actuator.drive = lost
    with created(tmp_path / "a", actuator) as store:
        with pytest.raises(InstrumentError, match=r"sine \d \(.* no reading in \d+ of the 40 samp"):
            run_sines(actuator, store)
        assert 0 < len(store) < len(PLAN)
        assert np.isfinite([point.value for point in store.points()]).all()
        del actuator.__dict__["exchange" if streamed else "drive"]
        assert run_sines(actuator, store) in ("fresh", "restored")
        assert store.finished
        assert all(np.isfinite(y).all() for y in outputs(store))
