import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from types import SimpleNamespace

import numpy as np
import pytest

from console_rig import control
from minorloop import InstrumentError, ModelFileError, SafetyError
from minorloop.lab.drivers.bench import Bench
from minorloop_head.control.head import HeadState
from minorloop_head.geometry import wall_point
from minorloop_head.procedures import rig as module
from minorloop_head.procedures.actuator_plant import ActuatorPlant, BenchTip, CameraTip
from minorloop_head.procedures.calibration import STRAIGHT
from minorloop_head.procedures.centre import Centred, Centring
from minorloop_head.procedures.focus import focus
from minorloop_head.procedures.go import go
from minorloop_head.procedures.head_file import HeadFile, save_head
from minorloop_head.procedures.meter import acquisition, meter
from minorloop_head.procedures.rig import InspectionRig, rig_at
from minorloop_head.procedures.values import Request
from minorloop_head.sources import Frame
from minorloop_head.twins.head import Head
from minorloop_head.vision.defects import SEQUENCE
from simulated_plant import Clock

from .fakes import ANGLES, CALIBRATION, CURRENTS, camera


class Plant:
    """An ampere is 100 degrees; the catheter is ideal; ``lost`` channels give NaN."""

    tick, time = 0.04, None

    def __init__(self):
        self.inputs, self.lost, self.place = [], [], np.zeros(2)

    def exchange(self, u):
        self.inputs.append(u)
        self.place += 0.04 * u[2:]
        y = np.array([*np.radians(100 * u[:2]), *self.place])
        y[self.lost] = np.nan
        return y

    def stance(self):
        return (0.0,) * 6


class Tip:
    newest = None  # its pictures are there at once

    def __init__(self):
        self.told = []

    def __getattr__(self, name):
        return lambda *values: self.told.append((name, *values))

    def frame(self):
        return SimpleNamespace(image=np.zeros((2, 2), np.uint8))

    def shots(self, count):
        return [None] * count


class Control:
    """Control that reaches an angle at once, and records its readings."""

    def __init__(self):
        self.read = []

    def begin(self):
        wire = SimpleNamespace(angle=12.0)
        return SimpleNamespace(axes=[SimpleNamespace(estimate=wire)] * 2)

    def step(self, state, reference, measurement, *, t=None):
        self.read.append(measurement)
        return reference / 100, state

    def modelled(self, state):
        return np.array([axis.estimate.angle for axis in state.axes])


def rig(**options):
    return InspectionRig(Plant(), Tip(), Control(), CALIBRATION, **options)


def test_a_lost_reading_keeps_its_value_and_control_gets_nan():
    it = rig()
    it.run(go(angles=(0.1, 0.1)))
    it.plant.lost = [0, 3]
    it.run(go(angles=(0.3, 0.3), turning=0.2))
    assert it.angles == pytest.approx([0.1, 0.3])
    assert np.isnan(it.control.read[-1][0])
    assert not np.isnan(it.control.read[-1][1])


def test_without_sensors_control_gets_the_angles_from_the_image():
    it = rig(sensors=False)
    assert it.angles == pytest.approx(np.radians([12.0, 12.0]) - STRAIGHT)

    def sighting():
        yield Request()
        yield Request(sighted=np.zeros(2))

    it.run(sighting())
    assert np.isnan(it.control.read[0]).all()
    assert it.control.read[1] == pytest.approx([30.0, 30.0])


class Base:
    """A turn of the base that pictures of bursts show."""

    def __init__(self):
        self.begun, self.seen, self.times = [], [], []

    def read(self, t, angles, place):
        self.times.append(t)

    def begin(self, image, t):
        self.begun.append(t)

    def see(self, image, t):
        self.seen.append(t)

    def at(self, t):
        return np.array([0.01, 0.0]) if t in self.seen else np.full(2, np.nan)


