import signal
from multiprocessing import Pipe
from threading import Event
from types import SimpleNamespace

import msgspec
import numpy as np

from minorloop.errors import InstrumentError
from minorloop_head.console import camera_process, processes
from minorloop_head.console.camera_process import StillTip, _warm_up, answer, newest
from minorloop_head.console.camera_protocol import CameraRequest, report_decoder
from minorloop_head.console.channel import Outbox
from minorloop_head.console.perception import Perception
from minorloop_head.console.settings import LoopSettings
from minorloop_head.control.head import head_control
from minorloop_head.geometry import Pinhole
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.twins.camera import led_positions
from minorloop_head.vision import _outline_kernels
from wires import identified


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


def test_a_request_without_a_picture_is_not_answered():
    def tick(request):
        raise InstrumentError("camera:0 gives no picture")

    ours, theirs = Pipe()
    theirs.send_bytes(msgspec.msgpack.encode(CameraRequest(number=1, t=0.0, position=(0.0,) * 4)))
    assert answer(SimpleNamespace(tick=tick), ours, None) == "camera:0 gives no picture"
    assert not theirs.poll()


def test_a_camera_compiles_with_pictures_that_are_good_enough_to_track_and_search(monkeypatch):
    perception = Perception(
        StillTip(Pinhole()), HeadCalibration(lens=Pinhole(), leds=led_positions())
    )
    told = []
    monkeypatch.setattr(perception, "_report", lambda what, **found: told.append((what, found)))
    _warm_up(perception)
    assert told == [("picked", {}), ("found", {"count": 0, "verdict": "good"})]


def test_outlines_are_compiled_before_a_picture_has_a_candidate(monkeypatch):
    fitted = []
    monkeypatch.setattr(_outline_kernels, "outline", lambda images, *_: fitted.append(images.dtype))
    nothing = dict.fromkeys(("finish", "reset"), lambda: None)
    _warm_up(SimpleNamespace(tick=lambda request: None, **nothing))
    assert fitted == [np.float32]


def test_angles_are_counted_from_where_the_cold_wires_are_by_their_models(monkeypatch):
    view = HeadCalibration(lens=Pinhole(), leds=led_positions())
    control = head_control("observer", (identified().model,) * 2)
    head = SimpleNamespace(control=lambda **_: control, calibration=view)
    asked, over = [], Event()
    over.set()

    class Supervised:
        def __init__(self, parts, *_, **__):
            (self.camera,) = (part for part in parts if part.name == "camera")

        def start(self):
            handle = SimpleNamespace(begin=lambda **_: over)
            self.camera.target(handle, *self.camera.args)

        def run(self):
            pass

        end = run

    def angles(view, cold):
        asked.append(cold)
        raise InstrumentError("this test ends here")

    monkeypatch.setattr(processes, "Supervisor", Supervised)
    monkeypatch.setattr(camera_process, "SeenAngles", angles)
    monkeypatch.setattr(
        camera_process, "LiveCamera", lambda address: SimpleNamespace(close=lambda: None)
    )
    settings = LoopSettings(address="bench:head.toml", camera="camera:0", sensors=False)
    before = signal.getsignal(signal.SIGTERM)
    processes.supervised(settings, None, print, head=head)
    assert signal.getsignal(signal.SIGTERM) is before
    assert asked == [tuple(control.cold.tolist())]
    assert asked[0] != (0.0, 0.0)


class Settling(StillTip):
    """A tip whose camera shows the lights before in two pictures after each switch."""

    def __init__(self, lens):
        super().__init__(lens)
        self.before = 0

    def light(self, lights):
        super().light(lights)
        self.before = 2

    def newest(self):
        self.before -= 1
        return None if self.before >= 0 else self.frame()


def test_a_camera_that_waits_for_its_lights_answers_every_request_of_the_loop():
    view = HeadCalibration(lens=Pinhole(), leds=led_positions())
    perception, outbox = Perception(Settling(view.lens), view), Outbox()
    ours, theirs = Pipe()
    found, shown = [], []
    for number in range(30):
        commands = [("find", [])] if number == 1 else []
        request = CameraRequest(number=number, t=0.04 * number, position=(0.0,) * 4)
        request = msgspec.structs.replace(request, commands=commands)
        theirs.send_bytes(msgspec.msgpack.encode(request))
        assert answer(perception, ours, outbox) == ""
        found.append(report_decoder.decode(theirs.recv_bytes()))
        shown.append(outbox.wait()[1] is not None if perception.shown else False)
    assert [each.number for each in found] == list(range(30))
    assert sum(event["what"] == "found" for each in found for event in each.events) == 1
    # A picture that shows other lights, or those before, is not shown; others are.
    assert shown[0]
    assert not any(shown[2:12])
    assert all(shown[20:])
