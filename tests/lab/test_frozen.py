import numpy as np
import pytest

from minorloop.lab.frozen import frozen

RNG = np.random.default_rng(1000)
NOISE = RNG.normal(size=4000)
TIME = np.arange(4000) / 400
SIGNAL = 50 * np.sin(2 * np.pi * TIME)


def test_equal_readings_of_a_noisy_sensor_are_found_with_the_noise():
    y = SIGNAL + NOISE
    y[700:750], y[2000:2030] = y[700], y[2000]
    found = frozen(y)
    assert found.runs == ((700, 750), (2000, 2030))
    assert found.noise == pytest.approx(1, rel=0.1)


def test_a_sensor_that_is_stuck_for_most_of_a_record_is_found():
    y = SIGNAL + NOISE
    y[500:3500] = y[500]
    assert frozen(y).runs == ((500, 3500),)


@pytest.mark.parametrize("step", [0.02, 1.0])
def test_a_stuck_sensor_with_steps_below_its_noise_is_found(step):
    y = np.round((SIGNAL + NOISE) / step) * step
    y[700:760] = y[700]
    ((begin, end),) = frozen(y).runs
    assert begin in range(696, 701)
    assert end in range(760, 764)


@pytest.mark.parametrize("step", [0.0, 1.0, 3.0, 30.0])
def test_a_sensor_with_less_noise_than_its_steps_repeats_itself(step):
    y = np.repeat(40 * np.sin(np.arange(40)), 100) + (NOISE if step else 0.0)
    y = np.round(y / step) * step if step > 1 else np.round(y + 0.1 * NOISE) if step else y
    assert frozen(y).runs == ()


@pytest.mark.parametrize("digits", [2, 4, 12])
def test_a_smooth_signal_that_rests_is_not_stuck(digits):
    rests = np.where((TIME > 3.25) & (TIME < 4.25), SIGNAL[1300], SIGNAL)
    assert frozen(np.round(rests, digits)).runs == ()


def test_short_records_are_not_searched():
    assert frozen(np.ones(30)).runs == ()
    assert frozen(np.zeros(0)).runs == ()
    assert frozen(np.ones(300)).runs == ()
