"""What all fits have: tables of scores and advice, and what is made of them."""

import numpy as np
import pytest

import minorloop as ml
from fixed_options import Plane, identify
from minorloop import Record, Smooth
from minorloop.identification.result import ScoreRow
from minorloop.report import Report


@pytest.fixture(scope="module")
def found():
    u = np.resize([0.0, 1.0, 0.25, 0.75, 0.5], 60)
    record = Record(u, u + 0.1 * (np.arange(60) % 2), None, "voltage [V]", "length [$]")
    return identify(record, Plane(2), prior=Smooth(), holdout=0.25)


def test_tables_json_files_and_reports_have_the_same_scores(found, tmp_path):
    rows = dict(found.summary(slow=True))
    assert rows["error on held-out data"] == f"{found.figures['nrmse_holdout']:.3%} of its range"
    assert rows["samples held out"] == str(found.figures["held_out"]) == "15"
    assert rows["rank"] == str(found.rank)
    assert "rank" not in dict(found.summary())
    found.save(tmp_path / "m.json")
    known = ml.modelfile.read(tmp_path / "m.json")
    assert known.provenance.scores == found.scores
    assert (str(known.input), str(known.output)) == ("voltage [V]", "length [$]")
    assert known.warnings == found.warnings
    page = found.report("a & b.csv").html()
    assert all(text in page for text in ("a &amp; b.csv", rows["unknowns"], "voltage [V]"))
    assert "length [$] against voltage [V]: Preisach, 2 bands" in page


def test_the_representation_has_five_lines_and_the_text_all(found):
    lines = repr(found).splitlines()
    assert len(lines) == 5
    assert lines[0] == "Identification of a Preisach"
    assert lines[-1].split(maxsplit=1) == ["verdict", found.verdict]
    assert all(text in str(found) for text in (*dict(found.summary()).values(), *found.advice))


def test_a_score_without_a_value_is_not_shown_unless_there_is_a_text_for_it():
    assert ScoreRow("", lambda fit: None, "lag").row(None) == []
    assert ScoreRow("", lambda fit: None, "lag", absent="-").row(None) == [("lag", "-")]
    assert ScoreRow("", "real", "lag", "{:.1f} s").row(2.0) == [("lag", "2.0 s")]


def test_an_error_of_rounding_alone_has_no_sign_and_no_sample():
    u = np.resize([0.0, 1.0, 0.25, 0.75, 0.5], 60)
    exact = identify(u, u / 3.0, Plane(2, diagonal="reversible"), prior=Smooth())
    assert 0 < abs(exact.accuracy.worst) < 1e-12
    assert dict(exact.summary())["worst error"] == "0.0%"


@pytest.mark.parametrize("count", [10, 12])
def test_each_curve_has_a_row_and_of_many_those_with_the_largest_errors(count):
    u = np.tile([0.0, 1.0, 0.3, 0.7], count)
    error = np.repeat(np.arange(count) % 5, 4) * np.tile([0.0, 0.1, 0.1, -0.1], count)
    record = Record(u, u + error, curves=np.repeat(np.arange(count), 4))
    found = identify(record, Plane(2), prior=Smooth())
    report = Report("", "")
    ml.identification.result.add_curves(report, found)
    (section,) = report.sections
    rows = section["table"].rows
    assert len(rows) == 10
    assert {len(row) for row in rows} == {len(section["table"].columns)}
    worst = np.argmax([one.accuracy.nrmse for one in found.curve_accuracy])
    assert int(rows[0][0]) == (worst if count > 10 else 0)
    assert len(section["pictures"]) == (count > 10)
