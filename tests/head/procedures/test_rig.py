from types import SimpleNamespace

import numpy as np
import pytest

from minorloop.head.procedures.calibration import STRAIGHT
from minorloop.head.procedures.centre import CentreState
from minorloop.head.procedures.go import Go
from minorloop.head.procedures.rig import InspectionRig
from minorloop.head.procedures.values import Request

from .fakes import CALIBRATION


class Plant:
    """An ampere is 100 degrees; the catheter is ideal; ``lost`` channels give NaN."""

    tick = 0.04

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
        wire = SimpleNamespace(wire=SimpleNamespace(angle=12.0))
        return SimpleNamespace(axes=[SimpleNamespace(estimate=wire)] * 2)

    def step(self, state, reference, measurement):
        self.read.append(measurement)
        return reference / 100, state

    coupling = np.eye(2)


def rig(**options):
    return InspectionRig(Plant(), Tip(), Control(), CALIBRATION, **options)


def test_a_procedure_is_driven_to_its_end():
    it, go, ticks = rig(), Go(), []
    state = it.run(go, go.begin(place=(5e-3, 0.5), angles=(0.1, -0.2)), ticks.append)
    assert state.reached
    assert it.angles == pytest.approx([0.1, -0.2])
    assert it.place == pytest.approx([5e-3, 0.5], abs=6e-3)
    assert np.abs(np.array(it.plant.inputs)[:, 2]).max() <= 8e-3 + 1e-12
    assert it.t == pytest.approx(0.04 * len(ticks))
    assert len(it.plant.inputs) == len(ticks)


def test_frames_and_shots_are_taken_only_on_request():
    it = rig()
    plain, full = it.reading(), it.reading(Request(frame=True, shots=3, focus=0.01))
    assert (plain.image, plain.shots, plain.fired) == (None, (), False)
    assert full.image is not None
    assert (len(full.shots), full.fired) == (3, True)
    assert ("focus_at", 0.01) in it.tip.told


def test_a_lost_reading_keeps_its_value_and_control_gets_nan():
    it, go = rig(), Go()
    it.run(go, go.begin(angles=(0.1, 0.1)))
    it.plant.lost = [0, 3]
    it.run(Go(turning=0.2), go.begin(angles=(0.3, 0.3)))
    assert it.angles == pytest.approx([0.1, 0.3])
    assert np.isnan(it.control.read[-1][0])
    assert not np.isnan(it.control.read[-1][1])


def test_without_sensors_control_gets_the_angles_from_the_image():
    it = rig(sensors=False)
    assert it.angles == pytest.approx(np.radians([12.0, 12.0]) - STRAIGHT)

    class Sighting:
        def step(self, state, reading):
            done = reading.t > 0.05
            sighted = np.zeros(2) if reading.t > 0 else None
            return CentreState(place=np.zeros(2), done=done), Request(sighted=sighted)

    it.run(Sighting(), CentreState(place=np.zeros(2)))
    assert np.isnan(it.control.read[0]).all()
    assert it.control.read[1] == pytest.approx([30.0, 30.0])


def test_a_gyroscope_is_added_to_the_joints():
    it = rig(gyroscope=lambda: np.array([0.01, 0.0]))
    reading = it.reading()
    assert reading.line_of_sight - reading.angles == pytest.approx([0.01, 0.0])


def test_the_log_has_times_and_actions():
    it = rig()
    it.run(Go(), Go().begin(angles=(-STRAIGHT, -STRAIGHT)))
    it.say("turn", "done")
    (step,) = it.log
    assert (step.what, step.outcome, step.t) == ("turn", "done", it.t)
