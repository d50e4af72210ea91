"""
Dynamics
========

A stage follows its settled curve late. The model separates hysteresis from lag, and its inverse
sends the input early: a sine of 20 Hz is followed without a sensor.
"""

import matplotlib.pyplot as plt
import numpy as np

import minorloop as ml

# The simulated stage: hysteresis, then lags of 3 and 1 ms; a sensor with 10 nm of noise.
distance = np.subtract.outer(np.arange(50), np.arange(50))
plane = ml.Preisach(np.linspace(0, 100, 51), np.tril(0.02 * np.exp(-distance / 5)))
stage = ml.Cascade(plane, ml.Linear.lags(3e-3, 1e-3))

t = np.arange(0, 1, 1e-3)
u = 50 - 50 * np.cos(2 * np.pi * (2 + 8 * t) * t) * (1 - 0.7 * t)  # 2 to 18 Hz
y = stage.simulate(t, u) + 0.01 * np.random.default_rng(0).normal(size=t.size)
fit = ml.identify(
    ml.Record(u, y, t), ml.Dynamics(ml.Plane(20), first="operator", poles=2, creep=False)
)
print(fit)

low, high = fit.model.operator.range
now = t[:150]
wanted = low + 0.4 * (high - low) * (1 - np.cos(2 * np.pi * 20 * now))
early = fit.invert(now, wanted, before=0.0, unreachable="clip").u
static = fit.model.operator.invert(wanted, unreachable="clip").u
figure, axes = plt.subplots(figsize=(7.5, 3.8), layout="constrained")
axes.plot(1e3 * now, wanted, "k--", label="wanted")
axes.plot(1e3 * now, stage.simulate(now, static), label="inverse of the hysteresis alone")
axes.plot(1e3 * now, stage.simulate(now, early), label="inverse with the dynamics")
axes.set(xlabel="time [ms]", ylabel="position [um]")
axes.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
