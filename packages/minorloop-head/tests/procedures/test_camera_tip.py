from types import SimpleNamespace

import numpy as np
import pytest

from minorloop.errors import InstrumentError
from minorloop_head.geometry import Pinhole
from minorloop_head.procedures.actuator_plant import CameraTip
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.sources import Frame

VIEW = HeadCalibration(
    lens=Pinhole(64, 48, 50.0, (31.5, 23.5)), leds=np.zeros((3, 3)), latency=0.06
)
SMOOTH = np.add.outer(np.arange(48), np.arange(64)).astype(np.uint8) + 40


def tip_of(*images):
    """A tip whose camera gives some images, and a list of what was set."""
    waiting, done = list(images), []
    camera = SimpleNamespace(
        address="camera:0",
        frame=lambda: Frame(0.0, waiting.pop(0)),
        expose=lambda *numbers: done.append(("expose", *numbers)),
        renew=lambda: done.append("renewed"),
    )
    own = SimpleNamespace(switch=lambda lights: done.append(("switch", lights)))
    return CameraTip(own, camera, VIEW), done


def test_good_pictures_pass():
    tip, _ = tip_of(SMOOTH, SMOOTH + 1)
    assert tip.frame().image is SMOOTH
    assert (tip.frame().image == SMOOTH + 1).all()


@pytest.mark.parametrize(
    ("image", "sentence"),
    [
        (np.zeros((24, 32), np.uint8), "of 32 by 24 pixels and was calibrated with 64 by 48"),
        (SMOOTH, "repeats the same picture"),
        (np.where(np.arange(48)[:, None] < 24, SMOOTH, 255 - SMOOTH), "torn"),
        (np.full((48, 64), 90, np.uint8), "even grey"),
    ],
)
def test_bad_pictures_are_refused_with_the_cause(image, sentence):
    tip, _ = tip_of(SMOOTH, image.astype(np.uint8))
    tip.frame()
    with pytest.raises(InstrumentError, match=sentence):
        tip.frame()


def test_the_camera_is_exposed_and_the_lights_are_those_of_the_tip():
    tip, done = tip_of()
    tip.expose(2e-3, 1.5)
    tip.switch((True, False, False))
    assert done == [("expose", 2e-3, 1.5), ("switch", (True, False, False))]


def test_pictures_of_the_time_before_the_lights_were_switched_are_left_out(monkeypatch):
    monkeypatch.setattr("minorloop_head.procedures.actuator_plant.time.monotonic", lambda: 10.0)
    waiting = [Frame(10.05, SMOOTH), Frame(10.07, SMOOTH + 1)]
    camera = SimpleNamespace(address="camera:0", frame=lambda: waiting.pop(0))
    own = SimpleNamespace(switch=lambda lights: None)
    tip = CameraTip(own, camera, VIEW)
    tip.switch((True, False, False))
    assert tip.frame().t == 10.07
    waiting += [Frame(10.05, SMOOTH), Frame(10.07, SMOOTH)]
    assert tip.newest() is None
    assert tip.newest().t == 10.07
