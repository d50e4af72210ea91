import numpy as np
import pytest

from minorloop.identification import excitation, identify
from minorloop.lab.columns import read_columns
from minorloop.operators.preisach import Preisach
from plane_records import LEVELS, a_plane, a_record


@pytest.mark.parametrize("options", [{}, {"smoothness": 0.0}])
@pytest.mark.parametrize("unit", [1e-7, 1.0, 1e6])
def test_a_plane_is_found_from_its_decaying_staircase(options, unit):
    plane, u = a_plane(), excitation.decaying_staircase(LEVELS)
    found = identify(u, unit * plane.simulate(u), levels=LEVELS, **options)
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
    found = identify(u, plane.simulate(u), levels=LEVELS, smoothness=0.0, **wanted)
    np.testing.assert_allclose(found.model.weights, plane.weights, atol=1e-8)
    assert found.model.slope == pytest.approx(plane.slope, abs=1e-8)


def test_samples_not_measured_move_the_memory_only():
    u, y = a_record(noise=0.0)
    gaps = np.random.default_rng(1).uniform(size=y.size) < 0.5
    found = identify(u, np.where(gaps, np.nan, y), levels=LEVELS)
    assert found.samples == np.count_nonzero(~gaps)
    np.testing.assert_allclose(found.model.weights, a_plane().weights, atol=1e-7)


@pytest.mark.parametrize("lag", [0, 3, 11])
def test_a_lag_is_found_and_predicted(lag):
    u, y = a_record()
    late = np.concatenate([np.full(lag, y[0]), y[: y.size - lag]])
    found = identify(u, late, levels=LEVELS, lag="auto")
    assert found.lag == lag
    np.testing.assert_allclose(found.predict(u)[lag:], late[lag:], atol=0.05 * np.ptp(y))


def test_signed_weights_fit_a_butterfly():
    i = np.arange(10)
    butterfly = Preisach(LEVELS, np.tril(1.0 * np.sign(i[:, None] + i - 9)))
    u, _ = a_record()
    y = butterfly.simulate(u)
    plain, signed = (identify(u, y, levels=LEVELS, signed=signed) for signed in (False, True))
    assert signed.nrmse < 1e-6 < 0.1 < plain.nrmse
    np.testing.assert_allclose(signed.model.weights, butterfly.weights, atol=1e-4)
    assert "cannot be inverted" in " ".join(signed.advice)


def test_piezo_minor_loops_are_predicted(shared_data):
    columns = read_columns(
        shared_data / "piezo_micromanipulator_minor_loops.csv", ["input_V", "displacement_um"]
    )
    u, y = (column[200:7000] for column in columns.values())
    found = identify(u, y, levels=25, lag="auto", holdout=2500 / 6800)
    assert found.holdout_nrmse <= 0.008
    assert found.holdout_nrmse < found.baseline_nrmse
