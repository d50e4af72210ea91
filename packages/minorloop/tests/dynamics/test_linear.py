import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from later import Later
from minorloop.dynamics.linear import Linear

signal = Later("scipy.signal")

LAGS = st.lists(st.floats(0.05, 20), min_size=1, max_size=4, unique_by=lambda x: round(x, 2))


def with_zero(times, zero=-0.3, gain=2.0, delay=0.0):
    """Lags with one zero, so that the numerator is no constant."""
    return Linear.from_poles([-1 / x for x in times], [zero], dc_gain=gain, delay=delay)


def ratio(system):
    """Numerator and denominator as scipy likes them."""
    return np.trim_zeros(system.numerator, "f"), system.denominator


@given(LAGS, st.integers(0, 2**32 - 1))
def test_straight_inputs_as_scipy_simulates_them(times, seed):
    system, t = with_zero(times), np.linspace(0, 3 * max(times), 60)
    u = np.random.default_rng(seed).normal(size=t.size)
    got = system.simulate(t, u, between="straight")
    _, wanted, _ = signal.lsim(ratio(system), u, t)
    np.testing.assert_allclose(got, wanted, atol=1e-6 * np.abs(u).max())


@given(LAGS, st.integers(0, 2**32 - 1))
def test_held_inputs_as_the_difference_equation_filters_them(times, seed):
    system, interval = with_zero(times), 0.3
    u = np.random.default_rng(seed).normal(size=50)
    t = interval * np.arange(1, u.size + 1)
    top, bottom, _ = signal.cont2discrete(ratio(system), interval, method="zoh")
    # The filter gives the output when the next input has been set, here it is read just before.
    wanted = signal.lfilter(np.ravel(top), bottom, np.append(u, 0.0))[1:]
    wanted += system.numerator[0] * (u - np.append(u[1:], 0.0))
    for each in (system, system.discretise(interval)):
        np.testing.assert_allclose(each.simulate(t, u), wanted, atol=1e-6)


@pytest.mark.parametrize("between", ["straight", "held"])
def test_uneven_samples_are_where_even_ones_pass(between):
    """Thinned where the input does not bend, or does not change, the outputs stay."""
    system, fine = with_zero([0.4, 2.0], delay=0.35), np.arange(161) * 0.05
    u = np.interp(fine, [0, 1, 2.5, 4, 8], [0.0, 1.0, -1.0, 2.0, 0.5])
    if between == "held":
        u = np.where(fine <= 4.0, 1.0, -0.5)
    thin = [0, 1, 20, 23, 50, 64, 80, 81, 90, 107, 160]
    whole = system.simulate(fine, u, before=0.3, between=between)
    part = system.simulate(fine[thin], u[thin], before=0.3, between=between)
    np.testing.assert_allclose(part, whole[thin], atol=1e-7)


def test_step_response_of_lags_in_closed_form():
    slow, fast, delay = 5.0, 1.5, 0.7
    t = np.linspace(-1, 40, 300)
    since = np.maximum(t - delay, 0)
    wanted = 1 - (slow * np.exp(-since / slow) - fast * np.exp(-since / fast)) / (slow - fast)
    system = Linear.lags(slow, fast, delay=delay)
    np.testing.assert_allclose(system.step_response(t), np.where(t > delay, wanted, 0), atol=1e-7)
    sampled = system.discretise(0.1)
    at = 0.1 * np.arange(400)
    np.testing.assert_allclose(sampled.step_response(at), system.step_response(at), atol=1e-7)


@given(LAGS, st.floats(0, 2))
def test_response_is_that_of_scipy_and_the_dead_time(times, delay):
    system, hertz = with_zero(times, delay=delay), np.geomspace(1e-3, 10, 7)
    _, wanted = signal.freqs(*ratio(system), 2 * np.pi * hertz)
    late = np.exp(-2j * np.pi * hertz * delay)
    np.testing.assert_allclose(system.response(hertz), wanted * late, rtol=1e-9)


@given(LAGS, st.floats(0.02, 2.0), st.integers(0, 5))
@settings(max_examples=25)
def test_continuous_inverts_discretise(times, interval, late):
    times = [x for x in times if x > interval / 4] or [interval]
    times = [x for k, x in enumerate(sorted(times)) if k == 0 or x > 1.3 * sorted(times)[k - 1]]
    system = with_zero(times, delay=late * interval)
    sampled = system.discretise(interval)
    np.testing.assert_allclose(sampled.dc_gain, system.dc_gain, rtol=1e-12)
    again = sampled.continuous()
    np.testing.assert_allclose(again.time_constants, system.time_constants, rtol=1e-4)
    hertz = np.geomspace(0.01, 1, 5) / max(times)
    np.testing.assert_allclose(again.response(hertz), system.response(hertz), rtol=1e-4)
