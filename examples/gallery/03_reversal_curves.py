"""
Reversal curves
===============

First-order reversal curves determine the plane. Number them in the record: each then starts from
saturation, so that the descents between them need not be measured. The error on left-out curves
tells what to expect of the next one.
"""

import matplotlib.pyplot as plt
import numpy as np

import minorloop as ml

fibre = ml.connect("twin:fibre")  # a simulated fibre of polyaniline
levels = np.linspace(0.20, 0.65, 16)
u, y, number = [], [], []
for curve, reversal in enumerate(levels[-2::-1]):
    fibre.apply(0.65, 300.0, 300.0)  # saturate; not part of the record
    for voltage in (reversal, *levels[levels > reversal]):
        u.append(voltage)
        y.append(fibre.apply(voltage, 300.0, 300.0).y[-1])
        number.append(curve)

record = ml.Record(u, y, curves=number, start_of_curve="positive")
fit = ml.identify(record, ml.Plane(levels, lag=0))
print(f"error {fit.nrmse:.2%} of range, on left-out curves {fit.groups_nrmse:.2%}")

figure, axes = plt.subplots(figsize=(6, 3.8), layout="constrained")
for curve in range(len(levels) - 1):
    rows = np.array(number) == curve
    axes.plot(fit.u[rows], fit.prediction[rows], color="C0", lw=1)
    axes.plot(fit.u[rows], fit.y[rows], ".", color="C1", ms=4)
axes.set(xlabel="voltage [V]", ylabel="length [um]", title="Reversal curves: measured and model")
