"""
Minor loops need minor loops
============================

One major loop, however finely sampled, moves few cells of the plane; a decaying staircase with as
many holds moves all. A model of the major loop fits it well, but guesses in the grey cells: measure
loops of the sizes that you will use.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import ListedColormap

import minorloop as ml

levels = np.linspace(-1.2, 1.2, 11)
major = ml.excitation.major_loop(np.linspace(-1.2, 1.2, 19))
stairs = ml.excitation.decaying_staircase(levels)

figure, axes = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
for axis, name, inputs in zip(axes, ("Major loop", "Staircase"), (major, stairs), strict=True):
    report = ml.excitation.report(inputs, levels)
    cells = np.ma.masked_where(~np.tril(np.ones((10, 10), dtype=bool)), report.excited)
    axis.pcolormesh(levels, levels, cells, cmap=ListedColormap(["0.85", "C0"]), vmin=0, vmax=1)
    share = f"{report.excited_fraction:.0%} of the cells excited"
    axis.set(title=f"{name}, {inputs.size} holds: {share}", aspect="equal")
    axis.set(xlabel="threshold down [V]", ylabel="threshold up [V]")
