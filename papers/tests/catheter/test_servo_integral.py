import numpy as np
import pytest

from minorloop.report import Report
from papers.catheter import servo_integral
from papers.catheter.inspection_servo import Scene, run_servo
from papers.catheter.servo_integral import IntegralStudy
from papers.catheter.servo_integral_report import add_integral
from papers.claims import claim_table
from servo_runs import held_points


def test_figures_compare_runs_with_the_integral_and_without():
    found = IntegralStudy(held_points(off=0.1, without=0.4, printed=90.0)).figures()["integral"]
    assert found["sway_ratio"] == pytest.approx(0.25)
    assert found["offset_px"] == pytest.approx(0.1)
    assert found["without_drift_px"] == pytest.approx(0.4)
    assert found["printed_px"] == pytest.approx(90.0)
    rows = claim_table(servo_integral.CLAIMS, {"integral": found}).rows
    assert [row[-1] for row in rows if row[-1] != "-"][:2] == ["met", "met"]


def test_the_report_has_both_columns_and_a_figure():
    study, report = IntegralStudy(held_points()), Report("x", "y")
    add_integral(report, study, study.figures()["integral"], 5)
    page = report.html()
    assert page.count("<img") == 1
    assert "0.40" in page


@pytest.fixture
def _short(monkeypatch):
    monkeypatch.setattr(servo_integral, "PRINTED_SECONDS", 1.2)


@pytest.mark.usefixtures("_short")
def test_the_printed_sign_turns_the_integral_round():
    scene = Scene(1)
    printed = servo_integral.run_printed(scene)
    right = run_servo(scene, sensor=False, seconds=1.2)
    assert printed.off.shape == right.off.shape
    assert not np.allclose(printed.off, right.off)
