import numpy as np
import pytest

from minorloop.identification.accuracy import accuracy, by_curve
from minorloop.identification.curves import Curves, as_curves

U = np.cos(np.linspace(0, 4 * np.pi, 401))
LATE = np.cos(np.linspace(0, 4 * np.pi, 401) - 0.3)
EVERY = np.ones(401, dtype=bool)
WHOLE = Curves.whole("negative")


def test_each_figure_is_what_its_definition_says():
    y = 3.0 + LATE
    predicted = 3.0 + 1.1 * LATE
    found = accuracy(U, y, predicted, EVERY, WHOLE)
    assert found.samples == 401
    assert found.rmse == pytest.approx(np.sqrt(np.mean((0.1 * LATE) ** 2)))
    assert found.nrmse == pytest.approx(found.rmse / np.ptp(y))
    assert found.relative_rms == pytest.approx(found.rmse / np.sqrt(np.mean(y**2)))
    assert abs(found.worst) == pytest.approx(0.05, rel=1e-3)
    assert abs(LATE[found.worst_sample]) == pytest.approx(1.0, rel=1e-3)
    assert found.loops == 2
    assert found.loop_area == pytest.approx(0.1)


def test_samples_that_were_not_measured_count_nowhere():
    y, scored = LATE.copy(), EVERY.copy()
    y[10], scored[10] = np.nan, False
    found = accuracy(U, y, LATE + 0.1, scored, WHOLE)
    assert (found.samples, found.loops) == (400, 1)
    assert found.rmse == pytest.approx(0.1)
    assert found.loop_area < 1e-9


def test_curves_are_scored_each_over_the_range_of_the_record():
    labels = np.repeat(["a", "b", "c"], [150, 150, 101])
    curves = as_curves(labels, 401, "negative", None)
    error = np.repeat([0.1, 0.2, 0.4], [150, 150, 101])
    scored = labels != "b"
    left_out = np.where(labels == "a", LATE + 0.6, np.nan)
    first, last = by_curve(U, LATE, LATE + error, scored, curves, left_out)
    assert (first.name, first.first, last.name, last.first) == ("a", 0, "c", 300)
    span = np.ptp(LATE[scored])
    assert (first.accuracy.nrmse, last.accuracy.nrmse) == pytest.approx((0.1 / span, 0.4 / span))
    assert 300 <= last.accuracy.worst_sample <= 400
    assert (first.left_out, last.left_out) == (pytest.approx(0.6 / span), None)
