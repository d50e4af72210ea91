import numpy as np
import pytest

from fixed_options import Plane, identify
from minorloop import Gaussian, Preisach, Record, Smooth

TRUTH = Preisach(np.linspace(-1, 1, 5), np.tril(np.ones((4, 4))))
U = np.array([-1.0, 0.6, -0.4, 1.0, -1.0, 0.1, -0.7, 0.9, -1.0])


@pytest.fixture(scope="module")
def fit():
    y = TRUTH.simulate(U) + 0.1 * U**2
    return identify(U, y, Plane(4), prior=Smooth(0.1))


def test_record_and_residual_are_those_of_the_identification(fit):
    _, _, record, residual = fit.plot().axes[:4]
    measured, model = (line.get_ydata() for line in record.lines)
    np.testing.assert_array_equal(measured, fit.y)
    np.testing.assert_array_equal(model, fit.prediction)
    share = 100 * (fit.prediction - fit.y) / np.ptp(fit.y)
    np.testing.assert_allclose(residual.lines[0].get_ydata(), share)


@pytest.mark.parametrize("prior", [Smooth(0.1), Gaussian()])
def test_cells_that_are_not_excited_are_grey(prior):
    found = identify(U[:3], TRUTH.simulate(U[:3]), Plane(4), prior=prior)
    plane = found.plot().axes[1]
    grey = np.ma.masked_array(plane.collections[1].get_array()).reshape(4, 4)
    unexcited = np.tril(~found.excited)
    assert unexcited.any()
    np.testing.assert_array_equal(~np.ma.getmaskarray(grey), unexcited)
    assert "grey" in plane.get_title()


def test_no_line_joins_points_across_rows_that_are_not_measured():
    u = np.tile(U, 50)
    y = TRUTH.simulate(u)
    y[100:120] = np.nan
    for found in (
        identify(u, y, Plane(4), prior=Smooth(0.1)),
        identify(u, y, Plane(4, lag=2), prior=Smooth(0.1)),
    ):
        for line in found.plot().axes[0].lines:
            gaps = np.flatnonzero(np.isnan(line.get_ydata()))
            np.testing.assert_array_equal(gaps, np.arange(100, 120) - found.lag)


def test_curves_are_drawn_with_their_rms_and_largest_errors():
    labels = np.repeat(np.arange(12), 9)
    found = identify(
        Record(np.tile(U, 12), np.tile(TRUTH.simulate(U), 12), curves=labels, skip=1), Plane(4)
    )
    rms, largest, left_out = found.plot(part="curves").axes[0].lines
    errors = [one.accuracy for one in found.curve_accuracy]
    np.testing.assert_allclose(rms.get_ydata(), [100 * one.nrmse for one in errors])
    np.testing.assert_allclose(largest.get_ydata(), [100 * abs(one.worst) for one in errors])
    assert np.isfinite(left_out.get_ydata()).all()
