"""
Creep
=====

A strip bends on for minutes after each step. A model of settled values misses targets that are
read after 10 s; a model with creep meets them, because it knows what earlier steps still do.
"""

import matplotlib.pyplot as plt
import numpy as np

import minorloop as ml

strip = ml.connect("twin:ipmc", noise=0.03)
stairs = ml.excitation.decaying_staircase(np.linspace(-1.2, 1.2, 11))
strip.apply(-1.2, 400.0, 400.0)
holds = [strip.apply(u, seconds, 2.0) for seconds in (200.0, 10.0) for u in stairs]
law = ml.Viscosity(10, creep="spectrum", rate=False)  # creep may be "auto"
creeping = ml.identify(ml.Record.joined(holds), law)
settled = ml.identify(stairs, [hold.y[-10:].mean() for hold in holds[: stairs.size]], ml.Plane(10))

targets = np.array([2.0, -1.0, 3.0, -4.0, 0.0, 5.0])
ends = 10.0 * np.arange(1, targets.size + 1)
figure, axes = plt.subplots(figsize=(8, 3.8), layout="constrained")
for name, inputs in (
    ("settled model", settled.model.invert(targets).u),
    ("with creep", creeping.invert(ends, targets).u),
):
    strip.reset()
    strip.apply(-1.2, 400.0, 400.0)
    path = np.concatenate([strip.apply(u, 10.0, 0.5).y for u in inputs])
    error = np.sqrt(np.mean((path[19::20] - targets) ** 2))
    axes.plot(0.5 * np.arange(1, path.size + 1), path, label=f"{name}: {error:.2f} 1/m rms")
axes.plot(ends, targets, "o", mfc="none", color="k", label="target, 10 s after each step")
axes.set(xlabel="time [s]", ylabel="curvature [1/m]")
axes.legend(frameon=False)
