import numpy as np
import pytest

from fixed_options import Options, Plane, identify
from minorloop import Preisach, Record, excitation
from plane_records import LEVELS, a_plane, a_record


@pytest.mark.parametrize("options", [{}, {"smoothness": 0.0}])
@pytest.mark.parametrize("unit", [1e-7, 1.0, 1e6])
def test_a_plane_is_found_from_its_decaying_staircase(options, unit):
    plane, u = a_plane(), excitation.decaying_staircase(LEVELS)
    found = Options.of({"levels": LEVELS, **options}).identify(Record(u, unit * plane.simulate(u)))
    error = np.abs(found.model.weights - unit * plane.weights).max()
    assert error <= 1e-10 * unit * plane.weights.max()
    assert (found.rank, found.unknowns, found.samples) == (56, 56, 56)
    assert found.condition == pytest.approx(73, rel=0.02)
    assert found.kkt < 1e-10
    assert found.model.offset == pytest.approx(unit * 3.0)


@pytest.mark.parametrize(
    "options", [{"relay": "unipolar"}, {"diagonal": "reversible"}, {"slope": 0.7}]
)
def test_every_other_structure_is_found_too(options):
    plane, u = a_plane(**options), excitation.decaying_staircase(LEVELS)
    u = np.concatenate([u, np.random.default_rng(0).uniform(-1.2, 1.2, 200)])
    wanted = {**options, "slope": True} if "slope" in options else options
    found = Options.of({"levels": LEVELS, "smoothness": 0.0, **wanted}).identify(
        Record(u, plane.simulate(u))
    )
    np.testing.assert_allclose(found.model.weights, plane.weights, atol=1e-8)
    assert found.model.slope == pytest.approx(plane.slope, abs=1e-8)


@pytest.mark.parametrize("lag", [0, 3, 11])
def test_a_lag_is_found_and_predicted(lag):
    u, y = a_record()
    late = np.concatenate([np.full(lag, y[0]), y[: y.size - lag]])
    found = identify(u, late, Plane(LEVELS, lag="auto"))
    assert found.lag == lag
    predicted = found.predict(u)
    np.testing.assert_allclose(predicted[lag:], late[lag:], atol=0.05 * np.ptp(y))
    np.testing.assert_array_equal(found.predict(np.array([u, u])), [predicted, predicted])
    assert found.predict([]).size == found.predict([], bands=0.9).y.size == 0


def test_signed_weights_fit_a_butterfly():
    i = np.arange(10)
    butterfly = Preisach(LEVELS, np.tril(1.0 * np.sign(i[:, None] + i - 9)))
    u, _ = a_record()
    y = butterfly.simulate(u)
    plain, signed = (identify(u, y, Plane(LEVELS, signed=signed)) for signed in (False, True))
    assert signed.nrmse < 1e-6 < 0.1 < plain.nrmse
    np.testing.assert_allclose(signed.model.weights, butterfly.weights, atol=1e-4)
    assert not any("signed=True" in sentence for sentence in signed.advice)
    assert "cannot be inverted" in " ".join(signed.advice)


@pytest.mark.parametrize(
    ("rows", "options"),
    [(400, {"prior": "none"}), (400, {"smoothness": 1e-6}), (90, {"prior": "gaussian"})],
)
def test_outputs_count_by_their_standard_deviations(rows, options):
    u, y = a_record(noise=0.0)
    u, y, chance = u[:rows], y[:rows], np.random.default_rng(1000)
    sd = np.where(chance.uniform(size=u.size) < 0.5, 0.01, 1.0)
    rough = y + sd * chance.normal(size=u.size)
    alike, weighted = (
        Options.of({"levels": LEVELS, "noise": noise, **options}).identify(Record(u, rough))
        for noise in (None, sd)
    )
    errors = [np.sqrt(np.mean((found.prediction - y) ** 2)) for found in (alike, weighted)]
    assert errors[1] < 0.5 * errors[0]
    assert weighted.samples == u.size
