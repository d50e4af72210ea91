"""
Many specimens
==============

A fleet identifies one model for each record of a manifest, on all cores or a cluster. A specimen
that fails does not stop the others, and a repeated call identifies only what changed.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np

import minorloop as ml
from minorloop.fleet import Specimen, identify_fleet

stairs = ml.excitation.decaying_staircase(np.linspace(-1.2, 1.2, 11))
figure, axes = plt.subplots(figsize=(6, 4), layout="constrained")
with TemporaryDirectory() as folder:
    specimens = []
    for number in range(1, 5):
        strip = ml.connect("twin:ipmc", specimen=number, noise=0.05)
        y = [strip.apply(u, 200.0, 200.0).y[-1] for u in stairs]
        file = Path(folder) / f"strip-{number}.csv"
        ml.Record(stairs, y, inputs="voltage [V]", outputs="curvature [1/m]").to_csv(file)
        specimens.append(Specimen(f"strip-{number}", file, "voltage", "curvature"))
    summary = identify_fleet(specimens, f"{folder}/fleet", levels=10, diagonal="reversible", lag=0)
    for one in summary.outcomes:
        model = ml.load(f"{folder}/fleet/models/{one.specimen}.json")
        u = np.r_[np.linspace(-1.2, 1.2, 60), np.linspace(1.2, -1.2, 60)]
        axes.plot(u, model.simulate(u), label=f"{one.specimen}: opening {one.opening:.0%} of range")
axes.set(xlabel="voltage [V]", ylabel="curvature [1/m]", title="Major loops of four strips")
axes.legend(frameon=False)