def test_the_turn_of_the_base_is_counted_from_the_picture_before_the_water_comes():
    base = Base()
    it = rig(base=base)
    assert it.reading(Request(frame=True, shots=1)).base == pytest.approx([0.0, 0.0])
    it.reading(Request(water=True))
    it.reading(Request(water=True))
    assert base.begun == [0.0]
    assert np.isnan(it.reading().base).all()
    assert it.reading(Request(frame=True, shots=1)).base == pytest.approx([0.01, 0.0])
    it.reading(Request(water=False))
    assert it.reading().base == pytest.approx([0.0, 0.0])


class Devices(Clock):
    """Wires of 200 degrees an ampere, lines, a clock that they move, and a camera on them."""

    names = ("led 1", "led 2", "led 3")
    exposes = True

    def __init__(self, seen=None):
        super().__init__()
        self.angles, self.lights = np.full(2, 30.0), []
        self.seen = seen or camera()

    def set(self, values):
        self.angles = 200.0 * values

    def read(self):
        return self.angles

    def safe(self):
        self.angles = np.zeros(2)

    def fail(self, *_):
        raise InstrumentError("the board gave no answer")

    def switch(self, values):
        self.lights.append(tuple(values.values()))

    def expose(self, exposure, gain):
        """Do nothing: other tests use the same camera."""

    def frame(self):
        self.seen.switch(self.lights[-1] if self.lights else (True,) * 3)
        self.seen.look(*(np.radians(self.angles) - STRAIGHT))
        return Frame(time.monotonic(), self.seen.frame().image)


@dataclass(frozen=True)
class Axis:
    """The state of a wire as far as a rig knows it."""

    applied: float = 0.3
    fault: str = ""


class Weak(Control):
    def reach(self, wanted):
        return np.array([[0.0, 60.0], [0.0, 60.0]])

    def begin(self):
        return HeadState((Axis(), Axis()))

    def step(self, state, reference, measurement, *, t=None):
        return np.clip(reference / 200.0, 0.0, 0.4), state


def bench_of(devices, reading=None, angles=ANGLES, **options):
    """A bench of wires, with lines if the devices have some, on the clock of the devices."""
    options = {"tick": 0.04, "clock": devices, **options}
    if hasattr(devices, "switch"):
        options["lines"] = devices
    return Bench(devices, reading or devices, CURRENTS, angles, **options)


def on_bench(devices, plant=None, **options):
    """A rig on devices, whose camera tells when the lights were switched."""
    plant = plant or ActuatorPlant(bench_of(devices), devices)
    tip = CameraTip(BenchTip(plant), devices, replace(CALIBRATION, latency=0.0))
    return InspectionRig(plant, tip, Weak(), CALIBRATION, **options)


def test_procedures_run_on_a_bench_with_a_camera():
    devices, view = Devices(), CALIBRATION
    it = on_bench(devices)
    place = np.array([0.5, 20e-3])
    aim = view.camera_at((0.0, 0.0)).mount.aim(wall_point(*place, view.radius))
    assert it.run(go(angles=np.array(aim) + 0.015))
    it.run(meter(view, it.light, 0.3))
    centring = Centring(calibration=view, gain=1.8, patience=4.0, still=0.08)
    centred = it.run(centring.centre(Centred(place=place)))
    assert (centred.verdict, centred.error < centring.in_middle) == ("tracked", True)
    assert it.angles == pytest.approx(aim, abs=0.01)
    assert it.run(focus(view.lens, (319.5, 239.5), 20e-3)).distance > 0
    frames = it.run(acquisition(it.light.gain))
    assert [frame.lights for frame in frames] == list(SEQUENCE)
    assert devices.lights == list(SEQUENCE)
    assert devices.time == pytest.approx(it.t, abs=0.05)  # each tick took its time, on their clock


