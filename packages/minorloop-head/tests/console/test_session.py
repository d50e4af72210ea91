import math
from copy import deepcopy
from dataclasses import asdict, replace
from functools import cache, partial

import msgspec
import numpy as np
import pytest

from console_rig import PIT, Pilot, ScriptedCamera, position, right
from minorloop_head.console import messages
from minorloop_head.console.mark import NO_CONTACT, TOUCHED
from minorloop_head.procedures.mark import tool_pixel
from minorloop_head.procedures.scan import RasterScan
from minorloop_head.reconstruction.findings import outlined
from minorloop_head.twins.sensor import SimulatedFault
from minorloop_head.ultrasound.c_scan import EchoFind

HOLE = {"phi": PIT[0], "z": PIT[1], "diameter": PIT[2], "evidence": 1.0}
EXTRACTED = {"what": "extracted", "hole": HOLE, "verdict": "dark"}
PATCH = {"phi": 25.0, "z": 23.0, "step": 0.1, "depth": [[0.0, None]], "through": [[0, 1]]}
RESULT = {
    "phi": 0.451, "z": 24.01e-3, "diameter": 0.99e-3, "depth": 0.502e-3, "place_sd": 34e-6,
    "diameter_sd": 18e-6, "depth_sd": 3e-6, "verdict": "measured", "patch": PATCH,
}  # fmt: skip


def sent(session, kind):
    """Messages of a kind to the pages."""
    every = [msgspec.json.decode(event) for event in session.events]
    return [each for each in every if each["type"] == kind]


def test_the_head_goes_where_the_operator_looks():
    pilot = Pilot().steering()
    pilot.drive(150, pose=right(20.0, -10.0))
    pan, tilt, *_ = position(pilot.session)
    assert pilot.session.state.mode == "HEAD"
    assert pan > 8
    assert tilt < -4
    assert (pan, tilt) == pytest.approx(np.degrees(pilot.session.state.command), abs=1.0)


def test_the_catheter_follows_the_stick_and_stops_without_messages():
    pilot = Pilot().steering(50)
    pilot.drive(70, stick=(1.0, 0.0))
    assert position(pilot.session)[2] > 5.0
    pilot.silence(3)
    assert pilot.session.state.mode == "HOLD"
    assert pilot.session.state.rates == (0.0, 0.0)
    pilot.silence(8)
    before = position(pilot.session)
    pilot.silence(25)
    assert position(pilot.session)[2] == pytest.approx(before[2], abs=0.3)


def test_a_camera_that_is_gone_holds_in_time_and_no_mode_is_entered_until_it_is_back():
    pilot = Pilot().steering()
    pilot.drive(20, pose=right(15.0), stick=(1.0, 0.0))
    command, reports = pilot.session.state.command, pilot.camera.reports
    pilot.camera.reports = list  # nothing comes any more
    pilot.drive(4, pose=right(-40.0), stick=(1.0, 0.0))
    assert pilot.session.state.mode == "HOLD"
    assert pilot.session.state.rates == (0.0, 0.0)
    for mode in ("HEAD", "TRACK"):
        pilot.mode(mode)
        pilot.drive(5, pose=right(-40.0))
        assert pilot.session.state.mode == "HOLD"
        assert "no picture came" in pilot.session.state.reason
    pilot.camera.problem = "camera:0 gives no new picture; check the camera and its cable"
    pilot.mode("HEAD")
    pilot.drive(5, pose=right(-40.0))
    assert "at least 9 pictures a second" in pilot.session.state.reason
    state = msgspec.json.decode(pilot.session.report(pilot.now))
    assert state["trouble"] == pilot.camera.problem
    pilot.camera.problem = ""
    pilot.camera.reports = reports
    pilot.drive(2)
    assert "pictures come again" in sent(pilot.session, "notice")[-1]["text"]
    assert pilot.session.state.mode == "HOLD"
    pilot.mode("HEAD")
    pilot.drive()
    assert pilot.session.state.mode == "HEAD"
    assert math.dist(pilot.session.state.command, command) < 0.07


