import numpy as np
import pytest

from minorloop import Cascade, Linear, Preisach, SignalError
from minorloop.identification.sine_response import (
    SinePeriods,
    logged_periods,
    measured_periods,
    sine_response,
)
from minorloop.lab.sines import MeasuredSine, grid

G = Linear.from_poles([-20.0, -1.5], [-1.0])
PLANE = Preisach(np.linspace(-1, 1, 9), np.tril(np.random.default_rng(0).uniform(0, 1, (8, 8))))
PLAN = grid([0.1, 0.5], [0.4, 0.8], preamble=-1.0, hold=10.0, settling=8.0)


def applied(sine):
    """Times and inputs of a sine with its preamble, and which samples are those of the sine."""
    t = 2 * sine.hold + sine.interval * np.arange(1, sine.count + 1)
    t = np.concatenate([[0.0, sine.hold - 1e-3, sine.hold, 2 * sine.hold], t])
    levels = np.repeat([sine.preamble, sine.offset], 2)
    return t, np.concatenate([levels, sine.inputs])


def measured(sine):
    """A sine measured on the operator followed by the linear system."""
    t, u = applied(sine)
    y = Cascade(PLANE, G).simulate(t, u, between="straight")
    return MeasuredSine(sine, sine.inputs, y[4:], held=False)


@pytest.fixture(scope="module")
def sines():
    return [measured(sine) for sine in PLAN]


def test_behind_the_operator_gains_are_those_of_the_linear_system(sines):
    response = sine_response([measured_periods(one, PLANE) for one in sines])
    np.testing.assert_array_equal(response.amplitudes, [0.4, 0.8])
    expected = np.broadcast_to(G.response(response.frequencies), (2, 2))
    np.testing.assert_allclose(response.after, expected, rtol=2e-3)
    spread = response.gain_spread()
    assert spread.before > 1
    assert spread.ratio < 0.01
    assert response.advice == ()


@pytest.mark.parametrize("rows_between", [True, False])
def test_a_log_gives_the_gains_of_its_last_whole_periods(sines, rows_between):
    parts, end = [], 0.0
    for one in sines[:1] if not rows_between else sines:
        t, u = applied(one.sine)
        cut = slice(0, t.size - 100)  # the log ends within a period
        f = np.r_[np.zeros(4), np.full(t.size - 4, one.sine.frequency)]
        parts.append([a[cut] for a in (end + t, u, np.r_[np.zeros(4), one.y], f)])
        end += t[-1]
    log = [np.concatenate(columns) for columns in zip(*parts, strict=True)]
    found = logged_periods(*log, PLANE)
    assert [one.frequency for one in found] == [one.sine.frequency for one in sines[: len(found)]]
    response = sine_response(found)
    expected = np.broadcast_to(G.response(response.frequencies), response.after.shape)
    np.testing.assert_allclose(response.after, expected, rtol=3e-3)
    np.testing.assert_allclose(response.amplitudes, [0.4, 0.8][: len(response.amplitudes)])


def test_held_inputs_are_corrected_for_their_delay():
    """A fast sampled lag: with the correction 24 samples of a period give its gain and phase."""
    turn = 2 * np.pi * np.arange(1, 24 * 12 + 1) / 24
    u, system = np.sin(turn), Linear.lags(0.4)
    fine = np.repeat(u, 50)
    t = np.arange(1, fine.size + 1) / (24 * 50)
    y = system.simulate(t, fine)[49::50][-48:]
    held = SinePeriods(1.0, 1.0, 0.0, 2, u[-48:], y, held=True)
    np.testing.assert_allclose(held.gains()[0], system.response([1.0])[0], rtol=0.02)
    plain = SinePeriods(1.0, 1.0, 0.0, 2, u[-48:], y)
    assert abs(plain.gains()[0] / system.response([1.0])[0] - 1) > 0.1


def test_frequencies_without_every_amplitude_are_left_out(sines):
    response = sine_response([measured_periods(one) for one in sines[:3]])
    assert response.frequencies.tolist() == [0.1]
    assert list(response.notes) == ["0.5 Hz left out: not measured at every amplitude"]
    with pytest.raises(SignalError, match="no frequency is measured at all of the 2 amplitudes"):
        sine_response([measured_periods(sines[0]), measured_periods(sines[3])])
    with pytest.raises(SignalError, match="no sine is finished yet"):
        sine_response([])


def test_a_dead_sensor_is_found(sines):
    one = sines[0]
    still = MeasuredSine(one.sine, one.u, np.full(one.y.size, 2.5), held=False)
    with pytest.raises(SignalError, match=r"output does not oscillate at 0\.1 Hz"):
        sine_response([measured_periods(still)])


def test_gaps_in_the_output_are_found(sines):
    one = sines[0]
    lost = MeasuredSine(one.sine, one.u, np.where(one.u > 0.39, np.nan, one.y), held=False)
    with pytest.raises(SignalError, match="has gaps in its output"):
        sine_response([measured_periods(lost)])
