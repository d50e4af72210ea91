"""Depth of a crack that an acquisition found, by a scan across it in water."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from minorloop.arrays import FloatArray
from minorloop_head.geometry import Mount, Probe
from minorloop_head.procedures.trace import widest
from minorloop_head.twins.pipe import Crack, Pipe
from minorloop_head.twins.ultrasound import Ultrasound
from minorloop_head.ultrasound.crack_depth import CrackDepth, crack_depth
from minorloop_head.ultrasound.field import CalibratedProbe
from minorloop_head.vision.cracks import TracedCrack
from papers.catheter.scan_trials import CAMERA_SD, FLOODED, draw_probe, scan, strayed


@dataclass(eq=False)
class CrackTrial:
    """A probe before a crack.

    Parameters
    ----------
    probe : CalibratedProbe
        As calibrated.
    centre : (float, float)
        Phi and z of the widest place of the traced course.
    twin : Ultrasound
        Of the probe.
    pipe : Pipe
        With water.
    mount : Mount
        True mount. For scoring only.
    rng : numpy Generator
        Of sway and noise of the angles.
    specimen : int
        Seed of camera and wall.
    pose : str
        As of a scan of a pit.
    """

    probe: CalibratedProbe
    centre: tuple[float, float]
    twin: Ultrasound
    pipe: Pipe
    mount: Mount
    rng: np.random.Generator
    specimen: int
    pose: str = "camera"


def scanned_depth(
    seed: int, cracks: tuple[Crack, ...], traced: TracedCrack, places: FloatArray
) -> CrackDepth:
    """Scan across a crack where it is widest, with the noise of a mission, and measure its depth.

    Parameters
    ----------
    seed : int
        Of probe, mount and noise.
    cracks : tuple of Crack
        The true ones.
    traced : TracedCrack
        As the camera sees it.
    places : (N, 2) array
        Its places in the pipe without the error of the mount in the acquisition; the scan has its
        own mount, with its own error, which the camera shares.
    """
    rng = np.random.default_rng([seed, 23])
    place, width = widest(traced)
    at = int(np.argmin(np.abs(traced.places - place).sum(axis=1)))
    phi, z = places[at].tolist()
    mount, probe, thickness, warm = draw_probe(rng, phi, z, Probe())
    probe, off = strayed(rng, probe)
    error = np.array(off) + CAMERA_SD * rng.standard_normal(2) / [Pipe.radius, 1.0]
    pipe = Pipe(cracks=cracks, water=FLOODED, thickness=thickness)
    twin = Ultrasound(pipe, mount, probe.transducer, temperature=warm, specimen=seed, seed=seed)
    known = places + error
    centre = (float(known[at, 0]), float(known[at, 1]))
    used, bursts = scan(CrackTrial(probe, centre, twin, pipe, mount, rng, seed))
    return crack_depth(bursts, used, known, width)
