"""The scene of a mission: a pipe with a pit and a crack, and a rig of twins in it, by one seed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from minorloop_head.control.head import HeadControl, head_control
from minorloop_head.geometry import Mount, Probe, wall_distance
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.head_file import HeadFile
from minorloop_head.procedures.rig import InspectionRig
from minorloop_head.procedures.scan import RasterScan
from minorloop_head.procedures.seen_base import SeenBase
from minorloop_head.twins.catheter import Catheter
from minorloop_head.twins.head import Head
from minorloop_head.twins.pipe import Bore, Crack, Pipe, draw_crack
from minorloop_head.twins.rig import Rig, SimulatedTip
from minorloop_head.twins.surroundings import Filling, Surroundings, Sway
from papers.catheter import scoring
from papers.catheter.inspection_servo import wires_of
from papers.harness import Results

RADIUS = 10e-3
SWAY = Sway()
"""Motion of the base of the head in the flow of the water."""
OFF_THICKNESS, OFF_TEMPERATURE = 0.01, 0.3
"""Standard deviations of the known wall thickness, relative, and water temperature, in degrees."""
TEMPERATURES, OFF_SLEEVE = (10.0, 40.0), 0.04
"""Range of the temperature of the water, in degrees Celsius, and largest share by which the
convection of a sleeve differs from nominal: that of a bore which is 10 % wider or narrower."""
CRACKED, CLEAR = (18e-3, 31e-3), 3e-3
"""Range of cracks along the pipe, and least distance from the pit, in metres."""


def draw_mission(seed: int, head: HeadFile | None = None) -> tuple[InspectionRig, Results]:
    """Draw a rig in a pipe with a pit and a crack, and return it with the truth, for scoring only.

    The truth has the pit, ``bore``, and the ``crack``; the ``pipe`` without ``water``; the
    ``plant``, head and catheter, and the ``offset`` of the pivot of the head off the axis of the
    pipe, in metres. The head of this seed is identified if its file is not given.

    Raises
    ------
    ModelFileError
        If the file is of another head.
    """
    control = _control(seed, head)
    rng = np.random.default_rng([seed, 31])
    phi, z, wide, deep = (
        float(rng.uniform(*ends))
        for ends in ((-np.pi, np.pi), (19e-3, 30e-3), (0.9e-3, 1.1e-3), (0.3e-3, 0.8e-3))
    )
    bore = Bore(phi, z, wide, depth=deep, brightness=0.0, lining=0.08)
    crack = crack_beside(bore, np.random.default_rng([seed, 35]))
    dry = replace(Pipe.draw(seed), bores=(bore,), cracks=(crack,))
    wet = [bore.phi, *(phi for phi, _ in crack.points)]
    level = _level(wet, np.random.default_rng([seed, 32]))
    x, y = rng.uniform(-0.2e-3, 0.2e-3, 2).tolist()
    known_x, known_y = (np.array([x, y]) + rng.normal(0, 0.05e-3, 2)).tolist()
    about = np.random.default_rng([seed, 33])
    flooded = Filling(
        level=level,
        temperature=float(about.uniform(*TEMPERATURES)),
        sleeve=float(about.uniform(1 - OFF_SLEEVE, 1 + OFF_SLEEVE)),
        sway=SWAY,
    )
    head_twin = Head(seed, 0.05, seed, delay=0.04)
    plant = Rig(head_twin, Catheter(seed, 0.02, seed), flooded=flooded)
    tip = SimulatedTip(
        dry,
        mount=Mount(offset=(x, y)),
        specimen=seed,
        seed=seed,
        flooded=flooded,
        flow=plant.flood,
    )
    calibration = HeadCalibration(
        lens=tip.camera.calibration,
        leds=tip.camera.leds,
        offset=(known_x, known_y),
        thickness=dry.thickness * float(1 + OFF_THICKNESS * about.normal()),
        temperature=flooded.temperature + OFF_TEMPERATURE * float(about.normal()),
        tool=tip.tool.calibration,
    )
    rig = InspectionRig(plant, tip, control, calibration, base=SeenBase(calibration))
    return rig, Results(bore=bore, crack=crack, pipe=dry, water=flooded, plant=plant, offset=(x, y))


def reachable(rig: InspectionRig, truth: Results) -> bool:
    """Return whether the wires truly reach a raster in the water. For scoring only."""
    view = rig.calibration
    needs = [view.joints(pair) for pair in RasterScan(calibration=view).needs.T]
    around = truth.water.around(Surroundings())
    return scoring.reaches(Head(truth.plant.head.specimen), around, np.array(needs).T)


def _control(seed: int, head: HeadFile | None) -> HeadControl:
    """Return the control of the head of a seed, by its file or as identified now."""
    if head is None:
        wires, coupling = wires_of(seed)
        return head_control("observer", wires, coupling=coupling)
    head.check_fits(Head(seed).serial, "the file given")
    return head.control()


def crack_beside(bore: Bore, rng: np.random.Generator) -> Crack:
    """Draw a crack that the views reach, away from the bore."""
    low, high = CRACKED
    while True:
        crack = draw_crack(rng, float(rng.uniform(-np.pi, np.pi)), float(rng.uniform(low, high)))
        z = [along for _, along in crack.points]
        off = min(distance(corner, (bore.phi, bore.z)) for corner in crack.points)
        if low < min(z) and max(z) < high and off > CLEAR:
            return crack


def _level(angles: Sequence[float], rng: np.random.Generator) -> float:
    """Draw a height of the water, y pointing down, above all these and the probe."""
    up = float(np.sin(angles).min())
    highest = min(min(RADIUS, Probe().face) * up - 1e-3, RADIUS * up - 2.5e-3)
    return float(rng.uniform(-0.98 * RADIUS, highest)) if highest > -0.98 * RADIUS else -0.9999e-2


def distance(one: npt.ArrayLike, other: npt.ArrayLike) -> float:
    """Return the distance along the wall between two places, phi and z, in metres."""
    return float(wall_distance(one, other, RADIUS))
