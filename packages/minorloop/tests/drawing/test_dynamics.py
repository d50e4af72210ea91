import numpy as np

from minorloop.dynamics.cascade import Cascade
from minorloop.dynamics.linear import Linear
from minorloop.operators.polynomial import Polynomial


def test_step_gain_and_phase_are_those_of_the_system():
    system = Linear.lags(2.0, dc_gain=3.0)
    step, gain, phase = (axes.lines[0].get_xydata().T for axes in system.plot().axes)
    np.testing.assert_allclose(step[1], 3 * (1 - np.exp(-step[0] / 2)), atol=1e-9)
    expected = 3 / (1 + 4j * np.pi * gain[0])
    np.testing.assert_allclose(gain[1], 20 * np.log10(np.abs(expected)))
    np.testing.assert_allclose(phase[1], np.degrees(np.angle(expected)))


def test_an_inverse_shows_targets_outputs_and_inputs():
    t = np.linspace(0, 1, 5)
    cascade = Cascade(Polynomial([0.0, 2.0], -9.0, 9.0), Linear([1.0], [1.0]))
    found = cascade.invert(t, 2 * t, before=0.0)
    upper, lower = found.plot().axes
    assert [line.get_label() for line in upper.lines] == ["target", "output of the model"]
    np.testing.assert_allclose([line.get_ydata() for line in upper.lines], [2 * t, 2 * t])
    np.testing.assert_allclose(lower.lines[0].get_ydata(), t)
