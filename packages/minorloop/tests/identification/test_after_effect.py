import numpy as np
import pytest

from minorloop import AfterEffect, Preisach, Record, Viscosity, identify
from minorloop.identification.after_effect import Constants, Design, TimedRecord
from minorloop.identification.after_effect_result import along
from minorloop.identification.curves import as_curves
from minorloop.identification.design_matrix import PlaneSpec, pack

BANDS = 5
LEVELS = np.linspace(-1, 1, BANDS + 1)
SPECTRUM = Viscosity(LEVELS, "spectrum", False, times=[0.5, 5.0])


def a_plane(seed=1000):
    rng = np.random.default_rng(seed)
    weights = np.tril(rng.uniform(0.2, 1, (BANDS, BANDS)))
    return Preisach(LEVELS, weights, 0.3, "unipolar", "reversible")


def holds(seed=1000, count=60, short=1.0, long=10.0):
    """Random inputs, each held for a short or a long time and sampled ten times, as t and u."""
    rng = np.random.default_rng(seed)
    length = np.where(rng.random(count) < 0.5, short, long)
    u = np.repeat(rng.uniform(-1, 1, count), 10)
    return np.cumsum(np.repeat(length / 10, 10)), u


def a_record(model, noise=0.0, **options):
    t, u = holds(**options)
    y = model.simulate(t, u)
    return Record(u, y + noise * np.random.default_rng(1001).normal(size=y.size), t)


def creeping():
    plane = a_plane()
    shares = np.stack([0.2 * plane.weights, -0.3 * plane.weights])
    return AfterEffect(plane, times=[0.5, 5.0], creep=shares)


@pytest.fixture(scope="module")
def spectrum():
    return identify(a_record(creeping(), noise=1e-2, count=150), SPECTRUM)


def test_a_spectrum_is_found_and_inverted(spectrum):
    truth = creeping()
    t, u = holds(1002, 12)
    wanted = truth.simulate(t, u)
    assert spectrum.law == "spectrum"
    assert spectrum.without_time > 10 * spectrum.left_out_error
    np.testing.assert_allclose(spectrum.predict(t, u), wanted, atol=5e-3 * np.ptp(wanted))
    assert spectrum.model.monotone
    found = spectrum.invert(t, wanted, unreachable="clip")
    assert found.residual[found.reachable] == pytest.approx(0.0, abs=1e-9)


def test_bands_of_two_runs_contain_another_run():
    truth, (t, u) = creeping(), holds(1010, 40)
    label = np.repeat([0, 1], t.size)
    y = np.concatenate([truth.simulate(t, u) + shift for shift in (-0.02, 0.02)])
    t2, u2 = np.concatenate([t, t[-1] + 1 + t]), np.tile(u, 2)
    record = Record(u2, y, t2, curves=label)
    found, alone = (identify(record.replace(groups=runs), SPECTRUM) for runs in (label, None))
    wide, narrow = (one.predict(t, u, bands=0.9).sd.mean() for one in (found, alone))
    # Student's factor of one degree of freedom is 3.8.
    assert wide > 2 * narrow
    assert found.predict(t, u, bands=0.9).covers(truth.simulate(t, u) + 0.05) >= 0.9


def test_a_fluctuation_field_is_found():
    truth = AfterEffect(a_plane(), 0.03, 30.0)
    record = a_record(truth, noise=1e-4)
    found = identify(record, Viscosity(LEVELS, creep="thermal", rate=False))
    assert found.law == "thermal"
    assert found.model.field[0] == pytest.approx(0.03, rel=0.15)
    assert found.model.settling == pytest.approx(30.0, rel=0.5)
    t, u = holds(1005, 20, long=100.0)
    y = truth.simulate(t, u)
    prediction = found.predict(t, u, bands=0.9)
    np.testing.assert_allclose(prediction.y, y, atol=5e-3 * np.ptp(y))


