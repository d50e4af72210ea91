import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from minorloop_head.sources import Shot
from minorloop_head.ultrasound.echoes import (
    average,
    find_echoes,
    front_echo,
    has_wall_echo,
    trace_fault,
)

DT = 10e-9
T = DT * np.arange(2048)
SPEED = 1482.3
WALL = 2 * 8e-3 / SPEED


def echo_at(time, amplitude=0.5):
    width = 0.6 * 10e6 / 2 / np.sqrt(2 * np.log(2))
    lag = T - time
    envelope = np.exp(-0.5 * (2 * np.pi * width * lag) ** 2)
    return amplitude * envelope * np.cos(2 * np.pi * 10e6 * lag)


def shot(trace, t=0.0):
    return Shot(t, np.asarray(trace, dtype=float), DT)


def noisy(seed, clean=0.0, sd=0.01):
    return clean + sd * np.random.default_rng(seed).standard_normal(T.size)


@settings(max_examples=30, deadline=None)
@given(st.floats(5e-6, 18e-6))
def test_the_time_of_a_clean_echo_is_found_between_samples(time):
    (found,) = find_echoes(echo_at(time), DT)
    assert found.time == pytest.approx(time, abs=0.3e-9)


def test_at_20_db_the_time_scatters_by_less_than_2_ns():
    times = [find_echoes(noisy(s, echo_at(WALL), 0.05), DT, most=1)[0].time for s in range(60)]
    assert np.std(np.array(times) - WALL) < 1e-9
    assert abs(np.mean(times) - WALL) < 1e-9


def test_two_echoes_come_in_the_order_of_their_times():
    first, second = find_echoes(echo_at(10e-6, 0.2) + echo_at(11e-6, 0.5), DT)
    assert (first.time, second.time) == pytest.approx((10e-6, 11e-6), abs=2e-9)
    assert second.amplitude == pytest.approx(2.5 * first.amplitude, rel=0.02)


def test_noise_contains_no_echo():
    found = [find_echoes(noisy(seed), DT) for seed in range(20)]
    assert sum(len(echoes) for echoes in found) <= 4
    assert find_echoes(np.zeros(2048), DT) == ()


def test_echoes_outside_of_a_gate_are_ignored():
    trace = echo_at(10e-6) + echo_at(12e-6)
    (found,) = find_echoes(trace, DT, gate=(11e-6, 13e-6))
    assert found.time == pytest.approx(12e-6, abs=1e-9)


@pytest.mark.parametrize(
    ("trace", "fault"),
    [
        (noisy(0, echo_at(WALL)), ""),
        (noisy(0, echo_at(WALL, 3.0)).clip(-1, 1), "clipped"),
        (np.zeros(2048), "dropout"),
        (np.where(T > 12e-6, 0.0, noisy(0, echo_at(WALL))), "dropout"),
        (np.full(2048, np.nan), "not a trace"),
        (np.zeros(50), "not a trace"),
        (np.zeros((4, 2048)), "not a trace"),
    ],
)
def test_the_fault_of_a_trace_is_named(trace, fault):
    assert trace_fault(shot(trace)) == fault


def test_the_modality_follows_the_front_echo():
    wet = [shot(noisy(seed, echo_at(WALL))) for seed in range(5)]
    dry = [shot(noisy(seed)) for seed in range(5)]
    assert has_wall_echo(wet, 8e-3, SPEED)
    assert not has_wall_echo(dry, 8e-3, SPEED)
    assert not has_wall_echo(wet[:2] + dry[:3], 8e-3, SPEED)
    assert not has_wall_echo([], 8e-3, SPEED)
    assert not np.isfinite(front_echo(shot(np.full(2048, np.nan)), 8e-3, SPEED).time)


def test_averaging_lowers_the_noise_by_the_root_of_the_count():
    shots = [shot(noisy(seed, echo_at(WALL))) for seed in range(16)]
    burst = average(shots, np.zeros((16, 2)), np.zeros(16))
    assert burst.used == 16
    assert burst.verdict == ""
    assert burst.noise == pytest.approx(0.01 / 4, rel=0.2)
    assert np.std(burst.trace[300:900]) == pytest.approx(0.01 / 4, rel=0.2)


def test_shots_off_target_untracked_or_bad_are_left_out():
    shots = [shot(noisy(seed, echo_at(WALL))) for seed in range(16)]
    shots[3] = shot(noisy(3, echo_at(WALL + 2e-6)))  # an accident
    shots[4] = shot(np.zeros(2048))
    off = np.zeros(16)
    off[:2] = 0.4e-3, np.nan
    angles = np.column_stack([np.arange(16.0), np.zeros(16)])
    burst = average(shots, angles, off)
    assert burst.used == 12
    assert burst.fired == 16
    assert burst.angles[0] == pytest.approx(np.mean([2, *range(5, 16)]))


def test_a_sonar_that_repeats_itself_is_frozen():
    shots = [shot(noisy(seed, echo_at(WALL))) for seed in range(4)]
    assert average([shots[0]] * 4, np.zeros((4, 2)), np.zeros(4)).verdict == "frozen"
    burst = average([*shots, shots[3], shots[3]], np.zeros((6, 2)), np.zeros(6))
    assert burst.used == 3
    assert burst.noise > 0
