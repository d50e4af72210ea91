"""Values of the head that cannot be, and what is said of each: a row for each bound."""

import math
from functools import partial

import numpy as np
import pytest

from minorloop.errors import ParameterError
from minorloop_head.control.controller import Loop
from minorloop_head.control.limits import WireLimits
from minorloop_head.control.readings import SensorWatch
from minorloop_head.geometry import Mount, Pinhole, Probe
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.identify import HeadExcitation
from minorloop_head.twins.pipe import Bore, Crack, Pipe
from minorloop_head.twins.sensor import SimulatedFault
from minorloop_head.twins.surroundings import Cooling, Course, Filling, Surroundings, Sway
from minorloop_head.twins.wire import Wire
from minorloop_head.ultrasound.field import CalibratedProbe, sound_speed
from minorloop_head.vision.targets import Target

nan = math.nan
Calibration = partial(HeadCalibration, lens=Pinhole(), leds=np.zeros((3, 3)))
Fault = partial(SimulatedFault, "pan")
InPipe = partial(CalibratedProbe, Probe(), Mount())


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Loop(interval=0.0), "interval is 0.0 s"),
        (lambda: Loop(highest=0.5), "highest is 0.5 A; give 1e-06 to 0.4 A"),
        (lambda: WireLimits(hottest=200.0), "hottest"),
        (lambda: SensorWatch(noise=-1.0), "noise"),
        (lambda: SensorWatch(low=10.0, high=10.0), "low"),
        (lambda: HeadExcitation(highest=0.5), "highest"),
        (lambda: Calibration(latency=60.0), "latency is .*; give 0 to 5 s"),
        (lambda: Calibration(leds=np.array([[0.0, 2.5, 0.0]])), "is 2.5 m from .* within 0.05 m"),
        (lambda: Calibration(radius=10.0), "radius is 10 m; give 0.0001 to 1 m"),
        (lambda: Calibration(lens=Pinhole(centre=(5e3, 5e3))), "principal point .* 640 by 480"),
        (lambda: Pinhole(width=0), "width|pixels|image"),
        (lambda: Pinhole(k1=-3.0), "distort|k1"),
        (lambda: Pinhole(p1=2.0), "distortion .* p1 2, p2 0 folds the image"),
        (lambda: Bore(0, 0, -1e-3), "diameter of a bore is -0.001"),
        (lambda: Bore(0, 0, 1e-3, inside="green"), "give one of 'dark'"),
        (lambda: Crack(((0.0, 0.0),), (1e-4,)), "1 corners and 1 widths"),
        (lambda: Crack(((0.0, 0.0), (0.1, 0.0)), (1e-4, 0.0)), "width of a crack is 0.0"),
        (lambda: Pipe(water=10e-3), "water"),
        (lambda: Sway(0.5), "a sway of"),
        (lambda: Fault("gone", 0.0), "kind is 'gone'; give one of 'stuck'"),
        (lambda: Fault("lost", 3.0, until=3.0), "give at < until"),
        (lambda: Course(1.0, period=0.0), "period is 0.0"),
        (lambda: Surroundings(ambient=200.0), r"ambient is 200 .* must stay in \[-50, 100\]"),
        (lambda: Surroundings(convection=Course(75.0, amplitude=80.0)), "convection is -5 to 155"),
        (lambda: Surroundings(load=(0.0, Course(0.0, -0.02))), "load is -0.02 to 0 N m"),
        (lambda: Cooling(exponent=0.5), r"exponent is 0.5; it must stay in \[0, 0.4\]"),
        (lambda: Filling(temperature=120.0), r"temperature of the filling is 120 .* \[0, 95\]"),
        (lambda: Filling(sleeve=3.0), r"convection of the sleeve is 3; .* \[0.5, 2\]"),
        (lambda: Wire(ageing=-0.1), "ageing is -0.1; give 0 to 1"),
        (lambda: Wire(surroundings=Surroundings(load=(0.0, 0.0))), "2 loads; give one, or 1"),
        (lambda: InPipe(thickness=-1.0), "thickness is -1.0; give a positive number"),
        (lambda: sound_speed(96.0), "temperature"),
        (lambda: Target("disc"), "give charuco, chessboard, circles, asymmetric-circles"),
        (lambda: Target("charuco", 9, 7, nan), "give the side of one, 0.1 to 1000 mm"),
    ],
)  # fmt: skip
def test_a_value_that_cannot_be_is_refused(make, said):
    with pytest.raises(ParameterError, match=said):
        make()
