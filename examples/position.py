"""Bring an actuator to target outputs without a sensor."""

import numpy as np

import minorloop as ml

levels = np.linspace(-1.2, 1.2, 11)
strip = ml.connect("twin:ipmc", specimen=0)
voltages = ml.excitation.decaying_staircase(levels)
curvatures = [strip.apply(float(u), 200.0, 1.0).y[-1] for u in voltages]
found = ml.identify(voltages, curvatures, ml.Plane(levels, diagonal="reversible"))

targets = [2.0, -3.5, 5.0, 0.0]
wanted = found.model.invert(targets)
print(wanted)

strip.apply(-1.2, 400.0, 1.0)  # saturate: the memory that the inverse begins at
for target, voltage in zip(targets, wanted.u, strict=True):
    reached = strip.apply(float(voltage), 200.0, 1.0).y[-1]
    print(f"wanted {target:5.2f} 1/m, reached {reached:5.2f} 1/m")
strip.safe()