def test_that_the_plant_may_still_be_on_is_said_until_it_is_off():
    pilot = Pilot().steering(10)
    pilot.session.danger = "the source may still be on, switch it off by hand"
    pilot.session.rest("lost")
    pilot.session.receive(messages.ControlsTaken(), pilot.now)
    pilot.mode("HEAD")
    pilot.drive(5)
    pilot.session.hold("a sensor was lost")
    state = msgspec.json.decode(pilot.session.report(pilot.now))
    assert (state["mode"], state["trouble"]) == ("HOLD", pilot.session.danger)
    assert state["reason"] == f"{pilot.session.danger}; press Head (1) when it is back"
    pilot.session.danger = ""
    pilot.mode("HEAD")
    pilot.drive(2)
    assert pilot.session.state.mode == "HEAD"


def test_the_wires_are_cold_until_a_mode_is_pressed():
    pilot = Pilot()
    pilot.session.receive(messages.ControlsTaken(), pilot.now)
    pilot.drive(25)
    assert np.degrees(pilot.plant.stance()[:2]) == pytest.approx([-30.0, -30.0], abs=1.5)
    assert [axis.applied for axis in pilot.session._control.axes] == [0.0, 0.0]
    pilot.steering(150)
    assert np.degrees(pilot.plant.stance()[:2]) == pytest.approx([0.0, 0.0], abs=3.0)


@pytest.mark.parametrize("how", ["mode", "silence", "rest"])
def test_a_hold_stops_the_head_where_it_is(how):
    pilot = Pilot().steering(125)
    pilot.drive(30 if how != "rest" else 100, pose=right(25.0))
    there = np.degrees(pilot.plant.stance()[:2])
    behind = np.degrees(pilot.session.state.command) - there
    assert (np.hypot(*behind) > 3.0) == (how != "rest")
    if how == "mode":
        pilot.mode("HOLD")
        pilot.drive()
    pilot.silence(50)
    moved = np.degrees(pilot.plant.stance()[:2]) - there
    assert pilot.session.state.mode == "HOLD"
    assert np.hypot(*moved) < 1.6


def test_findings_of_a_loop_that_ended_are_taken_over_and_numbers_continue():
    pilot = scanning()
    texts = [text for text in pilot.session.events if text.startswith(b'{"type":"findings"')]
    findings = messages.decode_findings(texts[-1])
    after = Pilot().following((319.5, 239.5))
    after.session.receive(messages.KnownFindings(findings=findings), after.now)
    assert after.session.findings == pilot.session.findings
    after.camera.events = [EXTRACTED]
    after.drive(2)
    assert [finding.number for finding in after.session.findings] == [1, 2]


def test_a_pose_of_the_page_that_jumps_holds_and_a_clutch_lets_it_pass():
    pilot = Pilot().steering()
    pilot.drive(1, pose=right(60.0))
    state = pilot.session.state
    assert (state.mode, state.reason) == (
        "HOLD", "the pose of the operator's head jumped; press HEAD to continue",
    )  # fmt: skip
    pilot.mode("HEAD")
    pilot.drive(5, pose=right(60.0))
    pilot.drive(2, pose=right(0.0), clutch=True)
    pilot.drive(2, pose=right(0.0))
    assert pilot.session.state.mode == "HEAD"


def test_a_lost_sensor_holds_within_200_ms():
    pilot = Pilot().steering(20)
    head = pilot.plant.head
    fault = SimulatedFault("pan", "lost", head.clock)
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


def scanning(stick=(0.0, 0.0)):
    """In SCAN of a finding, after a second of the stick."""
    pilot = Pilot().following((319.5, 239.5))
    pilot.drive(25, stick=stick)
    pilot.drive(15)
    pilot.camera.events = [EXTRACTED]
    pilot.drive(2)
    pilot.order(messages.Scan)
    pilot.drive(2)
    assert pilot.session.state.mode == "SCAN"
    return pilot


