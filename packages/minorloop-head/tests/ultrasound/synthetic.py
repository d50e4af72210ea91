"""Bursts of the twin, and fits to spectra that the model itself makes, without a scan."""

import numpy as np

from minorloop_head.geometry import Mount, Probe
from minorloop_head.ultrasound.echoes import average
from minorloop_head.ultrasound.field import CalibratedProbe
from minorloop_head.ultrasound.joint_fit import CENTRE as UNKNOWNS
from minorloop_head.ultrasound.joint_fit import JointFit
from minorloop_head.ultrasound.pit_model import PitModel
from minorloop_head.ultrasound.pits import raster
from minorloop_head.ultrasound.spectra import Spectra

PROBE = CalibratedProbe(Probe(), Mount(roll=-np.pi, advance=20e-3))
CENTRE = (0.0, 20e-3)


def heard(sonar, place, shots=4):
    """A burst of a simulated probe that is turned to a pan and tilt."""
    sonar.look(*place)
    fired = [sonar.shot() for _ in range(shots)]
    return average(fired, np.tile(place, (shots, 1)), np.zeros(shots))


def pit(**changes):
    """Unknowns of a pit of 0.6 mm, with changes by name."""
    names = ("around", "along", "size", "depth", "gain", "tilt_around", "tilt_along", "dish")
    values = dict(zip(names, UNKNOWNS.tolist(), strict=True))
    return np.array(list((values | changes).values()))


def fit_of(unknowns, *, noise=0.01, seed=0):
    """A fit to the echoes of a pit, with noise as a share of the strongest part of a spectrum."""
    model = PitModel(PROBE, raster(PROBE, CENTRE), CENTRE, 0.55e-3)
    k = model.sound.wavenumbers
    echoes = model.echo(unknowns) * np.exp(-0.5 * ((k / k.mean() - 1) / 0.3) ** 2)
    rng, sd = np.random.default_rng(seed), noise * float(np.abs(echoes).max())
    parts = rng.normal(size=(2, *echoes.shape))
    disturbed = echoes + sd * (parts[0] + 1j * parts[1])
    around = np.full(len(echoes), sd), model.angles, np.zeros(len(echoes))
    return JointFit(model, Spectra(disturbed, *around))
