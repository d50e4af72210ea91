"""The parts of the inspection study on one seed each; the whole is a make target."""

import numpy as np
import pytest

from minorloop.inspection.unrolled import BOTH, CAMERA, SONAR, UNSEEN
from minorloop.studies import inspection, inspection_report, soundings
from minorloop.studies.claims import claim_table, figure
from minorloop.studies.detection import (
    Outcome,
    detection_figures,
    plain_edges,
    recall_curve,
    score_scene,
    wilson,
)
from minorloop.studies.detection_report import limits
from minorloop.studies.inspection_servo import ServoRun
from minorloop.studies.mission import run_mission
from minorloop.studies.mission_report import save_finding


@pytest.fixture(scope="module")
def mission():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("minorloop.studies.mission.TURNS", 16)
        return run_mission(1)


def test_a_mission_finds_centres_measures_and_reconstructs_its_pit(mission):
    steps = [step.what for step in mission.log]
    order = ["look around", "pick", "centre", "focus", "extract", "touch", "measure", "reconstruct"]
    assert [what for what in steps if what in order][-7:] == order[1:]
    figures = mission.figures()
    assert figures["measured"]
    assert figures["position_mm"] <= 0.3
    assert figures["depth_error_mm"] <= 0.1
    assert figures["touch_mm"] <= 1.0
    assert mission.wall.depth.max() == pytest.approx(mission.truth.depth, rel=0.1)
    assert figures["water_error_mm"] <= 1.0
    assert set(np.unique(mission.ring.source)) == {UNSEEN, CAMERA, SONAR, BOTH}


def test_a_finding_is_saved_as_meshes_and_a_table(mission, tmp_path):
    written = save_finding(mission, tmp_path)
    assert [path.name for path in written] == ["findings.csv", "finding.ply", "finding.glb"]
    header, row = written[0].read_text(encoding="utf-8").splitlines()
    assert "depth_sd [mm]" in header
    assert row.startswith("1,pit,measured,")


def test_a_dark_hole_is_found_and_an_empty_wall_stays_empty():
    outcomes = [
        outcome for hole in (True, False) for outcome in score_scene(50_001, hole, ("switched",))
    ]
    assert [outcome.hole for outcome in outcomes] == [True, False]
    assert outcomes[0].found
    assert outcomes[0].evidence > 0
    assert outcomes[1].false == 0
    assert max(outcomes[1].alarms) < outcomes[0].evidence


def test_the_outline_of_a_plain_hole_is_its_edge():
    assert np.quantile(plain_edges(3_000_001), 0.9) < 1.0


def test_more_holes_are_found_as_less_evidence_is_asked_for():
    outcomes = [
        Outcome("switched", True, True, 0.0, 0.0, 0, evidence=2.0, alarms=(1.0,)),
        Outcome("switched", True, False, 0.0, 0.0, 0),
        Outcome("switched", False, False, 0.0, 0.0, 0, alarms=(3.0, -1.0)),
        Outcome("switched", False, False, 0.0, 0.0, 0),
    ]
    false, recall = recall_curve(outcomes)
    np.testing.assert_allclose(false, [0.25, 0.25, 0.5, 0.75])
    np.testing.assert_allclose(recall, [0.0, 0.5, 0.5, 0.5])
    assert "Missed were 1 of 2 holes" in limits(outcomes)


def test_recall_and_false_findings_are_shares():
    outcomes = [
        Outcome("switched", True, True, 1e-5, 0.1, 0),
        Outcome("switched", True, False, np.nan, np.nan, 1),
        Outcome("switched", False, False, np.nan, np.nan, 1),
        Outcome("single", True, True, 1e-5, 0.3, 0),
    ]
    found = detection_figures(outcomes)
    assert found["recall"] == 0.5
    assert found["false_per_acquisition"] == pytest.approx(2 / 3)
    assert found["size_within_15pct"] == 1.0
    assert found["single_recall"] == 1.0


def test_wilson_intervals_hold_their_share():
    low, high = wilson(49, 50)
    assert 0.88 < low < 0.98 < high < 1.0


def test_settling_and_losses_of_a_run():
    off = np.array([9.0, 5.0, 1.0, 3.0, 1.0, 1.0])
    verdicts = ("tracked", "lost", "lost", "tracked", "tracked", "tracked")
    run = ServoRun("x", 0.04 * np.arange(1.0, 7.0), off, verdicts, np.zeros((6, 2)))
    assert run.settle == pytest.approx(0.16)
    assert run.lost == pytest.approx(1 / 3)
    assert run.reacquire == pytest.approx(0.08)
    assert run.rms(0.17) == pytest.approx(1.0)


def test_everything_is_gathered_and_reported(mission):
    sounding = soundings.draw_sounding(60_000)
    scored = soundings.examined(sounding, [], "sonar")
    dry = soundings.examined(soundings.draw_sounding(60_003, kind="dry"), [], "camera")
    kinds = dict.fromkeys(("pit", "unfocused", "dished", "hole", "fused"), (scored,)) | {
        "dry": (dry,)
    }
    run = ServoRun("x", np.array([13.0, 14.0]), np.ones(2), ("tracked",) * 2, np.zeros((2, 2)))
    outcomes = [
        Outcome(mode, hole, hole, 1e-5, 0.0, 0)
        for mode in ("switched", "single", "dither")
        for hole in (True, False)
    ]
    servo = {
        "servo": dict.fromkeys(
            ("settle_s_with_sensor", "settle_s_camera_only", "steady_rms_px"), 1.0
        ),
        "sway": {"ratio": 0.5},
        "tracking": {"lost_fraction": 0.0, "reacquire_s": 0.0},
    }
    study = inspection.InspectionStudy(
        1, servo, dict.fromkeys(("sensor", "camera", "swayed", "still", "motion"), run),
        tuple(outcomes), np.full(48, 0.3), kinds, mission, 1.0,
    )  # fmt: skip
    runs = [study.figures()] * 2
    found = inspection.gather(runs)
    assert len(claim_table(inspection.CLAIMS, found).rows) == len(inspection.CLAIMS)
    assert found["modality"]["wrong"] == 0
    assert figure(found, "mission.measured") == 1.0
    page = inspection_report.study_report(study, found, runs).html()
    assert found["detection"]["plain_edge_px_p90"] == 0.3
    assert page.count("<img") == 6
    assert "Fig 14" in page
