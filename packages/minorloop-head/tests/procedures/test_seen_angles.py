"""A head whose angles are read from pictures, as an actuator with runs that can be continued."""

import numpy as np
import pytest

from minorloop import Channel, InstrumentError, ParameterError, Plan, Setup, Store, run
from minorloop.lab.wrapped_actuator import single_channel
from minorloop_head.console.plant import open_plant, open_tip
from minorloop_head.geometry import Pinhole
from minorloop_head.procedures import seen_angles
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.identify import check_head
from minorloop_head.procedures.seen_angles import SeenHead, sweep
from minorloop_head.sources import Frame
from minorloop_head.twins.rig import RigWires
from simulated_plant import Clock


@pytest.fixture(autouse=True)
def soon_cold(monkeypatch):
    monkeypatch.setattr(seen_angles, "_STILL", 0.4)


def head(spoil=lambda frame: frame, **options):
    """A cold head, and its rig for scoring."""
    rig = open_plant("twin:pipe", specimen=1002, seed=3)
    tip, view = open_tip("twin:pipe", specimen=1002, seed=3, scale=0.25)
    wires = RigWires(rig, tip)
    seen = SeenHead(
        wires, lambda: spoil(wires.frame()), view, expose=tip.expose, every=4, **options
    )
    return seen, rig


def test_it_is_a_head_with_angles_from_its_zero():
    seen, rig = head()
    check_head(seen)
    assert seen.serial == "twin-head-1002"
    record = seen.apply(np.array([0.4, 0.0]), 4.0, 0.4)
    assert record.y.shape == (2, 10)
    assert record.timing.ended - record.timing.began == pytest.approx(4.0)
    true = np.degrees(rig.stance()[:2]) + 30.0
    assert record.y[:, -1] == pytest.approx(true, abs=0.8)
    assert record.y[0, -1] > 5.0
    assert seen.why == ""
    assert 0.0 <= seen.age <= 0.04


def test_angles_are_counted_from_where_the_cold_wires_are():
    seen, _ = head(cold=(0.4, 0.3))
    assert seen.exchange(np.zeros(2)) == pytest.approx([0.4, 0.3], abs=0.05)


def test_a_sweep_turns_one_axis_after_the_other_and_takes_a_picture_of_each_current():
    held = []
    frames = sweep(lambda u, seconds: held.append((*u, seconds)), lambda: len(held), highest=0.2)
    pan, tilt, seconds = np.array(held).T
    assert frames == list(range(len(held) + 1))
    assert 0.18 < pan.max() == tilt.max() <= 0.2
    assert not (pan * tilt).any()
    assert pan[-1] == tilt[-1] == 0.0
    assert (seconds > 0).all()


def test_a_stopped_run_finds_its_zero_again_and_goes_on(tmp_path):
    plan = Plan([0.0, 0.28, 0.32], 3.0, sample_interval=0.4, input="pan current [A]")
    setup = Setup(address="twin:pipe", input="pan current [A]", output="pan [deg]")

    class Stopped(Exception):
        pass

    def measured(name, stop_after=None):
        count = []

        def watch(progress):
            count.extend([progress.point] * (progress.point is not None))
            if len(count) == stop_after:
                raise Stopped

        path = tmp_path / name
        opened = Store.open(path, write=True) if path.exists() else Store.create(path, plan, setup)
        with opened as store:
            mode = run(single_channel(head()[0], "pan current"), plan, store, watch=watch)
            return mode, [point.value for point in store.points()]

    with pytest.raises(Stopped):
        measured("stopped", stop_after=2)
    mode, resumed = measured("stopped")
    assert mode == "replayed"
    assert resumed == pytest.approx(measured("whole")[1], abs=0.5)


def test_a_camera_that_shows_nothing_stops_the_run_and_says_why(monkeypatch):
    monkeypatch.setattr(seen_angles, "_PATIENCE", 3)
    seen, _ = head()

    def broken():
        raise InstrumentError("camera:0 gave no picture")

    seen._picture = broken
    assert np.isnan(seen.exchange(np.zeros(2))).all()
    assert seen.why == "camera:0 gave no picture"
    with pytest.raises(InstrumentError, match="does not show the angles: camera:0 gave no"):
        seen.apply(np.zeros(2), 0.4, 0.4)


