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
from minorloop_head.twins.pipe import Bore, Crack, Dent, Dirt, Pipe, Scratch
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
        (lambda: Loop(highest=nan), "highest is nan"),
        (lambda: Loop(delay=-1), "delay is -1"),
        (lambda: WireLimits(hottest=200.0), "hottest"),
        (lambda: WireLimits(ambient=160.0), "ambient"),
        (lambda: WireLimits(rise=0.0), "rise"),
        (lambda: WireLimits(margin=0.5), "margin"),
        (lambda: SensorWatch(noise=-1.0), "noise"),
        (lambda: SensorWatch(repeats=1), "repeats"),
        (lambda: SensorWatch(patience=0), "patience"),
        (lambda: SensorWatch(recovery=0), "recovery"),
        (lambda: SensorWatch(jump=0.0), "jump"),
        (lambda: SensorWatch(low=10.0, high=10.0), "low"),
        (lambda: HeadExcitation(highest=0.5), "highest"),
        (lambda: HeadExcitation(bands=1), "bands"),
        (lambda: HeadExcitation(hold=nan), "hold"),
        (lambda: Calibration(latency=60.0), "latency is .*; give 0 to 5 s"),
        (lambda: Calibration(leds=np.array([[0.0, 2.5, 0.0]])), "is 2.5 m from .* within 0.05 m"),
        (lambda: Calibration(radius=10.0), "radius is 10 m; give 0.0001 to 1 m"),
        (lambda: Calibration(lever=nan), "lever is nan m; give 0 to 1 m"),
        (lambda: Calibration(length=0.0), "length is 0 m; give more than 0"),
        (lambda: Calibration(lens=Pinhole(centre=(5e3, 5e3))), "principal point .* 640 by 480"),
        (lambda: Pinhole(width=0), "width|pixels|image"),
        (lambda: Pinhole(focal=-1.0), "focal"),
        (lambda: Pinhole(k1=-3.0), "distort|k1"),
        (lambda: Pinhole(p1=2.0), "distortion .* p1 2, p2 0 folds the image"),
        (lambda: Pinhole(aspect=0.0), "focal lengths"),
        (lambda: Mount(lever=nan), "lever"),
        (lambda: Bore(0, 0, -1e-3), "diameter of a bore is -0.001"),
        (lambda: Bore(0, 0, 1e-3, depth=0.0), "depth of a bore is 0.0"),
        (lambda: Bore(0, 0, 1e-3, inside="green"), "give one of 'dark'"),
        (lambda: Bore(0, 0, 1e-3, chamfer=-1e-4), "chamfer of a bore"),
        (lambda: Crack(((0.0, 0.0),), (1e-4,)), "1 corners and 1 widths"),
        (lambda: Crack(((0.0, 0.0), (0.1, 0.0)), (1e-4, 0.0)), "width of a crack is 0.0"),
        (lambda: Dent(0, 0, 0.0, 1e-4), "size of a dent is 0.0"),
        (lambda: Scratch(0, 0, 0, 1e-3, 0.0), "width of a scratch"),
        (lambda: Dirt(0, 0, 1e-3, 0.5, softness=0.0), "softness of dirt"),
        (lambda: Pipe(radius=0.0), "radius"),
        (lambda: Pipe(water=10e-3), "water"),
        (lambda: Sway(0.5), "a sway of"),
        (lambda: Fault("gone", 0.0), "kind is 'gone'; give one of 'stuck'"),
        (lambda: Fault("lost", nan), "at is nan"),
        (lambda: Fault("lost", 3.0, until=3.0), "give at < until"),
        (lambda: Fault("lost", 1.0, until="b"), "until is 'b'"),
        (lambda: Course(nan), "start is nan"),
        (lambda: Course(1.0, end=math.inf), "end is inf"),
        (lambda: Course(1.0, duration=-1.0), "duration is -1.0"),
        (lambda: Course(1.0, period=0.0), "period is 0.0"),
        (lambda: Course(1.0, amplitude="much"), "amplitude is 'much'"),
        (lambda: Surroundings(ambient=200.0), r"ambient is 200 .* must stay in \[-50, 100\]"),
        (lambda: Surroundings(convection=0.0), "convection is 0 W"),
        (lambda: Surroundings(convection=Course(75.0, amplitude=80.0)), "convection is -5 to 155"),
        (lambda: Surroundings(load=(0.0, Course(0.0, -0.02))), "load is -0.02 to 0 N m"),
        (lambda: Cooling(exponent=0.5), r"exponent is 0.5; it must stay in \[0, 0.4\]"),
        (lambda: Cooling(share=-0.1), "share is -0.1"),
        (lambda: Cooling(capacity=0.0), "capacity is 0 J/K"),
        (lambda: Cooling(conductance=nan), "conductance is nan"),
        (lambda: Filling(temperature=120.0), r"temperature of the filling is 120 .* \[0, 95\]"),
        (lambda: Filling(sleeve=3.0), r"convection of the sleeve is 3; .* \[0.5, 2\]"),
        (lambda: Filling(gas="flooded"), "gas"),
        (lambda: Filling(pressure=1.0), "pressure is 1.0 Pa"),
        (lambda: Filling(level=nan), "level of the water is nan"),
        (lambda: Wire(ageing=-0.1), "ageing is -0.1; give 0 to 1"),
        (lambda: Wire(drift=1.5), "drift is 1.5; give 0 to 1"),
        (lambda: Wire(surroundings=Surroundings(load=(0.0, 0.0))), "2 loads; give one, or 1"),
        (lambda: InPipe(thickness=-1.0), "thickness is -1.0; give a positive number"),
        (lambda: InPipe(radius=1e-3), "not inside a pipe"),
        (lambda: sound_speed(96.0), "temperature"),
        (lambda: Target("disc"), "give charuco, chessboard, circles, asymmetric-circles"),
        (lambda: Target("charuco", 2, 7), "2 by 7 squares; give 3 to 60"),
        (lambda: Target("charuco", 9, 7, nan), "give the side of one, 0.1 to 1000 mm"),
    ],
)  # fmt: skip
def test_a_value_that_cannot_be_is_refused(make, said):
    with pytest.raises(ParameterError, match=said):
        make()
