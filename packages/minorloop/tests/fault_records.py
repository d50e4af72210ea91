"""Records of a bent Prandtl-Ishlinskii plant without faults, and what is found in a record."""

import numpy as np

from minorloop.identification import excitation
from minorloop.identification.curves import Curves
from minorloop.identification.screening import record_faults

RADII = np.linspace(0, 0.3, 10)
SIZE = 400


def plant(u):
    places, y = u[0] + RADII, np.empty(u.size)
    for k, value in enumerate(u):
        places = np.clip(places, value - RADII, value + RADII)
        y[k] = np.tanh(2.0 * (places.mean() - 0.4)) + 0.3 * value
    return y


def sine():
    s = np.linspace(0, 1, SIZE)
    return 0.5 - (0.3 + 0.2 * np.cos(2 * np.pi * s)) * np.cos(2 * np.pi * 9 * s)


INPUTS = {
    "sine": sine(),
    "staircase": excitation.decaying_staircase(np.linspace(0, 1, 11)),
    "levels": np.r_[0, 1, np.random.default_rng(0).uniform(size=250)],
}


def record(shape="sine", unit=1.0, noise=0.003):
    u = INPUTS[shape]
    y = plant(u)
    return u, unit * (y + noise * np.ptp(y) * np.random.default_rng(1).normal(size=u.size))


def kinds(u, y, lag=0, **options):
    whole = Curves.whole("negative")
    return [finding.kind for finding in record_faults(u, y, whole, lag, **options)]
