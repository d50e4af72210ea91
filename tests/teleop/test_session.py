import math

import msgspec
import numpy as np
import pytest

from minorloop.teleop import messages
from minorloop.twins.sensor import Fault
from seats import AHEAD, Pilot, right


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


def test_a_hole_is_picked_tracked_and_measured():
    pilot = Pilot().tracking()
    session = pilot.session
    assert session.state.mode == "TRACK"
    middle = (session.view.width - 1) / 2, (session.view.height - 1) / 2
    assert math.dist((session.target.u, session.target.v), middle) < 3.0
    pilot.order(messages.Measure)
    (finding,) = session.findings
    # The picture has a white hole of 1 mm at 0.35 rad and 30 mm.
    assert finding.diameter == pytest.approx(1.0, rel=0.15)
    assert finding.phi == pytest.approx(math.degrees(0.35), abs=0.5)
    assert finding.z == pytest.approx(30.0, abs=0.3)
    assert finding.bright
    assert finding.depth is None
    pilot.order(messages.Forget, finding=finding.number)
    assert session.findings == []


def test_the_operators_head_does_not_move_a_tracked_target():
    still, moving = Pilot().tracking(), Pilot().tracking()
    seen = ([], [])
    still.drive(60, look=lambda s: seen[0].append((s.target.u, s.target.v)))
    for k in range(60):
        pose = right(30 * math.sin(k / 8), 30 * math.cos(k / 11))
        moving.drive(1, pose=pose, look=lambda s: seen[1].append((s.target.u, s.target.v)))
    assert np.abs(np.subtract(*seen)).max() == 0.0
    assert np.ptp(seen[1], axis=0).max() < 2.0


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


def test_a_lost_sensor_holds():
    pilot = Pilot().steering(20)
    fault = Fault("pan", "lost", pilot.plant._head.clock)
    pilot.plant._head._sensor = type(pilot.plant._head._sensor)(
        pilot.plant._head.outputs, 0.05, 0, [fault]
    )
    pilot.drive(30)
    assert pilot.session.state.mode == "HOLD"
    assert "sensor" in pilot.session.state.reason
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


def test_what_cannot_be_measured_is_said():
    pilot = Pilot().steering(5)
    pilot.order(messages.Measure)
    assert pilot.session.findings == []
    assert "pick one" in pilot.session.events[-1].decode()


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