def test_a_scan_returns_home_and_its_depth_is_added_to_the_finding(monkeypatch):
    few = partial(RasterScan, points=3)
    monkeypatch.setattr("minorloop_head.console.scanning.RasterScan", few)
    pilot = scanning(stick=(1.0, 0.3))
    home = pilot.session.state.command, *position(pilot.session)[2:]
    pilot.until(lambda s: s.state.mode != "SCAN")
    session = pilot.session
    assert session.state.mode == "HOLD"
    assert "the scan is done" in session.state.reason
    commands = pilot.camera.commands
    assert [commands.count(name) for name in ("begin_scan", "fire", "finish_scan")] == [1, 9, 1]
    assert session.state.command == pytest.approx(home[0], abs=8.7e-3)
    assert position(session)[2:] == pytest.approx(home[1:], abs=0.3)
    session.receive(messages.DepthFitted(finding=1, result=RESULT), pilot.now)
    (finding,) = session.findings
    assert (finding.depth, finding.depth_sd) == (0.502, 0.003)
    assert finding.diameter == 0.99
    assert sent(session, "findings")[-1]["findings"][0]["verdict"] == "measured"


@pytest.mark.parametrize("how", ["mode", "silence"])
def test_a_scan_is_stopped_without_a_jump(how):
    pilot = scanning()
    pilot.drive(60)
    before = pilot.session.state.command
    if how == "mode":
        pilot.mode("HOLD")
        pilot.drive()
    else:
        pilot.silence(4)
    session = pilot.session
    assert session.state.mode == "HOLD"
    assert session.state.rates == (0.0, 0.0)
    assert math.dist(session.state.command, before) < 0.035
    assert pilot.camera.requests[-1].commands or "end_scan" in pilot.camera.commands
    assert session.scan is None
    assert any("stopped" in notice["text"] for notice in sent(session, "notice"))


def test_a_number_is_never_used_again_and_a_late_fit_finds_nothing():
    pilot = scanning()
    pilot.order(messages.Forget, finding=1)
    pilot.drive(2)
    assert pilot.session.state.mode == "HOLD"
    assert "was deleted" in pilot.session.state.reason
    pilot.camera.events = [EXTRACTED]
    pilot.drive(2)
    pilot.session.receive(messages.DepthFitted(finding=1, result=RESULT), pilot.now)
    (finding,) = pilot.session.findings
    assert (finding.number, finding.depth) == (2, None)
    pilot.order(messages.Scan, finding=999)
    assert "no finding 999" in sent(pilot.session, "notice")[-1]["text"]


def every_command(pilot):
    """Names and numbers of all commands to the camera process."""
    return [command for request in pilot.camera.requests for command in request.commands]


def numbers_of(pilot, name):
    """Numbers of all commands of a name."""
    return [numbers for one, numbers in every_command(pilot) if one == name]


@cache
def beside():
    """In TRACK of a scripted target on the wall beside the head; to be copied."""
    pilot = Pilot().steering()
    pilot.drive(200, pose=right(36.0, -15.0))
    pilot.camera.target = (319.5, 239.5, 1.0, True)
    pilot.drive(2)
    pilot.mode("TRACK")
    pilot.drive()
    return pilot


def marking():
    """With the tool on its way to a scripted target."""
    pilot = deepcopy(beside())
    pilot.order(messages.Mark)
    pilot.drive(2)
    assert numbers_of(pilot, "mark") == [[]]
    assert texts(pilot) == ["the tool is turned to the point"]
    return pilot


def texts(pilot):
    return [notice["text"] for notice in sent(pilot.session, "notice")]


