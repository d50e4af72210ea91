import numpy as np
import pytest

from fixed_options import Options, Plane, identify
from minorloop.identification import Smooth
from minorloop.identification.fitting import FitOptions, FitRecord, fit_plane
from minorloop.identification.leave_out import left_out
from minorloop.lab.records import Record
from plane_records import a_plane

LABELS = np.repeat(np.arange(10), 40)


def specimens(seed=1000, scatter=0.05):
    """One plane whose output has another gain in each group."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(-1.2, 1.2, LABELS.size)
    plane = a_plane()
    y = np.concatenate([plane.simulate(u[k == LABELS]) for k in range(10)])
    return u, (y - 3.0) * (1 + scatter * rng.normal(size=10))[LABELS] + 0.05 * rng.normal(size=400)


def inside(found, u, y, labels):
    band = found.predict(u, bands=0.9, curves=labels)
    if not found.grouped:
        band = band.without_noise()
    return (y >= band.lower) & (y <= band.upper)


def covered(u, y, labels, folds, **options):
    """Share of the rows of left-out groups inside bands of fits to the others."""
    names = np.unique(labels)
    rows = []
    for k in range(folds):
        out = np.isin(labels, names[k::folds])
        found = Options.of(options).identify(Record(u[~out], y[~out], curves=labels[~out]))
        rows.append(inside(found, u[out], y[out], labels[out]))
    return float(np.concatenate(rows).mean())


@pytest.mark.parametrize(("prior", "rows", "folds"), [("none", 40, 5), ("gaussian", 8, 2)])
def test_bands_hold_for_groups_that_were_left_out(prior, rows, folds):
    u, y = specimens()
    some = np.arange(u.size) % 40 < rows
    share = covered(u[some], y[some], LABELS[some], folds, levels=4, prior=prior)
    assert 0.85 <= share <= 0.95


def test_a_left_out_group_is_predicted_by_a_fit_that_has_not_seen_it():
    labels = np.repeat(np.arange(5), 40)
    amplitude = np.linspace(1.0, 0.2, 5)[labels]
    u = amplitude * np.cos(2 * np.pi * np.arange(200) / 40)
    y = a_plane().simulate(u)
    levels = np.linspace(-1, 1, 16)
    plain = {"levels": levels, "prior": "none", "smoothness": 0.0}
    found = Options.of(plain).identify(Record(u, y, groups=labels))
    for k in range(5):
        others = Options.of(plain).identify(Record(u, np.where(labels == k, np.nan, y)))
        expected = others.model.simulate(u)[labels == k]
        np.testing.assert_allclose(found.left_out[labels == k], expected, atol=1e-6)


@pytest.mark.parametrize(("options", "close"), [({"prior": "none"}, 1e-9), ({}, 1e-3)])
def test_what_is_left_out_chooses_no_smoothness_and_no_hyperparameters(options, close):
    rng, labels = np.random.default_rng(1001), np.repeat(np.arange(5), 40)
    u = np.linspace(1.0, 0.2, 5)[labels] * np.cos(2 * np.pi * np.arange(200) / 40)
    y = a_plane().simulate(u)
    y += 0.01 * np.ptp(y) * rng.normal(size=200)
    levels = np.linspace(-1, 1, 11)
    found = Options.of({"levels": levels, **options}).identify(Record(u, y, groups=labels))
    for k in range(5):
        out = labels == k
        others = Options.of({"levels": levels, **options}).identify(
            Record(u, np.where(out, np.nan, y))
        )
        expected = others.model.simulate(u)[out]
        assert np.abs(found.left_out[out] - expected).max() <= close * np.ptp(y)


def test_samples_of_no_fold_are_in_all_fits():
    u, y = specimens()
    plain = identify(u, y, Plane(5), prior=Smooth())
    options = FitOptions(prior="none")
    record = FitRecord(u, y, plain.fitted, plain.curves, False)
    found = fit_plane(plain.matrix.spec, record, 0, options)
    said = []
    predicted = left_out(record, found, 0, np.where(LABELS < 5, -1, LABELS % 2), said.append)
    assert said == ["leaving out groups, fit 1 of 2", "leaving out groups, fit 2 of 2"]
    np.testing.assert_array_equal(np.isnan(predicted), LABELS < 5)
