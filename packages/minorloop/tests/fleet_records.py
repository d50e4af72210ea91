"""Records and manifests of made-up specimens."""

import numpy as np

from minorloop.fleet.manifest import read_manifest
from minorloop.operators.preisach import Preisach

HEADER = "specimen,file,input,output"
OPTIONS = {"levels": 6, "prior": "none", "smoothness": 0.0}
"""Of fits that take little time."""


def write_record(path, seed, samples=200):
    """A record of a random operator with 6 bands, without noise."""
    rng = np.random.default_rng(seed)
    model = Preisach(np.linspace(-1, 1, 7), np.tril(rng.uniform(0.5, 1, (6, 6))))
    u = np.concatenate([[-1, 1], rng.uniform(-1, 1, samples - 2)])
    table = np.column_stack([u, model.simulate(u)])
    np.savetxt(path, table, delimiter=",", header="drive [V],tip [mm]", comments="", fmt="%.12g")


def write_manifest(folder, names):
    """Specimens with records of the same names, read back."""
    lines = [HEADER, *(f"{name},{name}.csv,drive,tip" for name in names)]
    (folder / "manifest.csv").write_text("\n".join(lines) + "\n")
    return read_manifest(folder / "manifest.csv")


def write_fleet(folder, names):
    """Specimens with these names, each with a record of its own."""
    for k, name in enumerate(names):
        write_record(folder / f"{name}.csv", k)
    return write_manifest(folder, names)
