"""Computations on echoes in a worker: depth, fused map and mesh of a scan; map of a sweep."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from io import BytesIO
from typing import Any

import numpy as np

from minorloop_head.console.units import degrees, mm
from minorloop_head.geometry import Mount, Probe
from minorloop_head.procedures.sweep_map import draw_pipe_map, mapped_share
from minorloop_head.reconstruction.depth_map import DepthMap, Patch, mesh_of
from minorloop_head.reconstruction.findings import rounded
from minorloop_head.reconstruction.fusion import wall_about
from minorloop_head.ultrasound.c_scan import CScan, c_scan
from minorloop_head.ultrasound.echoes import Burst
from minorloop_head.ultrasound.field import CalibratedProbe, sound_field
from minorloop_head.ultrasound.pits import PitDepth, measure_pit
from minorloop_head.ultrasound.wall_echoes import SweptBurst


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


def sweep(
    bursts: list[SweptBurst],
    probe: CalibratedProbe,
    phi: tuple[float, float],
    z: tuple[float, float],
    radius: float,
    whole: bool,
) -> Iterator[dict[str, Any]]:
    """Map the bursts of a sweep; yields stages, then the finds and the map as files."""
    yield {"stage": "mapping the wall"}
    scan = c_scan(bursts, probe, Patch.ring(*z, radius=radius))
    picture = BytesIO()
    draw_pipe_map(scan, phi, brief=True).savefig(picture, format="png")
    yield {
        "finds": [asdict(one.finding(radius)) for one in scan.finds],
        "mapped": mapped_share(scan, phi),
        "whole": whole,
        "files": {"png": picture.getvalue(), "csv": _listed(scan)},
    }


def _listed(scan: CScan) -> bytes:
    """Return the map as CSV, a row for each texel with an amplitude."""
    known = np.isfinite(scan.amplitude)
    wall, places = scan.wall, scan.wall.patch.places[known]
    values = (
        np.degrees(places[:, 0]) % 360.0,
        1e3 * places[:, 1],
        scan.amplitude[known],
        1e3 * wall.depth[known],
        1e3 * wall.sd[known],
    )
    table = BytesIO()
    header = "phi [deg],z [mm],amplitude [1],depth [mm],depth_sd [mm]"
    rows = np.stack([np.where(np.isfinite(each), each, np.nan) for each in values], axis=-1)
    np.savetxt(table, rows, "%.4f", ",", header=header, comments="")
    return table.getvalue().replace(b"nan", b"")


def _result(pit: PitDepth, wall: DepthMap) -> dict[str, Any]:
    values = {
        name: rounded(getattr(pit, name), 9)
        for name in ("phi", "z", "diameter", "depth", "place_sd", "diameter_sd", "depth_sd")
    }
    depths = 1e3 * wall.depth
    grid = [[rounded(depth, 4) for depth in row] for row in depths.tolist()]
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
    """Return the map as PLY and glTF."""
    mesh = mesh_of(wall)
    return {kind: bytes(mesh.export(file_type=kind)) for kind in ("ply", "glb")}
