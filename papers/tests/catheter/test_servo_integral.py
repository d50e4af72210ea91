import numpy as np
import pytest

from papers.catheter import inspection_servo
from papers.catheter.inspection_servo import IntegralStudy, Scene, run_servo
from papers.claims import claim_table
from servo_runs import held_points


def test_figures_compare_runs_with_the_integral_and_without():
    found = IntegralStudy(held_points(off=0.1, without=0.4, printed=90.0)).figures()["integral"]
    assert found["sway_ratio"] == pytest.approx(0.25)
    assert found["offset_px"] == pytest.approx(0.1)
    assert found["without_drift_px"] == pytest.approx(0.4)
    assert found["printed_px"] == pytest.approx(90.0)
    rows = claim_table(inspection_servo.STUDY.claims, {"integral": found}).rows
    assert [row[-1] for row in rows if row[-1] != "-"][:2] == ["met", "met"]


def test_every_case_is_drawn_with_the_integral_and_without():
    axes = inspection_servo.draw_integral(IntegralStudy(held_points())).axes
    assert [len(one.lines) for one in axes] == [3, 2, 2]


@pytest.fixture
def _short(monkeypatch):
    monkeypatch.setattr(inspection_servo, "PRINTED_SECONDS", 0.4)


@pytest.mark.usefixtures("_short")
def test_the_printed_sign_turns_the_integral_round():
    scene = Scene(1)
    printed = inspection_servo.run_printed(scene)
    right = run_servo(scene, sensor=False, seconds=0.4)
    assert printed.off.shape == right.off.shape
    assert not np.allclose(printed.off, right.off)
