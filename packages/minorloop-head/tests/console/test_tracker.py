import math
import socket
import struct
from contextlib import closing

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.real_turns import Turns, replay
from console_rig import Pilot
from minorloop.errors import ParameterError
from minorloop_head.console.head_pose import angle_between
from minorloop_head.console.tracker import UdpTracker, decoded, listening_for

LOST = 3  # ticks until an old pose counts as lost


def packet(yaw=0.0, pitch=0.0, roll=0.0, place=(1.0, -2.0, 60.0)):
    return struct.pack("<6d", *place, yaw, pitch, roll)


@pytest.fixture
def sender():
    """A tracker that knows nothing of the console, and the socket that it sends to."""
    with closing(listening_for("udp:0")) as receiving:
        sending = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        with closing(sending):
            sending.connect(receiving.getsockname())
            yield sending, receiving


@pytest.fixture
def flown(sender):
    """A pilot in HEAD whose tracker looks 10 degrees to the right, and what sends its packets."""
    sending, receiving = sender
    pilot = Pilot()
    pilot.session.tracker = UdpTracker(receiving)

    def look(*content, ticks=1):
        for _ in range(ticks):
            for each in content:
                sending.send(each)
            pilot.drive(pose=None)

    look(packet())
    pilot.mode("HEAD")
    look(packet(), ticks=2)
    look(packet(yaw=10.0), ticks=20)
    assert pilot.session.state.mode == "HEAD"
    return pilot, look


@pytest.mark.parametrize("angles", [(0, 0, 0), (20, 0, 0), (-15, 30, 5), (170, -60, -40)])
def test_a_packet_is_a_turn_to_the_right_then_up_then_a_roll(angles):
    yaw, pitch, roll = angles
    wanted = Rotation.from_euler("YXZ", [-yaw, pitch, roll], degrees=True).as_quat()
    assert abs(wanted @ decoded(packet(*angles))) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(
    "damaged",
    [
        b"",
        packet()[:-1],
        packet() + b"\0",
        packet(yaw=math.nan),
        packet(roll=math.inf),
        packet(yaw=400.0),
        packet(place=(0.0, 1e308, 0.0)),
    ],
)
def test_a_damaged_packet_holds_the_head_and_a_key_goes_on(flown, damaged):
    pilot, look = flown
    before = pilot.session.state.command
    look(packet(yaw=10.0), damaged, packet(yaw=10.0))
    state = pilot.session.state
    assert (state.mode, state.command) == ("HOLD", before)
    assert state.reason == "the tracker sent a damaged packet; press HEAD to continue"
    look(packet(yaw=10.0))
    pilot.mode("HEAD")
    look(packet(yaw=10.0), ticks=5)
    assert (pilot.session.state.mode, pilot.session.state.command) == ("HEAD", before)


def test_the_head_follows_the_tracker_and_not_the_page(flown):
    pilot, _ = flown
    pan, tilt = pilot.session.state.command
    assert pan > math.radians(1.0)
    assert tilt == pytest.approx(0.0, abs=1e-9)


def test_a_silent_tracker_holds_the_head(flown):
    pilot, look = flown
    look(ticks=LOST)
    assert pilot.session.state.mode == "HOLD"
    assert pilot.session.state.reason == "the tracker sends nothing; press HEAD to continue"
    before = pilot.session.state.command
    look(packet(yaw=-10.0), ticks=10)  # it does not go on by itself
    assert (pilot.session.state.mode, pilot.session.state.command) == ("HOLD", before)


def test_a_jump_holds_the_head_where_it_is(flown):
    pilot, look = flown
    before = pilot.session.state.command
    look(packet(yaw=-60.0))
    assert pilot.session.state.command == before
    assert pilot.session.state.reason == "the pose of the tracker jumped; press HEAD to continue"
    look(packet(yaw=-60.0))
    pilot.mode("HEAD")
    look(packet(yaw=-60.0), ticks=5)  # the new pose is where the head is
    assert (pilot.session.state.mode, pilot.session.state.command) == ("HEAD", before)


def test_a_tracker_that_was_never_heard_turns_nothing(sender):
    pilot = Pilot()
    pilot.session.tracker = UdpTracker(sender[1])
    pilot.drive()  # the page has a pose, which does not count
    pilot.mode("HEAD")
    pilot.drive(5)
    assert pilot.session.state.mode == "HOLD"


def test_a_turn_across_180_degrees_is_no_jump():
    assert angle_between(decoded(packet(179.0)), decoded(packet(-179.0))) == pytest.approx(
        math.radians(2.0)
    )


@pytest.mark.parametrize("address", ["4242", "udp:", "udp:x", "udp:70000", "tcp:4242", "udp:-1"])
def test_what_is_no_address_of_a_tracker_is_refused(address):
    with pytest.raises(ParameterError, match=r"give udp:PORT or udp:HOST:PORT"):
        listening_for(address)


@pytest.mark.parametrize("udp", [True, False])
def test_a_planted_jump_holds_and_a_fast_turn_does_not(udp):
    t = np.arange(0.0, 3.0, 0.017)
    yaw = 60.0 * np.sin(2 * np.pi * t)  # up to 377 degrees a second
    yaw[t > 2.5] += 120.0
    poses = Rotation.from_euler("Y", -yaw[:, None], degrees=True).as_quat()
    seen = replay(Turns(t, poses), udp=udp)
    assert [round(at, 1) for at, _, _ in seen.holds] == [2.5]
    assert "jumped" in seen.holds[0][2]
    assert seen.beyond == 0
