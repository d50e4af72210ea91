import numpy as np
import pytest

from fixed_options import Plane, identify
from minorloop.identification import Smooth
from minorloop.identification.bands import PER_DEVIATION
from minorloop.identification.excitation import decaying_staircase
from minorloop.lab.records import Record
from minorloop.operators.preisach import Preisach
from plane_records import a_plane


def covered(found):
    """Share of the held-out readings within their bands of 90 %."""
    samples = np.flatnonzero(found.held_out)
    off = (found.prediction - found.y)[samples]
    return np.mean(np.abs(off) <= PER_DEVIATION * found.deviation(samples))


@pytest.mark.parametrize("smoothness", ["auto", 0.0])
def test_bands_of_many_random_samples_cover_held_out_ones(smoothness):
    rng = np.random.default_rng(1000)
    model = a_plane(12)
    u = rng.uniform(*model.levels[[0, -1]], 900)
    y = model.simulate(u)
    y += 0.01 * np.ptp(y) * rng.normal(size=u.size)
    found = identify(u, y, Plane(model.levels), prior=Smooth(smoothness), holdout=1 / 3)
    assert found.posterior is None
    assert 0.85 <= covered(found) <= 0.95


@pytest.mark.parametrize("given", ["one", "each", "none"])
def test_bands_of_as_many_unknowns_as_readings_are_no_narrower_than_the_noise(given):
    """A decaying staircase over all six levels determines the plane exactly."""
    model = Preisach(np.linspace(-10, 10, 7), np.tril(np.ones((6, 6))), diagonal="reversible")
    u, noise, shares = decaying_staircase(model.levels), 0.05, []
    future = np.random.default_rng(1000).choice(model.levels, 30)
    for seed in range(1000, 1010):
        rng = np.random.default_rng(seed)
        sd = {"one": noise, "each": np.full(u.size, noise), "none": None}[given]
        y = model.simulate(u) + noise * rng.normal(size=u.size)
        found = identify(
            Record(u, y, sd=sd), Plane(6, diagonal="reversible", signed=True), prior=Smooth(0.0)
        )
        assert found.rmse < 1e-6 * np.ptp(y)
        truth, bands = model.simulate(future), found.predict(future, bands=0.9)
        reading = truth + noise * rng.normal(size=truth.size)
        of_reading = np.hypot(bands.sd, 0.0 if sd is None else noise)
        shares.append(
            [bands.covers(truth), np.mean(np.abs(reading - bands.y) <= PER_DEVIATION * of_reading)]
        )
        assert found.band_sd >= 0.5 * noise
    assert np.mean(shares, axis=0).min() >= 0.85


def test_an_exact_fit_to_readings_without_noise_has_narrow_bands():
    model = Preisach(np.linspace(-10, 10, 7), np.tril(np.ones((6, 6))), diagonal="reversible")
    u = decaying_staircase(model.levels)
    y = model.simulate(u)
    found = identify(Record(u, y, sd=0.0), Plane(6, diagonal="reversible"))
    assert found.band_sd < 1e-3 * np.ptp(y)