def test_the_tool_and_not_the_axis_is_turned_to_the_target():
    pilot = marking()
    now, known = pilot.session._reading(), pilot.session.view
    away = np.subtract(tool_pixel(known, known.tool, now.place, now.angles), known.lens.centre)
    pan, tilt = pilot.session._servo()
    assert np.hypot(*away) > 20.0
    assert tilt * away[1] > 0.0  # up, so that the target goes down
    pilot.camera.target = (*np.add(known.lens.centre, away).tolist(), 1.0, True)
    pilot.drive(2)
    assert np.abs(pilot.session._servo()).max() < 0.2 * np.hypot(pan, tilt)


@pytest.mark.parametrize(
    ("events", "said"),
    [
        ([{"what": "not extended", "text": "this head has no tool"}], "this head has no tool"),
        ([{"what": "marked", "verdict": "no contact", "off": None}], NO_CONTACT),
        (
            [{"what": "touched"}, {"what": "marked", "verdict": "touched", "off": 0.12e-3}],
            "the tool has touched the wall 0.12 mm from the picked point, and is withdrawn",
        ),
        (
            [{"what": "touched"}, {"what": "picked"}],
            f"{TOUCHED}; its distance from the picked point is not known: another point was picked",
        ),
    ],
)
def test_the_tool_is_withdrawn_with_one_sentence(events, said):
    pilot = marking()
    pilot.camera.events = events
    pilot.drive(2)
    assert numbers_of(pilot, "end_mark") == [[]]
    assert texts(pilot)[1:] == [said]
    assert pilot.session.state.mode == "TRACK"
    pilot.mode("HEAD")
    pilot.drive(2)
    assert pilot.session.state.mode == "HEAD"
    assert len(texts(pilot)) == 2


def test_a_mark_is_stopped_by_another_pick_or_mode_and_not_begun_twice():
    pilot = marking()
    pilot.order(messages.Mark)
    assert "already" in texts(pilot)[-1]
    pilot.camera.events = [{"what": "picked"}]
    pilot.drive(2)
    assert "another point was picked" in texts(pilot)[-1]
    assert numbers_of(pilot, "end_mark") == [[]]
    pilot.order(messages.Mark)
    pilot.camera.reports = list  # no picture comes any more
    pilot.drive(5)
    assert pilot.session.state.mode == "HOLD"
    assert "the mark was stopped: no picture came" in texts(pilot)[-1]


class Seeing(ScriptedCamera):
    """A camera that gives the angles of the plant, once it knows the cold head."""

    def __init__(self):
        super().__init__()
        self.zero, self.joints, self.why = False, (0.0, 0.0), ""

    def reports(self):
        joints = self.joints if self.zero else None
        return [
            msgspec.structs.replace(each, joints=joints, unseen=self.why, zero=self.zero)
            for each in super().reports()
        ]


def test_a_head_without_sensors_waits_for_its_zero_and_goes_by_the_pictures():
    pilot = Pilot(Seeing())
    session, camera = pilot.session, pilot.camera
    session.sensors, session.seen = False, msgspec.structs.replace(session.seen, zero=False)
    camera.why = "the angles are counted from the cold head; it has to stand still first"
    exchange = pilot.plant.exchange

    def blind(u):
        y = exchange(u)
        camera.joints = tuple(np.degrees(y[:2]).tolist())
        return np.array([np.nan, np.nan, *y[2:]])

    pilot.plant.exchange = blind
    pilot.steering(5)
    assert session.state.mode == "HOLD"
    assert camera.why in session.state.reason
    assert all(each.cold and each.holding for each in camera.requests)
    camera.zero = True
    pilot.steering(150)
    assert session.state.mode == "HEAD"
    assert not camera.requests[-1].cold
    assert not camera.requests[-1].holding
    assert position(session)[:2] == pytest.approx(np.degrees(session.state.command), abs=1.5)
    camera.joints = None
    pilot.plant.exchange = lambda u: np.full(4, np.nan)
    camera.why = "the picture is saturated"
    pilot.drive(60)
    assert session.state.mode == "HOLD"
    assert "switch LEDs off" in session.state.reason
    camera.zero = False  # its process was started anew
    assert not pilot.session.tick(pilot.now).any() or not pilot.session.tick(pilot.now).any()
    assert "does not know the angles" in session.state.reason


