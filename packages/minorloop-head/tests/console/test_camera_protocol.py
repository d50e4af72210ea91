from multiprocessing import Pipe

import msgspec

from minorloop_head.console.camera_protocol import (
    PICTURED,
    CameraReport,
    CameraRequest,
    RemoteCamera,
)
from minorloop_head.console.channel import NewestPipe


def request(number, *commands):
    return CameraRequest(number=number, t=0.0, position=(0.0,) * 4, commands=list(commands))


def test_nothing_is_sent_before_the_introduction_and_reports_and_pictures_come():
    ours, theirs = Pipe()
    camera = RemoteCamera(NewestPipe(theirs))
    pictures = []
    camera.on_picture = pictures.append
    camera.send(request(1, ("find", [])))
    assert camera.introduction(0.0) is None
    ours.send_bytes(msgspec.json.encode({"lens": 1}))
    assert camera.introduction(60.0) == {"lens": 1}
    camera.keep = True
    camera.send(request(2))
    found = msgspec.msgpack.decode(ours.recv_bytes(), type=CameraRequest)
    assert (found.number, found.commands, found.keep) == (2, [], True)  # the first was too early
    ours.send_bytes(PICTURED + b"jpeg")
    ours.send_bytes(msgspec.msgpack.encode(CameraReport(number=2)))
    reports = []
    while not reports:
        reports = camera.reports()
    assert reports == [CameraReport(number=2)]
    assert pictures == [b"jpeg"]
