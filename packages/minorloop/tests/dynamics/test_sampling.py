import numpy as np
import pytest

from minorloop.dynamics.sampling import checked_stages, pulses, refined, sampled


def sine(t, frequency):
    return np.sin(2 * np.pi * frequency * t + 0.3)


@pytest.mark.parametrize("frequency", [0.05, 0.25, 0.4])
def test_a_sine_below_the_band_edge_is_continued_between_samples(frequency):
    fine = refined(sine(np.arange(300), frequency), 5, "band")
    t = np.arange(fine.size) / 5
    assert np.abs(fine - sine(t, frequency))[200:-200].max() < 2e-7


def test_a_periodic_signal_is_continued_exactly():
    t = np.arange(64)
    u = np.cos(2 * np.pi * 5 * t / 64) + np.cos(2 * np.pi * 32 * t / 64)
    fine = refined(u, 4, "band", periodic=True)
    assert fine.size == 257
    assert fine[::4][:-1] == pytest.approx(u)
    there = np.arange(257) / 4
    wanted = np.cos(2 * np.pi * 5 * there / 64) + np.cos(2 * np.pi * 32 * there / 64)
    assert fine == pytest.approx(wanted)


def test_held_and_straight_signals_are_what_they_are_called():
    u = np.array([1.0, 3.0, 2.0])
    assert refined(u, 2, "straight").tolist() == [1, 2, 3, 2.5, 2]
    assert pulses(u, 2, "held", periodic=False).tolist() == [[3] * 3] * 2 + [[2] * 3] * 2
    assert pulses(u, 1, "straight", periodic=True).tolist() == [[1, 2, 3], [3, 2.5, 2], [2, 1.5, 1]]


def test_a_decimation_keeps_slow_signals_and_their_phase():
    taps = np.full(5, 0.2)
    stages = checked_stages([(2, taps), (3, taps)], 6)
    line = 2.0 + 0.5 * np.arange(61)
    assert sampled(line, stages, 6, periodic=False) == pytest.approx(line[::6])
    slow = np.sin(2 * np.pi * np.arange(60) / 60)
    gain = (1 + 2 * np.cos(np.pi / 30) + 2 * np.cos(np.pi / 15)) / 5
    gain *= (1 + 2 * np.cos(np.pi / 15) + 2 * np.cos(2 * np.pi / 15)) / 5
    turn = np.append(slow, slow[0])
    columns = sampled(np.column_stack([turn, 2 * turn]), stages, 6, periodic=True)
    assert columns == pytest.approx(gain * np.column_stack([slow, 2 * slow])[::6])