class Slow(Clock):
    """Two wires and a camera on one clock; a picture takes three quarters of a tick."""

    tick, inputs, outputs = 0.04, tuple(Channel(f"{n}", "A", 0.0, 0.4) for n in ("pan", "tilt")), ()

    def __init__(self):
        super().__init__()
        self.applied = []

    def at_once(self, u):
        self.applied.append((self.time, *u))
        return np.zeros(0)

    exchange = at_once

    def picture(self):
        self.time += 0.03
        return Frame(self.time, np.zeros((4, 4), np.uint8))

    def safe(self):
        pass


class Angles:
    """Angles that are known at once."""

    known, why, searched = True, "", True

    def __init__(self, view, cold):
        self.asked = []

    def read(self, frame, *, cold=False):
        self.asked.append(cold)
        return np.array([1.0, 2.0])


def test_pictures_that_take_time_do_not_make_a_hold_longer_than_its_record_says(monkeypatch):
    monkeypatch.setattr(seen_angles, "SeenAngles", Angles)
    devices = Slow()
    view = HeadCalibration(lens=Pinhole(4, 4, 4.0, (1.5, 1.5)), leds=np.zeros((1, 3)))
    head = SeenHead(devices, devices.picture, view, clock=devices)
    began = devices.time
    record = head.apply(np.array([0.2, 0.0]), 8.0, 0.4)
    assert devices.time - began == pytest.approx(8.0, abs=0.1)
    assert record.timing.ended - record.timing.began == pytest.approx(devices.time - began)
    assert np.diff(record.t) == pytest.approx([0.4] * 19, abs=0.05)


def test_a_picture_that_takes_longer_than_a_tick_delays_the_head_by_whole_ticks(monkeypatch):
    monkeypatch.setattr(seen_angles, "SeenAngles", Angles)
    devices = Slow()
    devices.tick = 0.025
    view = HeadCalibration(lens=Pinhole(4, 4, 4.0, (1.5, 1.5)), leds=np.zeros((1, 3)))
    head = SeenHead(devices, devices.picture, view, clock=devices)
    times = []
    for _ in range(4):
        head.exchange(np.zeros(2))
        times.append(head.time)
    assert np.diff(times).tolist() == pytest.approx([0.05, 0.05, 0.05])


@pytest.mark.parametrize(
    ("lens", "error", "sentence"),
    [
        (Pinhole(), ParameterError, "gives pictures of 4 by 4 pixels .* with 640 by 480"),
        (Pinhole(4, 4, 4.0, (1.5, 1.5)), InstrumentError, "does not show the angles: .* black"),
    ],
)
def test_a_camera_that_cannot_show_the_angles_is_refused_at_the_start(lens, error, sentence):
    devices, view = Slow(), HeadCalibration(lens=lens, leds=np.zeros((1, 3)))
    waited = []
    with pytest.raises(error, match=sentence):
        SeenHead(devices, devices.picture, view, clock=devices, waits=lambda: waited.append(True))
    assert (len(devices.applied) == 1, len(waited)) == (not waited, error is InstrumentError)
    assert devices.time < 15.0
    assert not np.array(devices.applied)[:, 1:].any()


def test_the_zero_is_looked_for_only_without_current():
    _, view = open_tip("twin:pipe", specimen=1002, seed=3, scale=0.25)
    angles = seen_angles.SeenAngles(view)
    still = Frame(0.0, np.zeros((1, 1), np.uint8))
    assert np.isnan(angles.read(still)).all()
    assert seen_angles.unseen(angles.why).endswith("cold head, and it is heated")
    assert np.isnan(angles.read(still, cold=True)).all()
    assert "it has to stand still first" in seen_angles.unseen(angles.why)


def test_a_sweep_whose_pictures_show_nothing_for_10_s_stops_with_the_wires_off(monkeypatch):
    began, safe = [], []
    seen, rig = head(lambda frame: Frame(frame.t, frame.image * (not began)))
    began.append(seen._t)
    monkeypatch.setattr(rig, "safe", lambda: safe.append(seen._t))
    with pytest.raises(InstrumentError, match="does not show the angles: the picture is black"):
        seen.survey()
    assert 10.0 < safe[0] - began[0] < 12.0


def test_a_head_is_left_safe_if_the_wait_for_its_zero_ends_early(monkeypatch):
    safe = []
    monkeypatch.setattr(RigWires, "safe", lambda self: safe.append(True), raising=True)

    def stopped(frame):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        head(stopped)
    assert safe == [True]
