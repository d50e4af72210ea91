"""Bands of outputs beyond what a record switched."""

import numpy as np
import pytest

from fixed_options import Options, Plane, identify
from minorloop import Gaussian, Preisach, Record
from minorloop.operators.densities import GaussianDensity

LEVELS = np.linspace(-1, 1, 25)
MAGNET = Preisach.from_density(LEVELS, GaussianDensity(0.3, 0.25, 0.2))


def curves(ends):
    """Inputs of reversal curves, each from positive saturation."""
    return np.concatenate([np.r_[1.0, np.linspace(end, 1, 30)] for end in ends])


def fitted(levels, **options):
    u = curves(np.linspace(0.9, -0.1, 12))
    y = MAGNET.simulate(u, "positive")
    y += 1e-3 * np.ptp(y) * np.random.default_rng(1000).normal(size=u.size)
    return Options.of({"levels": levels, "start": "positive", **options}).identify(Record(u, y))


@pytest.mark.parametrize("levels", [LEVELS[::2], 12], ids=["over all inputs", "over the record"])
def test_curves_deeper_than_those_fitted_lie_in_their_bands(levels):
    found, deep = fitted(levels), curves([-0.4, -0.6])
    assert found.predict(deep, bands=0.9).covers(MAGNET.simulate(deep, "positive")) >= 0.85


@pytest.mark.parametrize("count", [31, 372], ids=["few samples", "many samples"])
def test_bands_within_the_record_stay_narrow(count):
    found, seen = fitted(LEVELS[::2]), curves([0.5, 0.2])
    u, y = found.u[-count:], found.y[-count:]
    part = identify(Record(u, y, start="positive"), Plane(LEVELS[::2]), prior=Gaussian())
    beyond = part.predict(curves([-0.5]), bands=0.9).half_width.max()
    assert part.predict(seen, bands=0.9).half_width.max() < 0.3 * beyond


def test_what_an_input_beyond_the_levels_switched_is_switched_back_on_the_way_to_the_other_end():
    found = fitted(12)
    low, high = found.model.levels[[0, -1]]
    u = np.array([high, low, high, low - 0.3, 0.4, 0.8, high, 0.4])
    wide = found.predict(u, bands=0.9).half_width
    assert (np.diff(wide[3:7]) < 0).all()
    assert wide[4] > 5 * wide[7]
    assert wide[6] == pytest.approx(wide[2])
