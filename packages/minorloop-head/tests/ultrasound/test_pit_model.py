import numpy as np
import pytest

from minorloop_head.geometry import Mount, Probe
from minorloop_head.ultrasound.field import CalibratedProbe
from minorloop_head.ultrasound.pit_model import NAMES, PitModel, unit_disc
from minorloop_head.ultrasound.pits import raster

PROBE = CalibratedProbe(Probe(), Mount(advance=20e-3))
CENTRE = (0.0, 20e-3)


@pytest.fixture(scope="module")
def model():
    return PitModel(PROBE, raster(PROBE, CENTRE), CENTRE, 0.5e-3)


def pit(**unknowns):
    values = dict.fromkeys(NAMES, 0.0) | {"depth": 0.5e-3, "gain": 1.0} | unknowns
    return np.array([values[name] for name in NAMES])


def test_the_modes_are_orthonormal():
    disc = unit_disc(14.0)
    rings = disc.radial.shape[1]
    areas = disc.weights.reshape(rings, -1)
    radial = disc.radial / areas[:, 0]
    modes = (radial[:, :, None] * disc.waves.T[disc.wave][:, None, :]).reshape(len(radial), -1)
    gram = modes @ (disc.weights[:, None] * modes.T)
    assert gram == pytest.approx(np.eye(len(gram)), abs=5e-3)


def test_a_pit_without_depth_is_a_wall(model):
    left = model.echo(pit(depth=1e-9)) - model.plain
    assert np.abs(left).max() < 0.08 * np.abs(model.plain).max()


def test_a_raster_surrounds_its_centre():
    off = PitModel(PROBE, raster(PROBE, CENTRE), CENTRE, 0.5e-3).off()
    assert off.mean(axis=0) == pytest.approx([0, 0], abs=1e-6)
    assert np.abs(off).max() == pytest.approx(0.8e-3, rel=1e-3)


def test_a_deeper_floor_is_later(model):
    here, deeper = model.echo(pit(gain=1.0)), model.echo(pit(depth=0.52e-3))
    hole = model.echo(pit(gain=0.0))
    middle = int(np.argmin(np.linalg.norm(model.off(), axis=1)))
    late = np.angle((deeper - hole)[middle] / (here - hole)[middle])
    assert late == pytest.approx(2 * model.sound.wavenumbers * 0.02e-3, rel=0.1)


def test_the_slopes_are_those_of_the_echoes(model):
    steps = np.array([2e-6, 2e-6, 2e-3, 0.5e-6, 0.01, 1e-3, 1e-3, 0.5e-6])
    at = pit(around=20e-6, size=0.02, gain=0.9, dish=5e-6)
    at[5:7] = 0.02, -0.01
    found = model.slopes(at, steps)
    for n, step in enumerate(steps):
        moved = at.copy()
        moved[n] += step
        expected = ((model.echo(moved) - model.echo(at)) / step)[model.near]
        assert np.abs(found[n] - expected).max() < 1e-3 * np.abs(expected).max()
