import numpy as np

from minorloop.dynamics.linear import Linear


def test_step_gain_and_phase_are_those_of_the_system():
    system = Linear.from_poles([-0.5], dc_gain=3.0)
    step, gain, phase = (axes.lines[0].get_xydata().T for axes in system.plot().axes)
    np.testing.assert_allclose(step[1], 3 * (1 - np.exp(-step[0] / 2)), atol=1e-9)
    expected = 3 / (1 + 4j * np.pi * gain[0])
    np.testing.assert_allclose(gain[1], 20 * np.log10(np.abs(expected)))
    np.testing.assert_allclose(phase[1], np.degrees(np.angle(expected)))
