"""Parts of the inspection study on one seed each; the whole is a make target."""

from types import SimpleNamespace

import numpy as np
import pytest

from minorloop_head.geometry import Tool
from minorloop_head.procedures import steps
from minorloop_head.procedures.calibration import STRAIGHT, HeadCalibration
from minorloop_head.procedures.mark import Marking
from minorloop_head.procedures.trace import likely
from minorloop_head.procedures.values import LogEntry
from minorloop_head.reconstruction.depth_map import (
    ECHOES,
    DepthMap,
    Patch,
    WaterLine,
)
from minorloop_head.twins.camera import LENS
from minorloop_head.twins.pipe import Bore, Crack, Pipe
from minorloop_head.twins.rig import Rig
from minorloop_head.ultrasound.c_scan import CScan, EchoFind
from minorloop_head.vision.cracks import TracedCrack
from papers.catheter import (
    inspection,
    inspection_servo,
    scan_trials,
    scoring,
)
from papers.catheter import mission as missions
from papers.catheter.crack_trials import CrackOutcome
from papers.catheter.detection import (
    SceneOutcome,
    recall_curve,
)
from papers.catheter.inspection import missed_holes
from papers.catheter.inspection_servo import STROKE_SHARE, Scene, ServoRun, integral_results
from papers.catheter.sweep_trials import ScoredSweep, pipe_map
from papers.claims import claim_table, figure
from papers.harness import Results
from servo_runs import held_points


