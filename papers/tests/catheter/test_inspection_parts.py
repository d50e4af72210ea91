"""Parts of the inspection study on one seed each; the whole is a make target."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from minorloop.errors import ModelFileError
from minorloop.identification.bands import PER_DEVIATION
from minorloop_head.geometry import Mount, Tool, wall_distance
from minorloop_head.procedures import steps
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.head_file import HeadFile
from minorloop_head.procedures.mark import Marking
from minorloop_head.procedures.scan import RasterScan
from minorloop_head.procedures.trace import likely
from minorloop_head.procedures.values import LogEntry
from minorloop_head.reconstruction.depth_map import (
    BOTH,
    CAMERA,
    ECHOES,
    UNSEEN,
    DepthMap,
    Patch,
    WaterLine,
)
from minorloop_head.twins.camera import LENS, led_positions
from minorloop_head.twins.pipe import Bore, Crack, Pipe
from minorloop_head.twins.rig import Rig
from minorloop_head.ultrasound.c_scan import CScan, EchoFind
from minorloop_head.ultrasound.crack_depth import CrackDepth
from minorloop_head.ultrasound.pits import PitDepth
from minorloop_head.vision.calibrated_camera import CalibratedCamera
from minorloop_head.vision.cracks import TracedCrack
from minorloop_head.vision.defects import Hole
from papers.catheter import (
    flooded,
    inspection,
    inspection_report,
    inspection_servo,
    mission_cracks,
    mission_scene,
    scan_trials,
    scoring,
)
from papers.catheter import mission as missions
from papers.catheter.crack_trials import CrackOutcome
from papers.catheter.detection import (
    SceneOutcome,
    detection_figures,
    plain_edges,
    recall_curve,
    score_scene,
    wilson,
)
from papers.catheter.inspection_report import missed_holes, picked_off, save_mission
from papers.catheter.inspection_servo import ServoRun
from papers.catheter.mission import gather, mission_figures, run_mission
from papers.catheter.mission_cracks import SeenCrack
from papers.catheter.mission_scene import draw_mission
from papers.catheter.pipe_map import pipe_map
from papers.catheter.sweep_trials import ScoredSweep
from papers.claims import claim_table, figure


@pytest.fixture(scope="module")
def mission():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("minorloop_head.procedures.ring.TURNS", 16)
        patch.setattr("papers.catheter.mission.ADVANCES", (4e-3,))
        patch.setattr("papers.catheter.mission.VIEWS", 4)
        return run_mission(1)


def test_a_pit_at_the_edge_of_the_picture_on_a_wall_that_was_white_is_centred():
    """Exposed for the whole picture, half of the wall about the pit of this seed is white."""
    rig, truth = draw_mission(1015)
    place = np.array([truth.bore.phi, truth.bore.z])
    photo, pixel = steps.pick(rig, np.add(place, (0.01, 0.1e-3)), "")
    column, row = pixel.astype(int)
    assert 80 < photo[row - 50 : row + 50, column - 50 : column + 50].mean() < 120
    steps.go(rig, angles=np.radians((-6.0, -6.0)))
    camera = rig.calibration.camera_at(rig.place)
    assert 0 < camera.lens.height - camera.pixel(place, *rig.angles)[1] < 40
    steps.centre(rig, place, outlined=True)
    assert rig.log[-1].succeeded
    assert scoring.off_middle(rig.tip, truth.bore) < 1.0


def test_a_mission_finds_centres_measures_and_reconstructs_its_pit(mission):
    steps = [step.what for step in mission.log]
    order = ["look around", "pick", "centre", "focus", "extract", "touch", "measure", "reconstruct"]
    after = [what for what in steps if what in order]
    assert after[: len(order)] == order
    rest = mission.log[steps.index("reconstruct") + 1 :]
    assert [step.what for step in rest[:7]] == [
        "pick", "centre", "focus", "trace", "scan", "modality", "measure",
    ]  # fmt: skip
    # Other lines are looked at from nearer, and are no cracks.
    assert all(step.what in ("pick", "centre", "focus", "trace") for step in rest[7:])
    assert all("not counted" in step.outcome for step in rest[7:] if step.what == "trace")
    figures = mission.figures()
    assert figures["measured"]
    assert figures["centred_px"] <= 1.0
    assert figures["position_mm"] <= 0.3
    assert figures["depth_error_mm"] <= 0.1
    assert figures["touched"]
    assert figures["touch_mm"] <= 0.3
    assert mission.wall.depth.max() == pytest.approx(mission.truth.depth, rel=0.1)
    assert figures["water_error_mm"] <= 1.0
    assert set(np.unique(mission.ring.source)) == {UNSEEN, CAMERA, ECHOES, BOTH}


def test_a_mission_traces_its_crack_and_measures_it(mission):
    figures = mission.figures()
    assert figures["crack_found"]
    assert figures["false_cracks"] == 0
    assert figures["crack_off_mm"] <= 0.2
    assert figures["crack_length_error_pct"] <= 25
    assert figures["crack_width_error_pct"] <= 40
    assert figures["crack_measured"]
    assert figures["crack_depth_error_mm"] <= 0.05
    (crack,) = mission.cracks
    deep = np.isfinite(crack.wall.depth) & (crack.wall.depth > 0)
    assert crack.wall.depth[deep] == pytest.approx(crack.found.depth)
    assert np.isnan(crack.wall.depth).any()
    assert mission.ring.patch.z < crack.wall.patch.z


def test_the_report_says_why_a_picked_place_is_not_that_of_the_finding(mission):
    pit = mission.finding
    off = 1e3 * wall_distance(mission.picked, (pit.phi, pit.z), 10e-3)
    assert 0.0 < off < 0.3
    assert picked_off(mission) == pytest.approx(off)
    (pick, *_) = [step.outcome for step in mission.log if step.what == "pick"]
    phi, z = np.degrees(mission.picked[0]), 1e3 * mission.picked[1]
    assert pick.startswith(f"phi {phi:.1f} deg, z {z:.2f} mm")


def test_the_width_of_a_reported_crack_is_its_median_with_a_band_that_says_something(mission):
    (crack,) = mission.cracks
    found = crack.finding
    assert found.width == np.median(crack.traced.widths)
    assert found.width_sd < 0.03e-3
    true = np.median(mission.truth_crack.widths)
    assert abs(found.width - true) < PER_DEVIATION * found.width_sd


def test_a_mission_tests_its_tool_beside_the_pit_before_it_touches_the_pit(mission):
    steps = [step.what for step in mission.log]
    assert steps.index("extract") < steps.index("test mark") < steps.index("touch")
    assert steps.count("test mark") == 1


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


@pytest.mark.parametrize("what", ["centre", "touch", "scan"])
def test_a_pit_counts_as_measured_only_if_every_step_with_it_succeeded(mission, what):
    failed = LogEntry(0.0, what, "3.1 px from the middle", succeeded=False)
    one = replace(mission, steps=(*mission.steps, failed))
    assert one.pit.measured
    assert not one.figures()["measured"]
    assert one.figures()["failed"] == (what,)
    assert one.findings[0].verdict == f"measured, but failed: {what}"


def test_a_pit_counts_as_measured_only_within_the_band_and_where_the_tool_touched(mission):
    wrong = replace(mission.pit, depth=mission.truth.depth + 4 * mission.pit.depth_sd)
    assert not replace(mission, pit=wrong).figures()["measured"]
    assert not replace(mission, touch=0.31e-3).figures()["measured"]
    assert not replace(mission, off=2.1).figures()["measured"]
    steps = mission.figures()["steps"]
    assert ("touch", True) in [(what, succeeded) for _, what, _, succeeded in steps]


@pytest.mark.parametrize(
    ("views", "depth", "counts"), [(1, np.nan, 0), (2, np.nan, 1), (1, 5e-4, 1)]
)
def test_a_line_of_one_view_is_a_crack_only_if_echoes_give_its_depth(
    monkeypatch, views, depth, counts
):
    places = np.stack([np.linspace(0.0, 0.2, 20), np.full(20, 20e-3)], axis=1)
    trace = TracedCrack(places, np.full(20, 1e-4), 2e-3, 0.5)
    for name in ("pick", "centre", "focus"):
        monkeypatch.setattr(mission_cracks, name, lambda *given: None)
    monkeypatch.setattr(mission_cracks, "_again", lambda *given: ((trace,), "photo"))
    found = CrackDepth("measured" if np.isfinite(depth) else "no floor echo", depth)
    monkeypatch.setattr(mission_cracks, "scanned_crack", lambda *given: (found, None))
    monkeypatch.setattr(mission_cracks, "crack_map", lambda *given: None)
    rig = SimpleNamespace(
        say=lambda *given, **more: None, calibration=SimpleNamespace(radius=10e-3)
    )
    assert (mission_cracks.examined(rig, trace, views) is not None) == counts


def test_only_pits_within_reach_count_and_others_must_be_refused(mission):
    figures = mission.figures()
    said = figures | {"reachable": False, "refused": True, "measured": False}
    silent = said | {"refused": False}
    found = mission_figures([figures, said, silent])
    assert (found["pits_measured"], found["reachable"]) == (1.0, 1)
    assert found["unreachable_said"] == 0.5
    assert found["refused_in_vain"] == 0


def test_a_level_that_was_not_seen_has_no_error(mission):
    unseen = replace(mission, water=WaterLine(-9e-3, 1e-3, 0.0, seen=False)).figures()
    assert np.isnan(unseen["water_error_mm"])
    seen = mission.figures()["water_error_mm"]
    assert mission_figures([mission.figures(), unseen])["water_error_mm"] == seen


def test_missions_alone_have_the_figures_of_the_whole_study(mission):
    figures = mission.figures()
    assert figures["processor_s"] > 0
    found = gather([figures])
    assert found["mission"] == mission_figures([figures])
    assert found["touch"] == {"of": 1, "within_bound": 1.0}
    far, never = figures | {"touched": False}, figures | {"touched": False, "touch_mm": np.nan}
    assert gather([figures, far, never])["touch"] == {"of": 2, "within_bound": 0.5}


def test_a_pit_out_of_reach_is_reported_as_such_and_not_scanned(monkeypatch):
    said = "out of reach: pan needs 15 degrees"
    monkeypatch.setattr(missions, "touch", lambda rig, hole: None)
    monkeypatch.setattr(RasterScan, "out_of_reach", lambda self, control: said)
    rig, truth = draw_mission(1)
    mission = missions.Mission(1, truth.bore, truth.crack, 0.0, found=thing(0.02))
    after = missions._measured(rig, truth, mission, None)
    assert after.finding.verdict == "out of reach"
    assert after.finding.kind == "hole or pit"
    assert not after.pit.measured
    assert after.failed == ("reach",)


def test_findings_are_saved_as_meshes_and_a_table(mission, tmp_path):
    written = save_mission(mission, tmp_path)
    meshes = ["finding.ply", "finding.glb", "crack.ply", "crack.glb"]
    assert [path.name for path in written] == ["findings.csv", *meshes]
    header, pit, crack = written[0].read_text(encoding="utf-8").splitlines()
    assert "depth_sd [mm]" in header
    assert pit.startswith("1,pit,measured,")
    assert crack.startswith("2,crack,measured,")


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


def test_recall_and_false_findings_are_shares():
    outcomes = [
        SceneOutcome("switched", True, True, 1e-5, 0.1, 0),
        SceneOutcome("switched", True, False, np.nan, np.nan, 1),
        SceneOutcome("switched", False, False, np.nan, np.nan, 1),
        SceneOutcome("single", True, True, 1e-5, 0.3, 0),
    ]
    found = detection_figures(outcomes)
    assert found["recall"] == 0.5
    assert found["false_per_acquisition"] == pytest.approx(2 / 3)
    assert found["size_within_15pct"] == 1.0
    assert found["single_recall"] == 1.0


def test_wilson_intervals_hold_their_share():
    low, high = wilson(49, 50)
    assert 0.88 < low < 0.98 < high < 1.0


@pytest.fixture(scope="module")
def scene():
    return inspection_servo.Scene(1)


def test_by_the_camera_alone_no_reading_of_a_joint_is_used(scene, monkeypatch):
    told = inspection_servo.run_servo(scene, sensor=False, seconds=0.4)
    exchange, lie = Rig.exchange, np.array([0.2, 0.2, 0.0, 0.0])
    monkeypatch.setattr(Rig, "exchange", lambda self, u: exchange(self, u) + lie)
    lied = inspection_servo.run_servo(scene, sensor=False, seconds=0.4)
    np.testing.assert_array_equal(told.off, lied.off)
    assert set(told.verdicts) == {"tracked"}
    assert told.off[-1] < told.off[0]
    assert told.stabilised_rms(0.0) < 0.5


def test_every_hole_is_nine_pixels_across_in_two_looks():
    camera = CalibratedCamera(LENS, Mount(), led_positions())
    turns = 2 * np.pi * np.arange(missions.VIEWS) / missions.VIEWS
    aims = missions.RING * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    rim = np.linspace(0, 2 * np.pi, 24)
    for phi in np.linspace(-np.pi, np.pi, 9):
        for z in np.arange(18e-3, 31e-3, 1e-3):
            hole = np.stack([phi + 42.5e-3 * np.cos(rim), z + 0.425e-3 * np.sin(rim)], axis=1)
            across = []
            for advance in missions.ADVANCES:
                there = hole - [0.0, advance]
                for aim in aims:
                    seen = camera.pixel(there, *aim)
                    inside = (seen > 4).all() and (seen < [636, 476]).all()
                    if inside:
                        across.append(np.sqrt(np.linalg.eigvalsh(2 * np.cov(seen.T))[0]))
            assert np.sum(np.array(across) >= 9.0) >= 2


def searched(monkeypatch, looks, verdicts):
    """A mission with given views and echoes; return the picks in their order."""
    picked = []
    echoes = {place: PitDepth(verdict, 0.0, place, depth=1e-3) for place, verdict in verdicts}

    def approached(rig, mission, hole):
        picked.append(float(hole.place[1]))
        return replace(mission, found=hole), hole.evidence > 0, None

    def measured(rig, truth, one, view):
        return replace(one, pit=echoes[float(one.found.place[1])])

    monkeypatch.setattr(missions, "_look_around", lambda rig, at, seen: looks.get(at, []))
    monkeypatch.setattr(missions, "_approached", approached)
    monkeypatch.setattr(missions, "_measured", measured)
    empty = missions.Mission(0, None, None, 0.0)
    return missions._examined(None, None, empty, missions.Overview()), picked


def thing(z, evidence=1.0):
    return Hole(np.array([0.0, z]), 1e-3, evidence, "dark", np.zeros((1, 2)))


def test_a_mission_continues_after_a_false_candidate_and_at_further_places(monkeypatch):
    looks = {0.0: [thing(0.01), thing(0.02)], 9e-3: [thing(0.02), thing(0.03)]}
    verdicts = [(0.01, "no pit"), (0.02, "disturbed"), (0.03, "measured")]
    mission, picked = searched(monkeypatch, looks, verdicts)
    assert picked == [0.01, 0.02, 0.03]
    assert mission.pit.measured


def test_candidates_that_are_not_seen_again_come_last(monkeypatch):
    looks = {0.0: [thing(0.01, -1.0)], 3e-3: [thing(0.02)]}
    verdicts = [(0.01, "measured"), (0.02, "no pit")]
    mission, picked = searched(monkeypatch, looks, verdicts)
    assert picked == [0.01, 0.02, 0.01]
    assert mission.pit.measured


def test_a_mission_that_finds_nothing_reports_it(monkeypatch):
    mission, picked = searched(monkeypatch, {}, [])
    assert picked == []
    assert "nothing round was seen" in inspection_report.nothing_found(mission)
    assert save_mission(mission, None) == []


def test_a_mission_refuses_the_file_of_another_head():
    with pytest.raises(ModelFileError, match=r"'twin-head-2', and the head here is 'twin-head-1'"):
        run_mission(1, HeadFile(serial="twin-head-2"))


def test_the_catheter_rolls_to_where_weak_wires_reach_a_place_that_they_would_not_else():
    rig, _ = draw_mission(1)
    stroke = np.array([[0.0, 50.0], [0.0, 50.0]])
    rig.control = SimpleNamespace(reach=lambda wanted: stroke)
    below, above = np.array([np.pi / 2, 20e-3]), np.array([-np.pi / 2, 20e-3])
    assert steps._near(rig, below)[1] == 0.0
    rolled = steps._near(rig, above)
    wanted = rig.calibration.joints(steps.aim_at(rig.calibration, above, rolled))
    assert (wanted > 5.0).all()
    assert (wanted < 20.0).all()
    stroke[:, 1] = 60.0
    assert steps._near(rig, above)[1] == 0.0


def line(z, *, phi=0.0, length=4e-3, contrast=0.5):
    course = np.stack([np.linspace(phi, phi + length / 10e-3, 40), np.full(40, z)], axis=1)
    return TracedCrack(course, np.full(40, 0.2e-3), length, contrast)


def test_lines_of_one_course_are_one_and_are_visited_once():
    seen = [line(0.02), line(0.0202), line(0.025, length=6e-3), line(0.02, phi=2.0)]
    found = likely(seen, [line(0.02, phi=2.01)], 10e-3)
    assert [(trace.places[0, 1], looks) for trace, looks in found] == [(0.02, 2), (0.025, 1)]


def test_lines_of_a_single_view_are_visited_after_the_last_look_around(monkeypatch):
    looks = {3e-3: [line(0.02), line(0.03)], 6e-3: [line(0.025)], 9e-3: [line(0.02)]}
    visits = []

    def look_around(rig, advance, seen):
        seen.traces += looks[advance]
        seen.places.append(advance)

    def examined(rig, trace, views):
        visits.append((float(trace.places[0, 1]), views))
        whole = line(0.02, length=9e-3) if trace.places[0, 1] == 0.02 else trace
        return SimpleNamespace(course=whole) if views >= least else None

    monkeypatch.setattr(missions, "ADVANCES", tuple(looks))
    monkeypatch.setattr(missions, "_look_around", look_around)
    monkeypatch.setattr(mission_cracks, "examined", examined)
    least, seen = 2, missions.Overview()
    (found,) = missions._cracks(None, seen)
    assert (visits, found.course.places[0, 1]) == ([(0.02, 2)], 0.02)
    least, seen = 3, missions.Overview()
    assert missions._cracks(None, seen) == ()
    assert visits[1:] == [(0.02, 2), (0.03, 1), (0.025, 1)]


def test_a_part_of_a_crack_that_was_found_is_not_visited(monkeypatch):
    whole, visits = line(0.02, length=9e-3), []
    parts = [line(0.02), line(0.02, phi=0.6, length=2e-3)]

    def examined(rig, trace, views):
        visits.append(float(trace.places[0, 0]))
        return SimpleNamespace(course=whole)

    monkeypatch.setattr(missions, "ADVANCES", ())
    monkeypatch.setattr(mission_cracks, "examined", examined)
    found = missions._cracks(None, missions.Overview(traces=[*parts, *parts]))
    assert (len(found), visits) == (1, [0.0])


def test_a_line_beside_the_true_crack_is_false():
    truth = Crack(((0.0, 0.02), (0.4, 0.02)), (0.2e-3, 0.2e-3), depth=0.5e-3)
    heard = CrackDepth("too narrow for a depth", least_width=0.3e-3)
    right, wrong = (
        SeenCrack(trace, trace, trace.places[20], 0.18e-3, heard, None, None)
        for trace in (line(0.0201), line(0.024))
    )
    figures = mission_cracks.crack_figures([right, wrong], truth)
    assert figures["crack_found"]
    assert figures["false_cracks"] == 1
    assert not figures["crack_measured"]
    assert figures["crack_off_mm"] == pytest.approx(0.1, abs=1e-3)
    assert figures["crack_width_error_pct"] == pytest.approx(10.0)
    assert np.isnan(figures["crack_depth_error_mm"])
    assert right.finding.verdict == "too narrow for a depth (under 0.30 mm)"
    none = mission_cracks.crack_figures([], truth)
    assert (none["crack_found"], none["false_cracks"]) == (False, 0)


def test_a_pipe_of_a_mission_has_its_crack_within_reach_and_clear_of_the_pit():
    for seed in range(100, 120):
        bore = Bore(0.5, 0.025, 1e-3, depth=0.5e-3)
        crack = mission_scene.crack_beside(bore, np.random.default_rng(seed))
        low, high = mission_scene.CRACKED
        assert all(low < z < high for _, z in crack.points)
        off = min(mission_scene.distance(corner, (0.5, 0.025)) for corner in crack.points)
        assert off > mission_scene.CLEAR


def test_wall_and_water_are_known_with_errors(scene):
    rig, truth = draw_mission(1)
    probe = rig.calibration.probe_at(rig.place)
    assert probe.thickness != truth.pipe.thickness
    assert probe.thickness == pytest.approx(truth.pipe.thickness, rel=0.05)
    assert probe.temperature != truth.water.temperature
    assert probe.temperature == pytest.approx(truth.water.temperature, abs=1.5)


def test_settling_and_losses_of_a_run():
    off = np.array([9.0, 5.0, 1.0, 3.0, 1.0, 1.0])
    verdicts = ("tracked", "lost", "lost", "tracked", "tracked", "tracked")
    place = np.array([[9.0, 0.0]] * 4 + [[1.0, 0.0], [0.0, 1.0]])
    run = ServoRun(0.04 * np.arange(1.0, 7.0), off, verdicts, place=place)
    assert run.offset(0.17) == pytest.approx(np.sqrt(0.5))
    assert run.settle == pytest.approx(0.16)
    assert run.lost == pytest.approx(1 / 3)
    assert run.reacquire == pytest.approx(0.08)
    assert run.rms(0.17) == pytest.approx(1.0)


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
    return ScoredSweep(scan, pipe_map(scan, []), Pipe(bores=(truth,)), 0.1e-3, 60.0)


@pytest.mark.usefixtures("without_pictures")
def test_everything_is_gathered_and_reported(mission):
    trial = scan_trials.draw_trial(60_000)
    scored = scan_trials.measured(trial, [])
    dry = scan_trials.measured(scan_trials.draw_trial(60_003, kind="dry"), [], "camera")
    kinds = dict.fromkeys(
        ("pit", "gyroscope", "joints", "unfocused", "dished", "dented", "hole", "fused"), (scored,)
    ) | {"dry": (dry,)}
    run = ServoRun(np.array([18.0, 19.0]), np.ones(2), ("tracked",) * 2)
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
        "sweep": swept(), "reach": flooded.reach_figures(1),
    }  # fmt: skip
    study = inspection.results(1, parts, 1.0)
    runs = [study.figures()] * 2
    found = inspection.gather(runs)
    assert len(claim_table(inspection_report.STUDY.claims, found).rows) == len(
        inspection_report.STUDY.claims
    )
    assert found["modality"]["wrong"] == 0
    alone = scan_trials.gather([{"scored": kinds}] * 2)
    assert all(found[name] == alone[name] for name in ("depth", "fusion", "modality"))
    assert all(figure(alone, claim.key) is not None for claim in scan_trials.STUDY.claims)
    assert found["cracks"]["recall_100um"] == found["cracks"]["recall_50um"] == 1.0
    assert figure(found, "mission.measured") == figure(found, "mission.cracks_found") == 1.0
    assert figure(found, "mission.false_cracks") == 0
    assert figure(found, "cscan.recall") == 1.0
    assert figure(found, "cscan.depth_bias_um") == pytest.approx(-10.0)
    assert figure(found, "cscan.false_per_cm2") == pytest.approx(1 / 0.05)
    assert figure(found, "cscan.seconds_per_cm2") == pytest.approx(60 / 0.05)
    page = inspection_report.STUDY.report(study, found, runs).html()
    assert found["detection"]["plain_edge_px_p90"] == 0.3
    assert page.count("<img") == 9
    assert "Fig 14" in page
    assert page.count("make judge") >= 3  # in the summary, at the holes, and at the cracks


def test_a_specimen_has_the_results_of_all_parts_and_says_which_is_done(monkeypatch):
    rest = ("outcomes", "cracks", "edges", "scored", "sweep", "reach")
    told, drive = [], SimpleNamespace(figures=dict)
    monkeypatch.setattr(inspection, "parent_process", object)  # as in a process of its own
    servo = {"servo": {"settle_s": 7}, "runs": {}, "mission": drive}
    parts = [lambda *_: servo, lambda *given: dict.fromkeys(rest, given)]
    monkeypatch.setattr(inspection, "_SHARES", list(zip(("servo", "rest"), parts, strict=True)))
    study = inspection.run_study(7, scenes=2, scans=3, told=told.append)
    assert told == ["servo: 0 s", "rest: 0 s"]
    assert study.figures()["settle_s"] == 7
    assert {getattr(study, name) for name in rest} == {(7, 2, 3)}
    assert study.seconds >= 0.0
