"""
A first fit
===========

A model is as good as its error on rows that it has not seen. Hold out the last fifth of the
record, and read that line of the table first: the error on fitted rows says little.
"""

import numpy as np

import minorloop as ml

strip = ml.connect("twin:ipmc", specimen=1, noise=0.05)  # a simulated strip of ionic polymer
levels = np.linspace(-1.2, 1.2, 11)
stairs = ml.excitation.decaying_staircase(levels)
voltages = np.r_[stairs, np.random.default_rng(0).uniform(-1.2, 1.2, 20)]
curvatures = [strip.apply(u, 200.0, 200.0).y[-1] for u in voltages]
record = ml.Record(voltages, curvatures, inputs="voltage [V]", outputs="curvature [1/m]")

fit = ml.identify(record, ml.Plane(levels, diagonal="reversible"), holdout=20 / voltages.size)
print(fit)

# %%
# One call draws the figure for a talk. A figure shows itself in a notebook, without a magic line.

fit.plot(part="talk")
