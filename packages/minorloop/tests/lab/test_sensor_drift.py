import numpy as np
import pytest

from minorloop.arrays import uniform_levels
from minorloop.identification.excitation import decaying_staircase
from minorloop.lab.holds import find_holds
from minorloop.lab.records import Record
from minorloop.lab.reduction import reduce
from minorloop.lab.sensor_drift import find_drift
from minorloop.operators.prandtl_ishlinskii import PrandtlIshlinskii

PLAYS = PrandtlIshlinskii(np.linspace(0, 40, 41), 0.44 * np.exp(-np.linspace(0, 3, 41)) / 13)
LEVELS = decaying_staircase(uniform_levels(0, 100, 7))
INTERVAL = 0.1


def log(drift=0.0, *, hold=20.0, rise=2.0, fall=2.0, creep=0.0, seed=1000):
    """Holds with lags of rises and falls, and creep over 30 s, in seconds."""
    u = np.repeat(LEVELS, round(hold / INTERVAL))
    now = crept = 0.0
    y = np.empty(u.size)
    for k, goal in enumerate(PLAYS.simulate(u)):
        now = goal + np.exp(-INTERVAL / (rise if goal > now else fall)) * (now - goal)
        crept += INTERVAL / 30 * (creep * goal - crept)
        y[k] = now + crept
    t = INTERVAL * np.arange(u.size)
    noise = 0.02 * np.random.default_rng(seed).normal(size=t.size)
    return Record(u, y + drift * t / t[-1] + noise, t, "voltage [V]", "distance [um]")


@pytest.mark.parametrize("size", [-8.0, 5.0, 15.0])
def test_a_drift_is_found_with_its_rate(size):
    record = log(size)
    found = find_drift(record.t, record.y, find_holds(record.u), 0.1)
    assert abs(found.rate - size / record.t[-1]) <= 4 * found.sd
    assert found.share == pytest.approx(size / 44, rel=0.25)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"hold": 6.0},
        {"hold": 6.0, "fall": 0.5},
        {"hold": 8.0, "rise": 0.5},
        {"fall": 6.0},
        {"rise": 6.0},
        {"creep": 0.1},
        {"creep": -0.1},
        {"creep": 0.1, "fall": 0.5},
    ],
)
def test_what_remains_of_transients_is_no_drift(options):
    for seed in (1000, 1001):
        record = log(seed=seed, **options)
        assert find_drift(record.t, record.y, find_holds(record.u), 0.1) is None


def test_holds_that_drift_have_not_settled_unless_it_is_subtracted():
    record, still = log(8.0), reduce(log())
    found = reduce(record)
    assert found.count("settled") == 0
    assert found.count("unsettled") == LEVELS.size
    assert "the sensor drifts by 5" in found.notes[0]
    assert "um per hour, 1" in found.notes[0]
    assert "subtract_drift" in found.remedy
    flat = reduce(record, subtract_drift=True)
    assert flat.count("settled") == LEVELS.size
    assert "it was subtracted" in flat.notes[0]
    error = np.abs(flat.record().y - still.record().y)
    sd = [np.hypot(point.sd, point.common_sd) for point in flat.points]
    assert (error <= 4 * np.array(sd) + 0.02).all()
    assert still.drift is None
    assert still.notes == ()