class Loaded(Clock):
    """Two wires that turn as time passes, on a machine that is late in three ticks of four."""

    def __init__(self):
        super().__init__()
        self.head, self._ticks = Head(noise=0.05, delay=0.04), 0
        self._seen = np.zeros(2)

    def set(self, values):
        while self.head.clock < self.time - 1e-9:
            self._seen = self.head.exchange(self._u)
        self._u = values

    def read(self):
        self._ticks += 1
        self.time += 0.3 * (self._ticks % 4 > 0)
        return self._seen

    def safe(self):
        self._u = np.zeros(2)


def test_on_a_loaded_machine_the_wires_are_where_control_expects_them():
    """Where each tick counted as 0.04 s, readings contradicted the model until a wire cooled."""
    devices = Loaded()
    plant = ActuatorPlant(bench_of(devices), devices)
    it, faults = InspectionRig(plant, Tip(), control(), CALIBRATION), set()
    for turn in ((0.3, 0.2), (-0.3, 0.1), (0.1, -0.35)):
        it.run(
            go(angles=turn, turning=6.0),
            lambda: faults.update(axis.fault for axis in it._state.axes),
        )
    assert faults == {""}
    assert it.angles == pytest.approx(turn, abs=0.06)
    assert plant.time == pytest.approx(devices.time, abs=0.4)
    assert plant.time > 5 * it.t


def test_after_an_answer_that_did_not_come_the_loop_goes_on_from_a_head_that_is_safe(monkeypatch):
    devices, told = Devices(), []
    it = on_bench(devices, told=told.append)
    it.reading(Request(lights=(True, False, False)))
    with monkeypatch.context() as patch:
        patch.setattr(devices, "set", devices.fail)
        it._tick(Request(angles=np.zeros(2)))
    assert [axis.applied for axis in it._state.axes] == [0.0, 0.0]
    assert not devices.angles.any()
    assert devices.lights == [(True, False, False)] * 2  # a head that was made safe may be dark
    assert "the board gave no answer; the head was made safe" in told[0].outcome
    it._tick(Request())
    assert devices.angles.all()
    monkeypatch.setattr(devices, "set", devices.fail)
    for _ in range(5):
        it._tick(Request())
    assert len(told) == 6
    with pytest.raises(InstrumentError, match="no answer"):
        it._tick(Request())


def test_a_head_that_is_not_safe_ends_the_loop_at_once(monkeypatch):
    devices, told = Devices(), []
    it = on_bench(devices, told=told.append)
    for name in ("set", "safe"):
        monkeypatch.setattr(devices, name, devices.fail)
    with pytest.raises(SafetyError, match="may still be on"):
        it._tick(Request())
    assert not told


def test_the_wires_are_controlled_while_pictures_are_late_and_while_it_computes(monkeypatch):
    devices = Devices()
    with ThreadPoolExecutor(1) as pool:
        it, ticked = on_bench(devices, computing=pool), threading.Event()
        tick = it._tick
        monkeypatch.setattr(it, "_tick", lambda request: (tick(request), ticked.set()))
        assert it.compute(lambda: ticked.wait(10.0))
    late = iter([True] * 50)
    frame = devices.frame
    monkeypatch.setattr(devices, "frame", lambda: devices.fail() if next(late, 0) else frame())
    before = it.t
    _, image = it.look()
    assert image is not None
    assert it.t - before == pytest.approx(50 * 0.04)
    monkeypatch.setattr(devices, "frame", devices.fail)
    before = it.t
    with pytest.raises(InstrumentError, match="no answer"):
        it.look()
    assert it.t - before == pytest.approx(5.0)


@pytest.fixture
def head_file(monkeypatch, tmp_path):
    """Devices behind an address, how often they were closed, and the file of their head."""
    devices, closed = Devices(), []
    monkeypatch.setattr(devices, "close", lambda: closed.append(True), raising=False)
    bench = bench_of(devices, serial="H-01")
    monkeypatch.setattr(module, "connect", lambda address: bench)
    monkeypatch.setattr(module, "WallClock", lambda: devices)
    monkeypatch.setattr(module, "LiveCamera", lambda address, patience: devices)
    monkeypatch.setattr(HeadFile, "control", lambda known, **options: Weak())
    file, on = tmp_path / "head.json", datetime(2026, 1, 31, tzinfo=UTC)
    save_head(HeadFile(serial="H-01", calibration=CALIBRATION, calibrated=on), file)
    return devices, closed, file


