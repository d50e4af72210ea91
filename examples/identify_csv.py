"""From a CSV file to a model, and how far to trust it."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import minorloop as ml

with TemporaryDirectory() as folder:
    # A record of one's own would be there already; this one is measured on a twin.
    strip = ml.connect("twin:ipmc", specimen=1, noise=0.05)
    levels = np.linspace(-1.2, 1.2, 11)
    stairs = ml.excitation.decaying_staircase(levels)
    wander = np.random.default_rng(0).uniform(-1.2, 1.2, 20)
    voltages = np.concatenate([stairs, wander])
    curvatures = [strip.apply(float(u), 200.0, 1.0).y[-1] for u in voltages]
    path = Path(folder) / "strip.csv"
    ml.Record(
        voltages, curvatures, 200.0 * np.arange(voltages.size), "voltage [V]", "curvature [1/m]"
    ).to_csv(path)

    record = ml.read(path, input="voltage", output="curvature")
    found = ml.identify(record, ml.Plane(levels, diagonal="reversible"), holdout=20 / voltages.size)
    print(found)
