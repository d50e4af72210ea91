"""Records of a random Preisach plane."""

import numpy as np

from minorloop.operators.preisach import Preisach

LEVELS = np.linspace(-1.2, 1.2, 11)


def a_plane(seed=0, **options):
    weights = np.tril(np.random.default_rng(seed).uniform(0, 1, (10, 10)))
    return Preisach(LEVELS, weights, 3.0, **options)


def a_record(samples=1500, noise=0.005, **options):
    rng = np.random.default_rng(5)
    u = rng.uniform(-1.2, 1.2, samples)
    y = a_plane(**options).simulate(u)
    return u, y + noise * np.ptp(y) * rng.normal(size=samples)
