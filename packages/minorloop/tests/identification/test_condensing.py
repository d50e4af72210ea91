import numpy as np
import pytest

from fixed_options import Options
from minorloop.identification import condensing, fitting
from minorloop.identification.condensing import condense
from minorloop.lab.records import Record
from plane_records import LEVELS, a_plane


def slow(samples=2000, seed=0):
    rng = np.random.default_rng(seed)
    s = np.linspace(0, 1, samples)
    u = 1.2 * (0.4 + 0.6 * np.cos(3 * s)) * np.sin(60 * s)
    u[250:300] = u[250]  # a hold
    y = a_plane().simulate(u) + 0.1 * rng.normal(size=samples)
    y[rng.uniform(size=samples) < 0.1] = np.nan
    return u, y


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"diagonal": "reversible", "slope": True, "lag": 2},
        {"relay": "unipolar", "start": "positive", "skip": 7},
        {"curves": np.repeat([0, 1, 2, 3], 500), "start_of_curve": "positive"},
    ],
)
def test_a_condensed_record_has_the_same_fit(options, monkeypatch):
    u, y = slow()
    whole = Options.of({"levels": LEVELS, "smoothness": 1e-5, **options}).identify(Record(u, y))
    monkeypatch.setattr(condensing, "LONG", 500)
    monkeypatch.setattr(fitting, "LONG", 500)
    short = Options.of({"levels": LEVELS, "smoothness": 1e-5, **options}).identify(Record(u, y))
    assert short.matrix.samples < 0.5 * whole.matrix.samples
    assert short.samples == whole.samples
    assert (short.rank, short.excited_fraction) == (whole.rank, whole.excited_fraction)
    np.testing.assert_allclose(short.model.weights, whole.model.weights, atol=1e-7)
    assert short.rmse == pytest.approx(whole.rmse)
    if whole.groups_nrmse is not None:
        assert short.groups_nrmse == pytest.approx(whole.groups_nrmse)


def test_short_records_and_inputs_beyond_the_levels_are_left_alone(monkeypatch):
    u = np.linspace(0, 1, 50)
    seen = np.ones(50, dtype=bool)
    assert condense(np.array([0.0, 1.0]), "negative", u, u, seen) is None
    monkeypatch.setattr(condensing, "LONG", 10)
    assert condense(np.array([0.0, 0.5]), "negative", u, u, seen) is None
