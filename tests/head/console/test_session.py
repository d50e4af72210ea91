import math

import msgspec
import numpy as np
import pytest

from minorloop.head.console import messages
from minorloop.head.procedures.scan import RasterScan
from minorloop.head.twins.sensor import Fault
from seats import AHEAD, PIT, Open, Pilot, right, view

HOLE = {"phi": PIT[0], "z": PIT[1], "diameter": PIT[2], "evidence": 1.0}
EXTRACTED = {"what": "extracted", "hole": HOLE, "verdict": "dark"}
HEARD = {
    "phi": 0.451, "z": 24.01e-3, "diameter": 0.99e-3, "depth": 0.502e-3, "place_sd": 34e-6,
    "diameter_sd": 18e-6, "depth_sd": 3e-6, "verdict": "measured", "patch": {},
}  # fmt: skip


def told(session, kind):
    """What the pages were told of a kind."""
    every = [msgspec.json.decode(event) for event in session.events]
    return [each for each in every if each["type"] == kind]


def test_the_head_goes_where_the_operator_looks():
    pilot = Pilot().steering()
    pilot.drive(130, pose=right(20.0, -10.0))
    pan, tilt, *_ = pilot.session.where()
    assert pilot.session.state.mode == "HEAD"
    assert pan > 8
    assert tilt < -4
    assert (pan, tilt) == pytest.approx(pilot.session.state.command, abs=1.0)


def test_the_catheter_goes_where_the_stick_says_and_stops_when_nothing_is_heard():
    pilot = Pilot().steering(50)
    pilot.drive(70, stick=(1.0, 0.0))
    assert pilot.session.where()[2] > 5.0
    pilot.silence(3)
    assert pilot.session.state.mode == "HOLD"
    assert pilot.session.state.rates == (0.0, 0.0)
    pilot.silence(8)
    before = pilot.session.where()
    pilot.silence(25)
    assert pilot.session.where()[2] == pytest.approx(before[2], abs=0.3)


def test_a_pit_is_found_tracked_focused_on_and_measured_through_the_camera():
    pilot = Pilot(Open()).tracking()
    session = pilot.session
    assert session.state.mode == "TRACK"
    assert session.focus == "sharp"
    assert math.dist(session.seen.target[:2], view().lens.centre) < 6.0
    pilot.measured()
    (finding,) = session.findings
    assert finding.diameter == pytest.approx(1e3 * PIT[2], abs=2.5 * finding.diameter_sd)
    assert finding.phi == pytest.approx(math.degrees(PIT[0]), abs=2.5 * finding.phi_sd)
    assert finding.z == pytest.approx(1e3 * PIT[1], abs=2.5 * finding.z_sd)
    assert (finding.depth, finding.verdict) == (None, "not heard")
    seen = []
    for k in range(60):
        pose = right(30 * math.sin(k / 8), 30 * math.cos(k / 11))
        pilot.drive(pose=pose, look=lambda s: seen.append(s.seen.target[:2]))
    assert np.abs(np.subtract(seen, np.mean(seen, axis=0))).max() < 2.0


def test_the_operators_head_does_not_move_a_tracked_target():
    still, moving = Pilot().following(), Pilot().following()
    commands = ([], [])
    still.drive(60, look=lambda s: commands[0].append(s.state.command))
    for k in range(60):
        pose = right(30 * math.sin(k / 8), 30 * math.cos(k / 11))
        moving.drive(1, pose=pose, look=lambda s: commands[1].append(s.state.command))
    assert still.session.state.mode == moving.session.state.mode == "TRACK"
    np.testing.assert_array_equal(*commands)


def test_a_target_is_brought_to_the_middle():
    pilot = Pilot().following((500.0, 240.0))
    pilot.drive(20)
    assert pilot.session.state.command[0] > 1.0  # to the right
    pilot.sight.target = (319.5, 440.0, 1.0, True)
    before = pilot.session.state.command[1]
    pilot.drive(20)
    assert pilot.session.state.command[1] < before  # down


def test_a_target_that_rests_in_the_middle_is_focused_on_once():
    pilot = Pilot().following((319.5, 239.5))
    pilot.drive(20)
    pilot.sight.events = [{"what": "focused", "distance": 0.02, "verdict": "sharp"}]
    pilot.drive(40)
    assert pilot.sight.wishes.count("sharpen") == 1
    assert pilot.session.focus == "sharp"


@pytest.mark.parametrize("lost", ["target", "eyes"])
def test_a_target_out_of_sight_holds(lost):
    pilot = Pilot().following()
    if lost == "target":
        pilot.sight.target = (400.0, 200.0, 0.2, False)
    else:
        pilot.sight.seen = list  # nothing comes any more
    pilot.drive(40)
    assert pilot.session.state.mode == "HOLD"
    sentence = {"target": "lost from sight", "eyes": "no picture comes"}[lost]
    assert sentence in pilot.session.state.reason


