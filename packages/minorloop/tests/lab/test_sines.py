from dataclasses import replace

import numpy as np
import pytest

from minorloop.connect import connect
from minorloop.errors import InstrumentError, LimitError, ParameterError, StoreError
from minorloop.lab.plan import Plan
from minorloop.lab.records import Quantity, Record
from minorloop.lab.run import check_plan, measured_sines, run
from minorloop.lab.sines import SLOW, Sine, grid
from minorloop.lab.store import Setup, Store
from simulated_plant import Plant

SINE = Sine(0.5, 0.7, 0.1, -1.2, 20.0, 3, 2, 40)
GRID = {"preamble": -1.2, "hold": 20.0}
VOLTAGE = "voltage [V]"


def test_a_grid_has_every_frequency_at_every_amplitude():
    plan = Plan.of_sines(grid([0.1, 1.0], [0.7, 1.0], settling=30.0, **GRID), VOLTAGE)
    assert [(s.frequency, s.amplitude, s.discarded) for s in plan.sines] == [
        *((0.1, 0.7, 3), (0.1, 1.0, 3)),
        *((1.0, 0.7, 30), (1.0, 1.0, 30)),
    ]
    assert plan.input == Quantity("voltage", "V")
    assert plan.duration == 4 * 40 + 2 * 50 + 2 * 32


@pytest.mark.parametrize("frequency", [0.003, 0.0417, 0.3, 1.7])
def test_with_a_tick_every_sample_takes_whole_ticks(frequency):
    (sine,) = grid([frequency], [0.7], samples=50, tick=0.025, **GRID)
    period = 1 / (sine.frequency * 0.025)
    assert sine.ticks(0.025) * sine.samples == pytest.approx(period, rel=1e-9)
    assert abs(sine.frequency / frequency - 1) < 0.5 / 20
    assert sine.samples <= 75


def test_a_written_plan_is_read_back(tmp_path):
    file = tmp_path / "sines.csv"
    plan = Plan.of_sines(grid([1 / 3, 0.1], [0.7], offset=0.2, tick=0.01, **GRID), VOLTAGE)
    plan.to_csv(file)
    assert file.read_text().startswith("frequency [Hz],voltage amplitude [V],voltage offset [V],")
    for again in (Plan.from_csv(file, tolerance=None), Plan.from_json(plan.to_json())):
        assert again.sines == plan.sines
        assert again.difference(plan) == ""
    with pytest.raises(ParameterError, match=r"tolerance is for plans of holds, and .* has sines"):
        Plan.from_csv(file, tolerance=0.1)
    assert not Plan([0.5], 20.0).sines
    changed = Plan.of_sines((plan.sines[0], replace(plan.sines[1], samples=30)), VOLTAGE)
    assert changed.difference(plan) == "sines.1.samples was 30 and is 250 now"


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"frequency": 0.0}, "frequency is 0; give a positive number"),
        ({"amplitude": -1.0}, "amplitude is -1"),
        ({"hold": 0.0}, "hold is 0"),
        ({"offset": np.nan}, "offset is nan"),
        ({"measured": 2.5}, "measured periods are 2.5; give a whole number of at least 2"),
        ({"discarded": 10**6}, "has 40000080 samples, more than 2000000"),
    ],
)
def test_refuses_impossible_sines(change, says):
    with pytest.raises(ParameterError, match=says):
        replace(SINE, **change)


# Sines that are carried out.

BRIEF = {"preamble": -1.2, "hold": 5.0, "samples": 20}


def planned(frequencies, amplitudes, input=VOLTAGE):
    return Plan.of_sines(grid(frequencies, amplitudes, **BRIEF), input)


PLAN = planned([0.2, 1.0], [0.7, 1.0])


class Failing(Plant):
    """Its reading fails after a number of readings."""

    left = np.inf

    def read(self):
        self.left -= 1
        if self.left < 0:
            raise InstrumentError("the meter gave no answer within 2 s")
        return super().read()


def bench(answer=0.0, rate=np.inf, tick=0.05):
    plant = Failing(answer)
    return plant, plant.bench(-1.2, 1.2, rate, tick=tick)


def strip():
    return connect("twin:ipmc", specimen=1001, noise=0.05, seed=3)


def created(path, actuator, plan=PLAN):
    names = str(actuator.inputs[0]), str(actuator.outputs[0])
    return Store.create(path, plan, Setup("twin:ipmc", *names, 1001, 3))


def outputs(store):
    return [one.y for one in measured_sines(store)]


def test_a_bench_gets_every_sample_and_continues_at_the_next_sine(tmp_path):
    plant, actuator = bench()
    with created(tmp_path / "s.sqlite", actuator) as store:
        plant.left = 700  # readings: the second of the four sines is being measured
        with pytest.raises(InstrumentError, match="no answer"):
            run(actuator, PLAN, store)
        assert plant.value == 0.0
        assert len(store) == 1
        plant.left, plant.sent = np.inf, []
        assert run(actuator, PLAN, store) == "fresh"
        assert plant.sent[0][1] == -1.2  # the preamble of the second sine
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
        run(actuator, PLAN, store)
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
    plan = planned([frequency], [amplitude])
    with pytest.raises(error, match=says):
        check_plan(actuator, plan)
    assert plant.sent == []


def test_a_store_of_holds_has_no_sines(tmp_path):
    with created(tmp_path / "h.sqlite", strip(), Plan([0.5], 5.0)) as store:
        with pytest.raises(StoreError, match="settled points and no sines"):
            measured_sines(store)
        with pytest.raises(StoreError, match="belongs to another run"):
            run(strip(), PLAN, store)


@pytest.mark.parametrize("streamed", [False, True])
def test_a_sine_without_readings_stays_open_and_is_measured_by_the_next_call(tmp_path, streamed):
    if streamed:
        plant, actuator = bench(tick=0.01)
        read = actuator.exchange
        actuator.exchange = lambda u: np.nan if len(plant.sent) > 300 else read(u)
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
            run(actuator, PLAN, store)
        assert 0 < len(store) < len(PLAN)
        assert np.isfinite([point.value for point in store.points()]).all()
        del actuator.__dict__["exchange" if streamed else "drive"]
        assert run(actuator, PLAN, store) in ("fresh", "restored")
        assert store.finished
        assert all(np.isfinite(y).all() for y in outputs(store))
