import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from minorloop import Channel
from minorloop_head.twins.sensor import Sensor, SimulatedFault

TWO = (Channel("pan", "deg"), Channel("tilt", "deg"))


def readings(count, *, noise=0.0, faults=(), pieces=None, seed=1):
    """Readings (count, 2) of the truth 10, 20 + the sample number, one a second."""
    sensor = Sensor(TWO, noise, seed, faults)
    t = np.arange(1.0, count + 1)
    truth = np.array([10.0, 20.0]) + t[:, None]
    cuts = np.cumsum(pieces if pieces else [count])
    parts = zip(np.split(t, cuts[:-1]), np.split(truth, cuts[:-1]), strict=True)
    return np.concatenate([sensor.read(time, y.copy()) for time, y in parts]), truth


@given(st.lists(st.integers(1, 900), min_size=1, max_size=8))
def test_readings_do_not_depend_on_how_they_are_asked_for(pieces):
    faults = (
        SimulatedFault("pan", "stuck", 5.0, 900.0),
        SimulatedFault("tilt", "lost", 3.0, 800.0),
    )
    options = {"noise": 0.3, "faults": faults}
    whole, _ = readings(sum(pieces), **options)
    parts, _ = readings(sum(pieces), pieces=pieces, **options)
    np.testing.assert_array_equal(whole, parts)


def test_noise_is_gaussian_and_independent_between_channels():
    y, truth = readings(20_000, noise=0.3)
    noise = y - truth
    np.testing.assert_allclose(noise.std(axis=0), 0.3, rtol=0.03)
    assert np.all(np.abs(noise.mean(axis=0)) < 0.01)
    assert abs(np.corrcoef(noise.T)[0, 1]) < 0.03
    assert abs(np.corrcoef(noise[1:, 0], noise[:-1, 0])[0, 1]) < 0.03
    assert np.any(readings(10, noise=0.3, seed=2)[0] != y[:10])


def test_a_stuck_sensor_repeats_its_last_reading_and_recovers():
    y, truth = readings(20, noise=0.1, faults=[SimulatedFault("pan", "stuck", 6.0, 11.0)])
    free, _ = readings(20, noise=0.1)
    assert np.all(y[5:10, 0] == free[4, 0])
    np.testing.assert_array_equal(y[:5], free[:5])
    np.testing.assert_array_equal(y[10:], free[10:])
    np.testing.assert_array_equal(y[:, 1], free[:, 1])
    assert truth[9, 0] != y[9, 0]


def test_a_lost_sensor_reads_nan_and_only_that_channel():
    y, truth = readings(10, faults=[SimulatedFault("tilt", "lost", 4.0)])
    np.testing.assert_array_equal(y[:, 0], truth[:, 0])
    assert np.all(np.isnan(y[3:, 1]))
    np.testing.assert_array_equal(y[:3, 1], truth[:3, 1])
