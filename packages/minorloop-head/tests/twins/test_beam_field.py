import numpy as np
import pytest

from minorloop_head.twins.beam_field import beam_of

K = 2 * np.pi * np.array([8e6, 10e6, 12e6]) / 1482.0


def test_an_unfocused_disc_on_its_axis_is_as_in_the_closed_form():
    beam = beam_of(5e-3, np.inf, K, near=7e-3, far=9e-3, off=1e-3)
    z = beam.grid[1] + beam.grid[2] * np.arange(beam.table.shape[1])
    edge = np.hypot(z, 2.5e-3)[:, None]
    expected = 1 - z[:, None] / edge * np.exp(1j * K * (edge - z[:, None]))
    # Of 2; waves steeper than a limit are left out.
    assert np.abs(beam.table[0] - expected).max() < 0.06


def test_a_lens_gathers_the_beam_at_its_focus():
    beam = beam_of(5e-3, 8e-3, K, near=6e-3, far=10e-3, off=1.5e-3)
    z = beam.grid[1] + beam.grid[2] * np.arange(beam.table.shape[1])
    loud = np.abs(beam.table[..., 1])
    assert z[np.argmax(loud[0])] == pytest.approx(8e-3, abs=0.5e-3)
    at_focus = loud[:, np.argmin(np.abs(z - 8e-3))]
    half = np.argmax(at_focus < at_focus[0] / 2) * beam.grid[0]
    # 1.4 wavelengths times focal length over aperture is the full width at half the pressure.
    assert half == pytest.approx(0.7 * 0.148e-3 * 8 / 5, rel=0.1)