def test_a_camera_that_is_gone_holds_in_time_and_no_mode_is_entered_until_it_is_back():
    pilot = Pilot().steering()
    pilot.drive(20, pose=right(15.0), stick=(1.0, 0.0))
    command, saw = pilot.session.state.command, pilot.sight.seen
    pilot.sight.seen = list  # nothing comes any more
    pilot.drive(4, pose=right(-40.0), stick=(1.0, 0.0))
    assert pilot.session.state.mode == "HOLD"
    assert pilot.session.state.rates == (0.0, 0.0)
    for mode in ("HEAD", "TRACK"):
        pilot.mode(mode)
        pilot.drive(5, pose=right(-40.0))
        assert pilot.session.state.mode == "HOLD"
        assert "no picture comes" in pilot.session.state.reason
    pilot.sight.seen = saw
    pilot.drive(2)
    assert "pictures come again" in told(pilot.session, "notice")[-1]["text"]
    assert pilot.session.state.mode == "HOLD"
    pilot.mode("HEAD")
    pilot.drive()
    assert pilot.session.state.mode == "HEAD"
    assert math.dist(pilot.session.state.command, command) < 4.0


def test_a_camera_that_is_gone_breaks_a_scan_off_and_forgets_the_target():
    pilot = scanning()
    pilot.sight.seen = list
    pilot.drive(5)
    assert (pilot.session.state.mode, pilot.session.scan) == ("HOLD", None)
    assert pilot.session.seen.target is None


def test_findings_of_a_loop_that_ended_are_taken_over_and_numbers_go_on():
    pilot = scanning()
    findings = told(pilot.session, "findings")[-1]["findings"]
    after = Pilot().following((319.5, 239.5))
    after.session.hear(messages.Known(findings=findings), after.now)
    assert after.session.findings == pilot.session.findings
    after.sight.events = [EXTRACTED]
    after.drive(2)
    assert [finding.number for finding in after.session.findings] == [1, 2]


def test_the_clutch_does_not_jump():
    pilot = Pilot().steering()
    pilot.drive(50, pose=right(15.0))
    before = pilot.session.state.command
    pilot.drive(20, pose=right(-25.0), clutch=True)
    pilot.drive(20, pose=right(-25.0))
    assert pilot.session.state.command == pytest.approx(before, abs=0.1)


def test_silence_holds_and_going_on_does_not_jump():
    pilot = Pilot().steering()
    pilot.drive(50, pose=right(15.0))
    pilot.silence(25)
    assert pilot.session.state.mode == "HOLD"
    before = pilot.session.state.command
    pilot.drive(5, pose=right(-40.0))
    pilot.mode("HEAD")
    pilot.drive(10, pose=right(-40.0))
    assert pilot.session.state.mode == "HEAD"
    assert pilot.session.state.command == pytest.approx(before, abs=0.1)


def test_a_pose_that_is_too_old_holds():
    pilot = Pilot().steering(20)
    pilot.drive(1, age=0.2)
    assert pilot.session.state.mode == "HOLD"
    assert "pose" in pilot.session.state.reason


def test_a_lost_sensor_holds_within_200_ms():
    pilot = Pilot().steering(20)
    head = pilot.plant.head
    fault = Fault("pan", "lost", head.clock)
    head._sensor = type(head._sensor)(head.outputs, 0.05, 0, [fault])
    pilot.drive(5, stick=(1.0, 0.0))
    assert pilot.session.state.mode == "HOLD"
    assert pilot.session.state.rates == (0.0, 0.0)
    assert "sensor" in pilot.session.state.reason
    pilot.drive(25)
    state = msgspec.json.decode(pilot.session.report(pilot.now))
    assert state["angle"][0] is None
    assert "pan" in state["trouble"]


def test_a_release_holds_and_forgets_the_pilot():
    pilot = Pilot().steering(20)
    pilot.order(messages.Release)
    pilot.silence()
    assert pilot.session.state.mode == "HOLD"
    pilot.mode("HEAD")
    pilot.silence()
    assert pilot.session.state.mode == "HOLD"


def test_what_cannot_be_measured_or_scanned_is_said():
    pilot = Pilot().steering(5)
    pilot.order(messages.Measure)
    pilot.order(messages.Scan)
    pilot.sight.events = [{"what": "extracted", "hole": None, "verdict": "nothing round"}]
    pilot.drive(2)
    sentences = " ".join(notice["text"] for notice in told(pilot.session, "notice"))
    for part in ("pick a point", "measure a finding first", "nothing round"):
        assert part in sentences
    assert pilot.session.findings == []
    assert pilot.session.state.mode == "HEAD"


