import numpy as np
import pytest

from fixed_options import Plane, identify
from minorloop.identification import Smooth
from minorloop.identification.scores import (
    MOST_CURVES,
    curve_table,
    score_rows,
)
from minorloop.lab.records import Record


@pytest.fixture(scope="module")
def found():
    u = np.resize([0.0, 1.0, 0.25, 0.75, 0.5], 60)
    return identify(u, u + 0.1 * (np.arange(60) % 2), Plane(2), prior=Smooth(), holdout=0.25)


def test_rows_say_what_the_scores_are(found):
    rows = dict(score_rows(found))
    assert rows["error on held-out data"] == f"{found.scores['nrmse_holdout']:.3%} of range"
    assert rows["samples held out"] == "15"
    assert "rank" not in rows
    assert dict(score_rows(found, rank="4"))["rank"] == "4"


def test_each_curve_has_a_row_and_of_many_those_with_the_largest_errors():
    u = np.tile([0.0, 1.0, 0.3, 0.7], 12)
    error = np.repeat(np.arange(12) % 5, 4) * np.tile([0.0, 0.1, 0.1, -0.1], 12)
    for count in (10, 12):
        rows, curves = slice(0, 4 * count), np.repeat(np.arange(count), 4)
        found = identify(
            Record(u[rows], (u + error)[rows], curves=curves), Plane(2), prior=Smooth()
        )
        columns, table, title = curve_table(found.curve_accuracy)
        assert len(table) == MOST_CURVES
        assert {len(row) for row in table} == {len(columns)}
        errors = [one.accuracy.nrmse for one in found.curve_accuracy]
        if count > MOST_CURVES:
            assert int(table[0][0]) == np.argmax(errors)
            assert "of 12 curves" in title
        else:
            assert [row[0] for row in table] == [str(k) for k in range(10)]


def test_an_error_of_rounding_alone_has_no_sign_and_no_sample():
    u = np.resize([0.0, 1.0, 0.25, 0.75, 0.5], 60)
    exact = identify(u, u / 3.0, Plane(2, diagonal="reversible"), prior=Smooth())
    assert 0 < abs(exact.accuracy.worst) < 1e-12
    assert dict(score_rows(exact))["worst error"] == "0.0%"
