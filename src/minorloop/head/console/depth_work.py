"""Work on the echoes of a scan, for a worker process: depth, fused map and mesh."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from minorloop.errors import MissingExtraError
from minorloop.head.console.units import degrees, mm
from minorloop.head.geometry import Mount, Probe
from minorloop.head.procedures.measure import wall_about
from minorloop.head.reconstruction.depth_map import DepthMap
from minorloop.head.reconstruction.mesh import mesh_of
from minorloop.head.ultrasound.echoes import Burst
from minorloop.head.ultrasound.field import CalibratedProbe, sound_field
from minorloop.head.ultrasound.pits import PitDepth, measure_pit


def warm_up() -> None:
    """Compute the sound field of the usual probe, which every scan needs."""
    sound_field(CalibratedProbe(Probe(), Mount()))


def depth(
    finding: int,
    bursts: list[Burst],
    probe: CalibratedProbe,
    centre: tuple[float, float],
    diameter: float,
) -> Iterator[dict[str, Any]]:
    """Fit the echoes of a scan; yields stages, then the result and its meshes."""
    yield {"stage": "fitting the echoes"}
    pit = measure_pit(bursts, probe, centre, diameter)
    yield {"stage": "drawing the map of depth"}
    wall = wall_about(pit, bursts, probe, centre, diameter)
    yield {"result": _result(pit, wall), "meshes": _meshes(wall)}


def _result(pit: PitDepth, wall: DepthMap) -> dict[str, Any]:
    values = {
        name: _finite(getattr(pit, name))
        for name in ("phi", "z", "diameter", "depth", "place_sd", "diameter_sd", "depth_sd")
    }
    depths = 1e3 * wall.depth
    grid = [[round(d, 4) if math.isfinite(d) else None for d in row] for row in depths.tolist()]
    patch = wall.patch
    return {
        **values,
        "verdict": pit.verdict,
        "bursts": pit.bursts,
        "patch": {
            "phi": degrees(patch.phi, 5),
            "z": mm(patch.z, 5),
            "step": 1e3 * patch.step,
            "depth": grid,
            "through": np.argwhere(np.isposinf(depths)).tolist(),
        },
    }


def _meshes(wall: DepthMap) -> dict[str, bytes]:
    """Return the map as PLY and glTF; empty without trimesh."""
    try:
        mesh = mesh_of(wall)
    except MissingExtraError:
        return {}
    return {kind: bytes(mesh.export(file_type=kind)) for kind in ("ply", "glb")}


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