def scanning(stick=(0.0, 0.0)):
    """In SCAN, over what the eyes saw, from where a second of the stick has brought it."""
    pilot = Pilot().following((319.5, 239.5))
    pilot.drive(25, stick=stick)
    pilot.drive(15)
    pilot.sight.events = [EXTRACTED]
    pilot.drive(2)
    pilot.order(messages.Scan)
    pilot.drive(2)
    assert pilot.session.state.mode == "SCAN"
    return pilot


def test_a_scan_goes_there_and_back_and_its_depth_goes_with_the_finding():
    pilot = scanning(stick=(1.0, 0.3))
    home = pilot.session.state.command, *pilot.session.where()[2:]
    pilot.until(lambda s: s.state.mode != "SCAN")
    session = pilot.session
    assert session.state.mode == "HOLD"
    assert "the scan is done" in session.state.reason
    wishes = pilot.sight.wishes
    assert [wishes.count(name) for name in ("sound", "shoot", "heard")] == [
        1,
        RasterScan.points**2,
        1,
    ]
    assert session.state.command == pytest.approx(home[0], abs=0.5)
    assert session.where()[2:] == pytest.approx(home[1:], abs=0.3)
    session.hear(messages.Sounded(finding=1, told=HEARD), pilot.now)
    (finding,) = session.findings
    assert (finding.depth, finding.depth_sd) == (0.502, 0.003)
    assert finding.diameter == 0.99
    assert told(session, "findings")[-1]["findings"][0]["verdict"] == "measured"


@pytest.mark.parametrize("how", ["mode", "silence", "release"])
def test_a_scan_is_broken_off_and_nothing_jumps(how):
    pilot = scanning()
    pilot.drive(60)
    before = pilot.session.state.command
    if how == "mode":
        pilot.mode("HOLD")
        pilot.drive()
    elif how == "silence":
        pilot.silence(4)
    else:
        pilot.order(messages.Release)
        pilot.silence()
    session = pilot.session
    assert session.state.mode == "HOLD"
    assert session.state.rates == (0.0, 0.0)
    assert math.dist(session.state.command, before) < 2.0
    assert pilot.sight.looks[-1].wishes or "dry" in pilot.sight.wishes
    assert session.scan is None
    assert any("broken off" in notice["text"] for notice in told(session, "notice"))


def test_what_echoes_could_not_tell_leaves_the_outline():
    pilot = scanning()
    before = pilot.session.findings[0]
    nothing = {"verdict": "no coupling", "diameter": None, "depth": None}
    pilot.session.hear(messages.Sounded(finding=1, told=nothing), pilot.now)
    (after,) = pilot.session.findings
    assert (after.verdict, after.kind, after.depth) == ("no coupling", "hole or pit", None)
    assert (after.phi, after.z, after.diameter) == (before.phi, before.z, before.diameter)
    pilot.order(messages.Forget, finding=1)
    assert pilot.session.findings == []


def test_a_number_is_never_used_again_and_a_late_fit_finds_nothing():
    pilot = scanning()
    pilot.order(messages.Forget, finding=1)
    pilot.drive(2)
    assert pilot.session.state.mode == "HOLD"
    assert "was dropped" in pilot.session.state.reason
    pilot.sight.events = [EXTRACTED]
    pilot.drive(2)
    pilot.session.hear(messages.Sounded(finding=1, told=HEARD), pilot.now)
    (finding,) = pilot.session.findings
    assert (finding.number, finding.depth) == (2, None)
    pilot.order(messages.Scan, finding=999)
    assert "no finding 999" in told(pilot.session, "notice")[-1]["text"]


def test_who_takes_the_controls_is_told_what_to_press():
    pilot = Pilot().steering(5)
    pilot.order(messages.Release)
    pilot.silence()
    pilot.session.hear(messages.Taken(), pilot.now)
    pilot.silence()
    assert "press Head" in pilot.session.state.reason


def test_pages_are_told_of_plane_and_memory():
    pilot = Pilot().steering(30)
    hello = msgspec.json.decode(pilot.session.introduction())
    state = msgspec.json.decode(pilot.session.report(pilot.now, late=0.001))
    for plane, memory in zip(hello["planes"], state["memory"], strict=True):
        assert len(plane["weights"]) == len(plane["levels"]) - 1
        assert plane["levels"][0] <= memory[-1] <= plane["levels"][-1]
    assert state["mode"] == "HEAD"
    assert state["late"] == 1.0
    assert state["heard"]["seq"] == pilot.seq
    assert AHEAD[3] == 1.0
