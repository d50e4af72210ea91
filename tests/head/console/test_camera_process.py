from multiprocessing import Pipe

import msgspec

from minorloop.head.console.camera_process import newest
from minorloop.head.console.camera_protocol import CameraRequest


def test_the_newest_request_has_the_commands_of_those_before_it():
    ours, theirs = Pipe()
    for number, commands in ((1, [("find", [])]), (2, []), (3, [("focus", [0.02])])):
        request = CameraRequest(
            number=number, t=0.04 * number, position=(0.0,) * 4, commands=commands
        )
        theirs.send_bytes(msgspec.msgpack.encode(request))
    found = newest(ours)
    assert found.number == 3
    assert found.commands == [("find", []), ("focus", [0.02])]
    assert not ours.poll()
