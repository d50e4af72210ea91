"""A model straight from first-order reversal curves on a mesh."""

import numpy as np

import minorloop as ml
from minorloop.identification.reversal_curves import identify_reversal_curves

levels = np.linspace(0.20, 0.65, 10)
fibre = ml.connect("twin:fibre")
voltages = ml.excitation.reversal_curves(levels)
lengths = [fibre.apply(float(u), 300.0, 1.0).y[-1] for u in voltages]

direct = identify_reversal_curves(voltages, lengths, levels)
fitted = ml.identify(voltages, lengths, ml.Plane(levels), prior=ml.Smooth(0.0)).model
print(f"{np.count_nonzero(direct.weights < 0)} negative weights without constraints")
print(f"monotone: {direct.monotone} without constraints, {fitted.monotone} with them")