def test_a_rig_at_addresses_moves_a_head_and_leaves_it_safe(head_file, monkeypatch):
    (devices, closed, file), on = head_file, datetime(2026, 1, 31, tzinfo=UTC)
    with rig_at("bench:head.toml", "camera:0", file) as it:
        assert it.run(go(angles=(0.1, 0.0)))
        with pytest.raises(InstrumentError, match="no ultrasonic probe"):
            it.reading(Request(shots=1))
        assert devices.angles.any()
    assert not devices.angles.any()
    assert closed == [True]
    dark = replace(CALIBRATION, leds=np.zeros((1, 3)))
    for serial, known, said in (
        ("H-02", {"calibration": CALIBRATION, "calibrated": on}, "'H-02', and the head here is"),
        ("H-01", {}, "has no calibration of the camera"),
        ("H-01", {"calibration": dark, "calibrated": on}, "has 1 LED, and acquisitions switch 3"),
    ):
        save_head(HeadFile(serial=serial, **known), file, force=True)
        with pytest.raises(ModelFileError, match=said):
            rig_at("bench:head.toml", "camera:0", file).__enter__()


def test_one_late_answer_does_not_end_the_start(head_file, monkeypatch):
    (devices, _, file), bench = head_file, module.connect("bench:head.toml")
    told, fails = [], {"open": 1, "switch": 1}
    switch = devices.switch

    def once(name, work):
        fails[name] -= 1
        return devices.fail() if fails[name] >= 0 else work()

    monkeypatch.setattr(module, "connect", lambda address: once("open", lambda: bench))
    monkeypatch.setattr(devices, "switch", lambda values: once("switch", lambda: switch(values)))
    with rig_at("bench:head.toml", "camera:0", file, told.append):
        assert devices.lights == [(True, True, True)]
    opened, switched = (entry.outcome for entry in told)
    assert opened == "the board gave no answer; it is opened once more"
    assert "the head was made safe, and it is tried again" in switched
    fails["open"] = 2
    with pytest.raises(InstrumentError, match="no answer"):
        rig_at("bench:head.toml", "camera:0", file).__enter__()


class SeenWires:
    """Angles of the wires of `Devices`, known after three pictures of the cold head."""

    why = "too dark"

    def __init__(self, devices):
        self.devices, self.cold, self.lights = devices, [], []

    @property
    def known(self):
        return len(self.cold) > 3

    def read(self, frame, *, cold=False):
        self.cold.append(cold)
        self.lights.append(self.devices.lights[-1] if self.devices.lights else (True,) * 3)
        return self.devices.angles.copy() if self.known else np.full(2, np.nan)


def test_a_head_without_sensors_goes_by_the_pictures_under_all_lights(monkeypatch):
    devices, nothing = Devices(), SimpleNamespace(read=lambda: np.zeros(0))
    plant = ActuatorPlant(bench_of(devices, nothing, []), devices)
    assert not plant.sensors
    assert np.isnan(plant.exchange(np.zeros(4))[:2]).all()
    seen = SeenWires(devices)
    it = on_bench(devices, plant, seen=seen)
    it.begin()
    assert seen.cold == [True] * 4
    assert not devices.angles.any()
    assert it.run(go(angles=(0.1, -0.05)))
    assert it.angles == pytest.approx([0.1, -0.05], abs=0.01)
    frames = it.run(acquisition(1.0))
    assert [frame.lights for frame in frames] == list(SEQUENCE)
    assert set(seen.lights) == {(True,) * 3}
    it._state = HeadState((Axis(), Axis(fault="lost")))
    with pytest.raises(InstrumentError, match="the camera does not show the angles: too dark"):
        it.check_sensors()
