import numpy as np
import pytest

from minorloop_head.geometry import Mount, Probe
from minorloop_head.ultrasound.field import CalibratedProbe, as_complex, sound_field, sound_speed

PROBE = CalibratedProbe(Probe(), Mount())


def test_a_bare_disc_on_its_axis_is_as_in_the_closed_form():
    field = sound_field(CalibratedProbe(Probe(focus=np.inf), Mount()))
    k = field.wavenumbers
    z = field.steps[1] + field.steps[2] * np.arange(field.table.shape[1])
    edge = np.hypot(z, 2.5e-3)[:, None]
    expected = (np.exp(1j * k * (edge - z[:, None])) - 1) / (1j * k)
    found = as_complex(field.table[0])
    assert np.abs(found - expected).max() < 0.01 * np.abs(expected).max()


def test_it_is_reciprocal_with_its_own_table():
    field = sound_field(PROBE)
    origin, axis = np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0]])
    points = np.array([[field.steps[1] + 3 * field.steps[2], 5 * field.steps[0], 0.0]])
    found = field.at(origin, axis, np.array([points[0, 0]]), points)[0, 0]
    assert found == pytest.approx(field.table[5, 3], rel=1e-6)


def test_a_wall_beside_the_beam_has_no_echo():
    field = sound_field(PROBE)
    origin, axis = PROBE.beams([[np.radians(-25.0), 0.0]])
    spots = PROBE.spots([[np.radians(-25.0), 0.0]])
    heard = field.wall(origin, axis, spots[:, 2].copy(), spots[:, :2].copy(), 10e-3)
    beside = spots[:, :2] + [[0.0, 6e-3]]
    unheard = field.wall(origin, axis, spots[:, 2].copy(), beside, 10e-3)
    assert np.abs(unheard).max() < 1e-3 * np.abs(heard).max()


@pytest.mark.parametrize(("temperature", "speed"), [(0, 1402.4), (20, 1482.3), (74, 1555.1)])
def test_the_speed_of_sound_agrees_with_tabulated_values(temperature, speed):
    assert sound_speed(temperature) == pytest.approx(speed, abs=0.15)
