"""``python -m benchmarks.flooded_reach``: reach of simulated heads in water, for alternatives.

Angles of single wires at full current around which there is more or less gas, and the share of
heads that reach a raster by a probe on either side, with rows that are bent or rolled.
"""

from __future__ import annotations

import argparse
import math

import numpy as np

from minorloop.arrays import FloatArray
from minorloop_head.geometry import Probe
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.twins.camera import LENS
from minorloop_head.twins.head import Head
from minorloop_head.twins.surroundings import Surroundings, convection
from minorloop_head.twins.wire import DIAMETER
from minorloop_head.ultrasound.pits import raster
from papers.catheter import scoring
from papers.catheter.mission import TEMPERATURES, needed

GAS = 0.026
"""Conductivity of air, in W/(m K)."""
WIDER = 2.5e-3
"""Radius in metres of a tube of gas around a wire: a head has no room for two of them."""
FILMS = {
    "no sleeve": convection("flooded"),
    "sleeve": convection("flooded, sleeved"),
    "tube of gas, radius 2.5 mm": GAS / (0.5 * DIAMETER * math.log(WIDER / (0.5 * DIAMETER))),
    "still air, not water": convection("air"),
}
HEADS = {
    "72 deg to the warm side, rows bent": Probe(squint=math.radians(72.0), azimuth=0.0),
    "70 deg to the cold side, rows bent": Probe(),
    "70 deg to the cold side, rows rolled": None,
}


def bent(probe: Probe) -> FloatArray:
    """Return the readings of `needed` for a raster that is bent only, with a catheter at rest.

    The probe is square to the wall at a tilt of 0.
    """
    view, rest = HeadCalibration(lens=LENS, leds=np.empty((0, 3)), probe=probe), np.zeros(2)
    square = probe.perpendicular(view.mount_at(rest), 0.0)
    phi, z = view.probe_at(rest).spots([[square, 0.0]])[0, :2].tolist()
    joints = np.array([view.joints(pair) for pair in raster(view.probe_at(rest), (phi, z))])
    return np.stack([joints.min(axis=0), joints.max(axis=0)], axis=1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--specimens", type=int, default=24)
    parser.add_argument("--seed", type=int, default=1000, help="of the first specimen")
    chosen = parser.parse_args()
    seeds = range(chosen.seed, chosen.seed + chosen.specimens)

    from rich.console import Console
    from rich.table import Table

    columns = [f"{temperature:.0f} C" for temperature in TEMPERATURES]
    angles = Table("wires", *columns, title="largest angle of a wire, median (least) [deg]")
    shares = Table("wires", "probe", "needs [deg]", *columns, title="heads that reach a raster [%]")
    for name, film in FILMS.items():
        around = [Surroundings(ambient=t, convection=film) for t in TEMPERATURES]
        ends = np.array([[scoring.ends(Head(seed), one) for seed in seeds] for one in around])
        largest = ends[..., 1].reshape(len(around), -1)
        angles.add_row(name, *(f"{np.median(one):.0f} ({one.min():.0f})" for one in largest))
        for probe, head in HEADS.items():
            needs = needed() if head is None else bent(head)
            reached = [
                100 * np.mean([scoring.reaches(Head(seed), one, needs) for seed in seeds])
                for one in around
            ]
            each = ", ".join(f"{low:.0f} to {high:.0f}" for low, high in needs)
            shares.add_row(name, probe, each, *(f"{share:.0f}" for share in reached))
    Console(width=120).print(angles, shares)


if __name__ == "__main__":
    main()
