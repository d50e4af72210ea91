from itertools import pairwise

import numpy as np
import pytest

from fixed_options import Options, Plane, identify
from minorloop import PrandtlIshlinskii, Preisach, Record, Smooth
from minorloop.identification import choosing
from minorloop.operators.densities import GaussianDensity
from plane_records import LEVELS, a_plane, a_record

AUTO = dict.fromkeys(("levels", "diagonal", "slope", "lag"), "auto")


def magnet():
    """Field of a magnet over rising currents: nearly linear, with a little hysteresis."""
    peaks = np.arange(50.0, 401.0, 50.0)
    u = np.concatenate([np.r_[np.linspace(0, p, 40)[1:], np.linspace(p, 0, 40)[1:]] for p in peaks])
    radii, places = np.linspace(2, 40, 12), np.zeros(12)
    y = np.empty(u.size)
    for k, current in enumerate(u):
        places = np.clip(places, current - radii, current + radii)
        y[k] = 1e-3 * current + 1e-4 * places.mean()
    return u, y + 1e-5 * np.random.default_rng(1000).normal(size=u.size)


def test_a_slope_is_chosen_where_the_output_is_nearly_linear():
    u, y = magnet()
    options = {"levels": 12, "start": "demagnetised", "holdout": 0.3, "prior": "none"}
    plain, chosen = (
        Options.of(options).identify(Record(u, y)),
        Options.of({"slope": "auto", **options}).identify(Record(u, y)),
    )
    assert chosen.model.slope > 0
    assert chosen.holdout_nrmse < 0.2 * plain.holdout_nrmse
    (choice,) = chosen.choices
    assert choice.name == "structure"
    assert choice.error < choice.other_error
    assert str(choice) in str(chosen)


def test_a_reversible_diagonal_is_chosen_where_small_loops_have_no_area():
    rng = np.random.default_rng(1)
    u = np.repeat(rng.uniform(-1.2, 1.2, 500), 2) + np.tile([0, 0.1], 500)
    u = np.clip(u, -1.2, 1.2)
    y = a_plane(diagonal="reversible").simulate(u) + 0.05 * rng.normal(size=u.size)
    assert identify(u, y, Plane(LEVELS, diagonal="auto")).model.diagonal == "reversible"


def test_rows_of_one_group_are_compared_in_contiguous_parts(monkeypatch):
    monkeypatch.setattr(choosing, "_MOST_ROWS", 150)
    u, y = a_record(300)
    found = identify(
        Record(u, y, groups=np.arange(300) >= 200), Plane(5, slope="auto"), prior=Smooth(0.0)
    )
    assert [one.name for one in found.choices] == ["structure"]


def test_lags_are_compared_on_the_same_rows_of_curves():
    u, label = reversal_curves()
    y = a_magnet().simulate(u)[label >= 0]
    u, label = u[label >= 0], label[label >= 0]
    options = {"levels": 8, "curves": label, "start_of_curve": "negative", "smoothness": 0.0}
    found = Options.of({"lag": "auto", **options}).identify(Record(u, y))
    assert found.lag == 0
    late = Options.of({"lag": 2, **options}).identify(Record(u, y))
    assert np.count_nonzero(late.fitted) == late.samples == u.size - 2 * 24
    said = " ".join(late.advice)
    assert f"the lag of 2 samples leaves {2 * 24} of {u.size} samples out" in said
    assert "samples out" not in " ".join(found.advice)


def test_a_lag_does_not_make_up_for_wide_bands(shared_data):
    table = np.genfromtxt(
        shared_data / "forc_msm33.csv", delimiter=",", names=True, dtype=None, encoding="utf-8"
    )
    table = table[(table["kind"] == "curve") & (table["curve"] % 6 == 1)]
    record = Record(
        table["field_T"], table["moment_Am2"], curves=table["curve"], start_of_curve="positive"
    )
    found = identify(record, Plane(**AUTO))
    assert found.lag == 0
    assert found.nrmse < 1.5e-3


def swings():
    """Triangles of decreasing amplitude, all at one rate."""
    ends = np.linspace(1, 0.1, 15) * np.tile([-1, 1], 8)[:15]
    return np.concatenate([np.arange(a, b, np.sign(b - a) * 0.02) for a, b in pairwise(ends)])


def duhem(u):
    """Outputs by y' = 3 |u'| (u - y), from 0 on: no loop is congruent, no rate counts."""
    y = np.zeros(u.size)
    for k, step in enumerate(np.diff(u)):
        y[k + 1] = u[k + 1] + (y[k] - u[k + 1]) * np.exp(-3 * abs(step))
    return y


def test_hysteresis_that_is_no_plane_gets_no_lag():
    found = identify(swings(), duhem(swings()), Plane(25, lag="auto"), holdout=0.3)
    assert found.lag == 0
    assert found.choices[0].other.endswith(choosing.TRAVEL)


def test_a_lag_that_may_be_hysteresis_is_said():
    u = swings()
    y = PrandtlIshlinskii([0.0, 0.2], [1.0, 1.0]).simulate(u)
    found = identify(u, np.r_[np.full(10, y[0]), y[:-10]], Plane(25, lag="auto"))
    assert abs(found.lag - 10) <= 1
    assert "at other rates the output may be predicted late" in " ".join(found.advice)


def a_magnet():
    return Preisach.from_density(np.linspace(-1, 1, 25), GaussianDensity(0.3, 0.3, 0.3))


def reversal_curves():
    """Inputs of 24 curves up to 1, each after saturation; its label, or -1 in the saturation."""
    ends = np.linspace(-1, 1, 25)
    curves = [ends[k:] for k in range(23, -1, -1)]
    u = np.concatenate([np.append(1.0, curve) for curve in curves])
    label = np.concatenate([[-1, *[k] * curve.size] for k, curve in enumerate(curves)])
    return u, label


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