@pytest.fixture(scope="module")
def mission():
    """A whole inspection of a narrow look round: what the first views show is there."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("minorloop_head.procedures.ring.TURNS", 16)
        patch.setattr(missions, "ADVANCES", (8e-3,))
        return missions.run_mission(1)


@pytest.mark.whole
def test_a_pit_at_the_edge_of_the_picture_is_centred_under_water():
    head, truth = missions.draw_mission(1015)
    place = np.array([truth.bore.phi, truth.bore.z])
    with head.opened(lambda entry: None) as rig:
        steps.pick(rig, np.add(place, (0.01, 0.1e-3)), "")
        steps.go(rig, angles=rig.angles + np.radians((-8.0, -6.0)))
        steps.centre(rig, place, outlined=True)
        assert rig.log[-1].succeeded
    camera = rig.tip.camera
    pixel = scoring.true_pixel(camera, truth.bore.phi, truth.bore.z)
    assert np.linalg.norm(pixel - scoring.true_lens(camera).centre) < 1.0


@pytest.mark.whole
def test_a_mission_keeps_the_files_of_the_inspection_and_what_it_took(mission, tmp_path):
    figures = mission.figures()
    assert {"report.html", "findings.json", "journal.jsonl"} <= set(mission.files)
    assert figures["reachable"]
    assert not figures["refused"]
    assert figures["processor_s"] > 0
    (said,) = inspection.save_beside(SimpleNamespace(mission=mission), tmp_path)
    assert said == f"written: {tmp_path / 'inspection' / 'report.html'}"
    assert (tmp_path / "inspection" / "report.html").read_bytes() == mission.files["report.html"]


def row(kind, phi, z, verdict="measured", depth=0.5, length=1.0, course=None):
    return {
        "kind": kind, "phi [deg]": np.degrees(phi), "z [mm]": 1e3 * z, "width [mm]": 0.9,
        "length [mm]": length, "depth [mm]": depth, "depth_sd [mm]": 0.004, "verdict": verdict,
        "grade": "confirmed", "course": course,
    }  # fmt: skip


def scored(rows, touches=((0.0, 20.1e-3),)):
    """Figures of findings about a pit at 0 and a crack that is 0.08 mm wide in the middle."""
    tip = SimpleNamespace(tool=SimpleNamespace(touches=list(touches)))
    points = tuple((float(phi), 26e-3) for phi in np.linspace(0.0, 0.4, 5))
    truth = SimpleNamespace(
        bore=Bore(0.0, 20e-3, 1e-3, depth=0.5e-3), log=(), tip=tip, reachable=True,
        crack=Crack(points, (4e-5, 6e-5, 8e-5, 6e-5, 4e-5), depth=0.4e-3),
    )  # fmt: skip
    return missions.scored({"findings": rows, "seconds": 60.0}, truth)


def line(z, length=4e-3):
    return [[float(phi), z] for phi in np.linspace(0.0, length / 10e-3, 40)]


def test_findings_are_scored_by_place_depth_and_touch():
    others = [row("hole or pit", 2.0, 20e-3), row("mark", 1.0, 20e-3, "no pit", None)]
    found = scored([row("pit", 0.0, 20.1e-3, depth=0.508), *others])
    assert (found["found"], found["measured"], found["false_holes"]) == (True, True, 1)
    assert found["marks"] == 1
    assert found["depth_off_um"] == pytest.approx(8.0)
    assert not found["in_band"]
    assert found["touch_mm"] == pytest.approx(0.1)
    assert found["position_mm"] == pytest.approx(0.1)
    assert found["diameter_error_pct"] == pytest.approx(10.0)
    wrong = scored([row("pit", 0.0, 20e-3, depth=0.513)], touches=())
    assert not wrong["measured"]
    assert np.isnan(wrong["touch_mm"])
    silent = scored([row("hole or pit", 0.0, 20e-3, "no floor echo", None)])
    assert (silent["found"], silent["measured"]) == (True, False)
    assert np.isnan(silent["depth_off_um"])
    assert scored([row("pit", 0.0, 20e-3, "measured (34 of 36 places)")])["measured"]
    assert not scored([row("pit", 0.0, 20e-3, "measured, but failed: touch")])["measured"]


def test_a_line_beside_the_true_crack_is_false():
    rows = [row("crack", 0.0, z, depth=None, length=3.6, course=line(z)) for z in (26.1e-3, 30e-3)]
    found = scored(rows)
    assert (found["crack_found"], found["false_cracks"], found["crack_measured"]) == (True, 1, 0)
    assert found["crack_width"] == 8e-5
    assert found["crack_length_error_pct"] == pytest.approx(10.0, rel=0.1)
    assert found["crack_width_error_um"] == pytest.approx(840.0)
    assert np.isnan(found["crack_depth_error_mm"])
    none = scored([])
    assert (none["crack_found"], none["false_cracks"]) == (False, 0)


def test_only_pits_within_reach_count_and_cracks_count_by_their_width():
    good = scored([row("pit", 0.0, 20e-3), row("crack", 0.0, 26e-3, course=line(26e-3))])
    good["processor_s"] = 1.0
    beyond = good | {"reachable": False, "refused": True, "measured": False}
    wide = good | {"crack_width": 2e-4, "crack_found": False}
    found = missions.gather([good, beyond, beyond | {"refused": False}, wide])["mission"]
    assert (found["pits_measured"], found["reachable"]) == (1.0, 2)
    assert (found["unreachable_said"], found["refused_in_vain"]) == (0.5, 0)
    assert [found[f"cracks_{name}_of"] for name in missions.CLASSES] == [0, 3, 1]
    assert (found["cracks_50um"], found["cracks_100um"]) == (1.0, 0.0)
    assert np.isnan(found["cracks_30um"])
    assert found["touched"] == 1.0


@pytest.mark.parametrize(
    ("most", "moved"), [((90.0, 90.0), False), ((90.0, 50.0), True), ((0.0, 0.0), False)]
)
def test_the_catheter_goes_where_both_wires_turn_the_tool_to_a_place(monkeypatch, most, moved):
    view = HeadCalibration(lens=LENS, leds=np.empty((0, 3)), tool=Tool())
    home, place, went = np.array([2.6e-3, 0.0]), np.array([-1.15, 26.2e-3]), []
    ends = np.stack([np.full(2, -90.0), most], axis=1)
    control = SimpleNamespace(reach=lambda wanted: ends)
    rig = SimpleNamespace(calibration=view, control=control, place=home)
    monkeypatch.setattr(steps, "go", lambda rig, place: went.append(place))
    marking = Marking(calibration=view)
    steps.bring_in_reach(rig, marking, place)
    assert bool(went) == moved
    if moved:
        assert (view.joints(marking.angles(place, home)) > most).any()
        assert (view.joints(marking.angles(place, went[0])) < most).all()


def test_less_evidence_finds_more_holes():
    outcomes = [
        SceneOutcome("switched", True, True, 0.0, 0.0, 0, evidence=2.0, alarms=(1.0,)),
        SceneOutcome("switched", True, False, 0.0, 0.0, 0),
        SceneOutcome("switched", False, False, 0.0, 0.0, 0, alarms=(3.0, -1.0)),
        SceneOutcome("switched", False, False, 0.0, 0.0, 0),
    ]
    false, recall = recall_curve(outcomes)
    np.testing.assert_allclose(false, [0.25, 0.25, 0.5, 0.75])
    np.testing.assert_allclose(recall, [0.0, 0.5, 0.5, 0.5])
    counts = missed_holes(outcomes)
    assert [counts[key] for key in ("missed", "holes", "dark", "unseen", "false", "of")] == [
        1, 2, 0, 1, 0, 4
    ]  # fmt: skip


@pytest.fixture(scope="module")
def scene():
    return inspection_servo.Scene(1)


@pytest.mark.whole
def test_by_the_camera_alone_no_reading_of_a_joint_is_used(scene, monkeypatch):
    told = inspection_servo.run_servo(scene, sensor=False, seconds=0.4)
    exchange, lie = Rig.exchange, np.array([0.2, 0.2, 0.0, 0.0])
    monkeypatch.setattr(Rig, "exchange", lambda self, u: exchange(self, u) + lie)
    lied = inspection_servo.run_servo(scene, sensor=False, seconds=0.4)
    np.testing.assert_array_equal(told.off, lied.off)
    assert set(told.verdicts) == {"tracked"}
    assert told.off[-1] < told.off[0]
    assert told.stabilised_rms(0.0) < 0.5


def test_the_catheter_rolls_to_where_weak_wires_reach_a_place_that_they_would_not_else():
    stroke = np.array([[0.0, 50.0], [0.0, 50.0]])
    rig = SimpleNamespace(
        calibration=HeadCalibration(lens=LENS, leds=np.empty((0, 3))),
        control=SimpleNamespace(reach=lambda wanted: stroke),
        most=np.full(2, np.inf),
    )
    below, above = np.array([np.pi / 2, 20e-3]), np.array([-np.pi / 2, 20e-3])
    assert steps._place_before(rig, below)[1] == 0.0
    rolled = steps._place_before(rig, above)
    wanted = rig.calibration.joints(steps.aim_at(rig.calibration, above, rolled))
    assert (wanted > 5.0).all()
    assert (wanted < 20.0).all()
    stroke[:, 1] = 60.0
    assert steps._place_before(rig, above)[1] == 0.0


def test_lines_of_one_course_are_one_and_are_visited_once():
    def traced(z, *, phi=0.0, length=4e-3):
        course = np.add(line(z, length), (phi, 0.0))
        return TracedCrack(course, np.full(40, 0.2e-3), length, 0.5)

    seen = [traced(0.02), traced(0.0202), traced(0.025, length=6e-3), traced(0.02, phi=2.0)]
    found = likely(seen, [traced(0.02, phi=2.01)], 10e-3)
    assert [(trace.places[0, 1], looks) for trace, looks in found] == [(0.02, 2), (0.025, 1)]


RUNS = ["sensor", "camera", "still", "motion", "swayed"]


def swept():
    """A sweep that found its pit and one that is none."""
    patch, truth = Patch(0.2, 20e-3, 5, 100), Bore(0.5, 20.2e-3, 1e-3, depth=0.5e-3)
    flat, sure = np.zeros((5, 100)), np.full((5, 100), 1e-5)
    wall = DepthMap(patch, flat, sure, np.full(flat.shape, ECHOES, dtype=np.uint8))
    finds = (
        EchoFind("pit", 0.5, 20.2e-3, 0.9e-3, 0.9e-3, 0.49e-3, 1e-5, 8),
        EchoFind("crack", 1.0, 20.2e-3, 0.2e-3, 2e-3, bursts=9),
    )
    scan = CScan(wall, flat + 1, flat > 0, WaterLine(0.0, 1e-4, 0.0), finds, (1e-6, 0.03))
    return ScoredSweep(scan, *pipe_map(scan, []), Pipe(bores=(truth,)), 0.1e-3, 60.0)


@pytest.mark.usefixtures("without_pictures")
def test_everything_is_gathered_and_reported():
    rows = [row("pit", 0.0, 20e-3), row("crack", 0.0, 26e-3, course=line(26e-3))]
    mission = Results(
        {**scored(rows), "processor_s": 1.0}, seed=1, content={"findings": rows}, files={},
        log=(LogEntry(1.0, "pick", "picked"),),
    )  # fmt: skip
    trial = scan_trials.draw_trial(60_000)
    scan = scan_trials.measured(trial, [])
    dry = scan_trials.measured(scan_trials.draw_trial(60_003, kind="dry"), [], "camera")
    kinds = dict.fromkeys(
        ("pit", "gyroscope", "joints", "unfocused", "dished", "dented", "hole", "fused"), (scan,)
    ) | {"dry": (dry,)}
    run = ServoRun(
        np.array([18.0, 19.0]), np.ones(2), ("tracked",) * 2, np.ones(2), np.ones((2, 2))
    )
    outcomes = [
        SceneOutcome(mode, hole, hole, 1e-5, 0.0, 0)
        for mode in ("switched", "single", "dither", "flooded", "sizes")
        for hole in (True, False)
    ]
    cracks = [
        CrackOutcome(1, width, width > 0, (1.0, 1.0), 0.1, 1e-6, 0) for width in (0.0, 6e-5, 1e-4)
    ]
    servo = {
        "servo": dict.fromkeys(
            ("settle_s_with_sensor", "settle_s_camera_only", "steady_rms_px"), 1.0
        ),
        "sway": {"ratio": 0.5, "stabilised_ratio": 0.1},
        "tracking": {"lost_fraction": 0.0, "reacquire_s": 0.0},
    }
    parts = {
        "servo": servo, "runs": dict.fromkeys(RUNS, run), "outcomes": tuple(outcomes),
        "cracks": tuple(cracks), "edges": np.full(48, 0.3), "scored": kinds, "mission": mission,
        "sweep": swept(), "reach": missions.reach_figures(1),
    }  # fmt: skip
    study = inspection.results(1, parts, 1.0)
    runs = [study.figures()] * 2
    found = inspection.gather(runs)
    assert len(claim_table(inspection.STUDY.claims, found).rows) == len(inspection.STUDY.claims)
    assert found["modality"]["wrong"] == 0
    alone = scan_trials.gather([{"scored": kinds}] * 2)
    np.testing.assert_equal({name: found[name] for name in alone}, alone)
    assert all(figure(alone, claim.key) is not None for claim in scan_trials.STUDY.claims)
    assert found["cracks"]["recall_100um"] == found["cracks"]["recall_50um"] == 1.0
    assert figure(found, "mission.of") == 2
    assert figure(found, "cscan.recall") == 1.0
    assert figure(found, "cscan.depth_bias_um") == pytest.approx(-10.0)
    assert figure(found, "cscan.false_per_cm2") == pytest.approx(1 / 0.05)
    assert figure(found, "cscan.seconds_per_cm2") == pytest.approx(60 / 0.05)
    page = inspection.STUDY.report(study, found, runs).html()
    assert found["detection"]["plain_edge_px_p90"] == 0.3
    assert page.count("<img") == 4
    assert "Fig 14" in page
    assert page.count("make judge") >= 3  # in the summary, at the holes, and at the cracks


def test_every_hole_is_within_reach_of_the_wires():
    """The tilt of this head reaches 49 degrees; a hole at 54 could not be centred."""
    scene = Scene(101)
    own = np.linalg.solve(scene.control.coupling, np.degrees(scene.aim + STRAIGHT))
    top = np.array([axis.observer.wire.operator.range[1] for axis in scene.control.axes])
    assert top.min() < 50
    assert (own < STROKE_SHARE * top).all()


def test_figures_compare_runs_with_the_integral_and_without():
    found = integral_results(held_points(off=0.1, without=0.4, printed=90.0)).figures()["integral"]
    assert found["sway_ratio"] == pytest.approx(0.25)
    assert found["offset_px"] == pytest.approx(0.1)
    assert found["without_drift_px"] == pytest.approx(0.4)
    assert found["printed_px"] == pytest.approx(90.0)
    rows = claim_table(inspection_servo.STUDY.claims, {"integral": found}).rows
    assert [row[-1] for row in rows if row[-1] != "-"][:2] == ["met", "met"]