def reversals(pauses, seed):
    """Curves after each pause at 8 reversals, 0.2 s a row, as t, u and label of the curve."""
    rng = np.random.default_rng(seed)
    steps, u, label = [], [], []
    for pause in pauses:
        for low in np.linspace(0.6, -0.8, 8) + 0.05 * rng.random():
            rise = np.arange(low + 0.1, 0.9, 0.1)
            steps += [500.0, pause + 0.2, *np.full(rise.size, 0.2)]
            u += [low, low, *rise]
            label += [len(label) and label[-1] + 1] * (2 + rise.size)
    return np.cumsum(steps), np.array(u), np.array(label)


def test_a_settling_time_that_two_pauses_do_not_determine_is_in_bands_and_advice():
    truth = AfterEffect(a_plane(), 0.02, 1e4)
    t, u, label = reversals((0.0, 50.0), 1020)
    y = along(truth, t, u, as_curves(label, t.size, "positive", None))
    y += 0.1 * np.random.default_rng(1021).normal(size=y.size)
    found = identify(
        Record(u, y, t, curves=label, start="positive"),
        Viscosity(LEVELS, creep="thermal", rate=False),
    )
    t, u, label = reversals((350.0, 1500.0), 1022)
    wanted = along(truth, t, u, as_curves(label, t.size, "positive", None))
    assert found.predict(t, u, bands=0.9, curves=label).covers(wanted) >= 0.85
    far = [one.settling for one, likely in found.settlings if likely > 0.1]
    assert max(far) > 1e4 > 1e3 > min(far)
    # The pause between curves, of 500 s, is not a hold.
    assert "and no hold is longer than 50.4 s" in str(found)


def test_a_record_without_effect_of_time_keeps_the_plane():
    truth = a_plane()
    t, u = holds()
    y = truth.simulate(u) + 1e-3 * np.random.default_rng(1006).normal(size=t.size)
    found = identify(Record(u, y, t), Viscosity(LEVELS, creep="spectrum"))
    assert found.law == "none"
    assert found.model.times.size == found.model.field.size == 0
    assert "time explains nothing" in str(found)


def test_viscous_relays_are_found_from_two_rates():
    truth = AfterEffect(a_plane(), 20.0, 0.05)
    sweep = np.sin(np.linspace(0, 6 * np.pi, 300)) * np.linspace(1, 0.4, 300)
    u = np.concatenate([sweep, sweep])
    t = np.cumsum(np.repeat([0.02, 0.4], 300))
    found = identify(Record(u, truth.simulate(t, u), t), Viscosity(LEVELS, creep="none", rate=True))
    assert found.law == "viscous"
    assert found.model.settling == pytest.approx(0.05, rel=0.05)


@pytest.mark.parametrize("diagonal", ["uniform", "reversible"])
@pytest.mark.parametrize(("field", "settling"), [(0.03, 30.0), (20.0, 0.5), (0.0, 0.0)])
def test_rows_of_the_design_matrix_are_the_operator(diagonal, field, settling):
    plane = a_plane()
    plane = Preisach(LEVELS, plane.weights, 0.3, "unipolar", diagonal)
    times, creep = (
        ([], []) if settling else ([0.5, 5.0], [0.4 * plane.weights, -0.2 * plane.weights])
    )
    model = AfterEffect(plane, field, settling, times, creep)
    t, u = holds(1013, 6)
    curves = as_curves(np.repeat([0, 1], t.size // 2), t.size, "demagnetised", None)
    record = TimedRecord(t, u, u, np.ones(t.size, dtype=bool), curves)
    spec = PlaneSpec(LEVELS, "unipolar", diagonal)
    constants = Constants(model.field, settling, model.times)
    ((_, rows),) = Design(spec, record, constants).blocks()
    found = np.cumsum([plane.weights, *creep], axis=0)
    unknowns = np.append(np.concatenate([pack(one) for one in found]), plane.offset)
    np.testing.assert_allclose(rows @ unknowns, along(model, t, u, curves), rtol=0, atol=1e-12)


def test_a_change_within_a_gap_is_a_warning():
    t, u = holds(1009, 10, long=1.0)
    t = t + np.where(np.arange(100) >= 50, 30.0, 0.0)
    found = identify(Record(u, u, t), Viscosity(4, creep="none", rate=False))
    assert "changes in 1 gap of the times, first from" in found.warnings[0]
