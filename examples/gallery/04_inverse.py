"""
The inverse
===========

The inverse of a model gives the inputs for wanted outputs, exactly and without iteration; what
remains is the error of the model. A curve without memory, fitted to the same record, is off by
the width of the loop.
"""

import matplotlib.pyplot as plt
import numpy as np

import minorloop as ml

strip = ml.connect("twin:ipmc", specimen=0)
levels = np.linspace(-1.2, 1.2, 11)
stairs = ml.excitation.decaying_staircase(levels)
curvatures = [strip.apply(u, 200.0, 200.0).y[-1] for u in stairs]
fit = ml.identify(stairs, curvatures, ml.Plane(levels, diagonal="reversible"))

targets = np.array([2.0, -3.5, 5.0, 0.0, -6.0, 3.0, 6.5, -1.0, -4.5, 1.5, 4.0, -2.5, -5.5, 0.5])
curve, inputs = np.polynomial.Polynomial.fit(curvatures, stairs, 5), fit.model.invert(targets).u
figure, axes = plt.subplots(figsize=(7.5, 3.6), layout="constrained")
for name, voltages in (("polynomial", curve(targets)), ("inverse of the model", inputs)):
    strip.reset()
    strip.apply(-1.2, 400.0, 400.0)  # saturate: the memory that the inverse begins at
    reached = np.array([strip.apply(u, 200.0, 200.0).y[-1] for u in np.clip(voltages, -1.2, 1.2)])
    error = np.sqrt(np.mean((reached - targets) ** 2))
    axes.plot(reached - targets, "o-", label=f"{name}: {error:.2f} 1/m rms")
axes.axhline(0.0, color="0.3", lw=0.8)
axes.set(xlabel="target number", ylabel="error [1/m]", title="14 targets without a sensor")
axes.legend(frameon=False)