def sweeping():
    """In SCAN of a sweep, the head looking at the wall."""
    pilot = Pilot().steering()
    pilot.drive(150, pose=right(20.0, -10.0))
    before = position(pilot.session)
    pilot.order(messages.Sweep)
    pilot.drive(2)
    assert pilot.session.state.mode == "SCAN"
    return pilot, before


def test_a_sweep_fires_on_its_lines_and_its_finds_are_listed(monkeypatch):
    monkeypatch.setattr("minorloop_head.console.scanning.ALONG", 0.3e-3)  # a few lines
    pilot, before = sweeping()
    scans = []
    pilot.until(
        lambda s: scans.append(s._scanning.progress()) or s.state.mode != "SCAN", ticks=4000
    )
    session, commands = pilot.session, pilot.camera.commands
    assert (session.state.mode, session.scan) == ("HOLD", None)
    assert "the sweep is done" in session.state.reason
    assert position(session) == pytest.approx(before, abs=1.5)
    ends = [numbers for name, numbers in every_command(pilot) if name == "end_sweep"]
    assert ends == [[1.0]]
    assert [commands.count(name) for name in ("begin_sweep", "end_sweep", "end_scan")] == [1, 1, 0]
    assert commands.count("fire_on") > 50
    assert commands.index("begin_sweep") < commands.index("fire_on")
    shares = [each.progress for each in scans if each is not None]
    assert {each.finding for each in scans if each is not None} == {0}
    assert shares == sorted(shares)
    assert shares[-1] > 0.8
    find = EchoFind("pit", 0.45, 20e-3, 1e-3, 1e-3, 0.5e-3, 5e-6)
    other = replace(find, kind="crack", depth=math.nan, depth_sd=math.nan)
    finds = [asdict(each.finding(10e-3)) for each in (find, other)]
    session.receive(messages.SweepFitted(finds=finds), pilot.now)
    listed = sent(session, "findings")[-1]["findings"]
    assert [(each["number"], each["kind"], each["depth"]) for each in listed] == [
        (1, "pit", 0.5),
        (2, "crack", None),
    ]


def test_another_mode_cuts_a_sweep_and_a_hold_stops_the_way_back():
    pilot, _ = sweeping()
    pilot.until(lambda s: pilot.camera.commands.count("fire_on") > 5)
    pilot.order(messages.Sweep)
    assert "a sweep is on already" in texts(pilot)[-1]
    pilot.mode("HEAD")
    pilot.drive(3)
    assert pilot.session._scanning.progress().stage == "back"
    assert ("end_sweep", [0.0]) in every_command(pilot)
    pilot.mode("HOLD")
    pilot.drive(2)
    assert (pilot.session.state.mode, pilot.session.scan) == ("HOLD", None)
    assert "on its way back" in texts(pilot)[-1]
    pilot.mode("HEAD")
    pilot.drive(2)
    assert pilot.session.state.mode == "HEAD"


def test_a_sweep_lists_what_is_known_before_no_second_time():
    pilot = Pilot()
    known = replace(outlined(6.2, 20e-3, 1e-3, "measured", radius=10e-3), kind="pit")
    beside = replace(known, phi=0.3, kind="crack", verdict="swept")
    again = replace(known, phi=6.25 - 2 * math.pi, verdict="swept")
    for finds in ([known], [again, beside, replace(known, z=24e-3)], [again, beside]):
        pilot.session.receive(messages.SweepFitted(finds=[asdict(each) for each in finds]), 0.0)
    assert [(f.kind, f.z) for f in pilot.session.findings] == [
        ("pit", 20.0), ("crack", 20.0), ("pit", 24.0),
    ]  # fmt: skip
