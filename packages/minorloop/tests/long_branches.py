"""A small record with long branches, for tests of the sparse system."""

import numpy as np

from minorloop.operators.preisach import Preisach


def a_record_with_long_branches(seed=0, ends=12, each=9):
    """A plane of eight bands, a record of ramps, and noisy outputs."""
    rng = np.random.default_rng(seed)
    levels = np.linspace(-1, 1, 9)
    model = Preisach(levels, np.tril(np.exp(-np.subtract.outer(levels[1:], levels[1:]))))
    u = np.interp(np.arange(ends * each) / each, np.arange(ends), rng.uniform(-1, 1, ends))
    y = model.simulate(u)
    return model, u, y + 0.01 * np.ptp(y) * rng.normal(size=u.size)
