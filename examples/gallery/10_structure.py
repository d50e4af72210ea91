"""
A structure's loop
==================

Measured: a wall under cyclic load, from a project under Apache-2.0. The model is fitted to the
first cycles and predicts the later ones, which repeat a size that was fitted. Bands say where
nine readings in ten should lie; here they are wider than needed.
"""

import matplotlib.pyplot as plt
import numpy as np

import minorloop as ml

record = ml.read("../wall.csv", input="force", output="displacement")
fit = ml.identify(record, holdout=0.3)
print(f"error on rows that were not fitted: {fit.holdout_nrmse:.2%} of range")


rows = fit.held_out
bands = fit.predict(fit.u, bands=0.9)
inside = np.abs(bands.y - fit.y)[rows] <= bands.half_width[rows]
print(f"within their 90 % bands: {inside.mean():.0%}")

figure, (loop, later) = plt.subplots(1, 2, figsize=(9.5, 3.8), layout="constrained")
loop.plot(fit.u[~rows], fit.y[~rows], color="0.75", label="fitted")
loop.plot(fit.u[rows], bands.y[rows], color="C0", label="predicted")
loop.plot(fit.u[rows][::4], fit.y[rows][::4], ".", color="C1", label="not fitted")
loop.set(xlabel="force [kN]", ylabel="displacement [mm]", title="A wall under cyclic load")
loop.legend(frameon=False)
later.plot(
    np.flatnonzero(rows), (bands.y - fit.y)[rows], color="C0", label="predicted less measured"
)
later.fill_between(
    np.flatnonzero(rows),
    -bands.half_width[rows],
    bands.half_width[rows],
    alpha=0.2,
    label="90 % band",
)
later.set(xlabel="row", ylabel="error [mm]", title="Rows that were not fitted")
later.legend(frameon=False)
