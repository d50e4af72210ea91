import numpy as np
import pytest

from fixed_options import Plane, identify
from minorloop import Gaussian, Preisach, Record, Smooth
from minorloop.drawing import identification

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


def test_the_axes_are_scaled_to_what_was_fitted():
    y = np.tile(TRUTH.simulate(U), 3)
    y[12], y[20] = 9.9e37, 500.0  # a code and an outlier
    record, residual = identify(np.tile(U, 3), y, Plane(4)).plot().axes[2:4]
    assert max(map(abs, record.get_ylim())) < 2 * np.ptp(TRUTH.simulate(U))
    assert max(map(abs, residual.get_ylim())) < 100
    assert "1 row outside, not fitted" in [text.get_text() for text in residual.texts]


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


def test_a_line_does_not_cross_a_leap_of_the_input():
    u = np.tile(np.linspace(-1, 1, 60), 8)
    line = identify(u, u, Plane(4), prior=Smooth(0.1)).plot().axes[0].lines[1]
    leaps = np.flatnonzero(np.abs(np.diff(u)) > 1) + 1
    np.testing.assert_array_equal(
        np.flatnonzero(np.isnan(line.get_xdata())), leaps + np.arange(leaps.size)
    )


def test_the_density_has_a_unit(fit):
    figure = fit.plot(input_label="voltage [V]", output_label="curvature [1/m]")
    assert "density [1/m / V²]" in [axes.get_ylabel() for axes in figure.axes]


def test_a_figure_for_a_talk_has_the_names_of_the_record_and_the_error():
    record = Record(U, TRUTH.simulate(U), inputs="voltage [V]", outputs="length [um]")
    figure = identify(record, Plane(4), holdout=0.3).plot(part="talk")
    assert figure.axes[0].get_xlabel() == "voltage [V]"
    assert "rows that were not fitted" in figure.get_suptitle()


def test_a_notebook_shows_a_figure_without_a_magic_line(fit):
    assert fit.plot()._repr_png_().startswith(b"\x89PNG")


def test_a_notebook_shows_the_last_samples_of_a_long_record(fit, monkeypatch):
    monkeypatch.setattr(identification, "_MOST_DRAWN", 5)
    axes = identification.draw_loop_and_plane(fit).axes[0]
    np.testing.assert_array_equal(axes.lines[0].get_ydata(), fit.y[-5:])
    assert axes.get_title() == "Loop, last 5 samples"


def test_of_many_dots_those_that_can_be_told_apart_are_drawn(monkeypatch):
    monkeypatch.setattr(identification, "_MOST_DRAWN", 5)
    u = np.tile(np.append(np.linspace(-1, 1, 20), np.linspace(1, -1, 20)), 30)
    y = TRUTH.simulate(u)
    y[700] += 100
    found = identify(u, y, Plane(4), prior=Smooth(0.1))
    dots = found.plot().axes[0].lines[0]
    points = list(zip(dots.get_xdata(), dots.get_ydata(), strict=True))
    drawn = [points[k] for k in dots.get_markevery()]
    assert set(drawn) == {point for point in points if np.isfinite(point).all()}
    assert len(drawn) < 50
    assert y[700] in dots.get_ydata()[dots.get_markevery()]


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
