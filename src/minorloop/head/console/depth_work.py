"""Work on echoes, for a worker process: depth, fused map and mesh of a scan; map of a sweep."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict
from io import BytesIO
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.drawing.layout import new_figure
from minorloop.errors import MissingExtraError
from minorloop.head.console.units import degrees, mm
from minorloop.head.geometry import Mount, Probe
from minorloop.head.procedures.measure import wall_about
from minorloop.head.reconstruction.depth_map import DepthMap, Patch
from minorloop.head.reconstruction.mesh import mesh_of
from minorloop.head.ultrasound.c_scan import CScan, Indices, SweptBurst, c_scan
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


def sweep(
    bursts: list[SweptBurst], probe: CalibratedProbe, z: tuple[float, float], radius: float
) -> Iterator[dict[str, Any]]:
    """Map the bursts of a sweep; yields stages, then the finds and the map as files."""
    yield {"stage": "mapping the wall"}
    scan = c_scan(bursts, probe, Patch.ring(*z, radius=radius))
    finds = [asdict(one.finding(radius)) for one in scan.finds]
    yield {"finds": finds, "files": {"png": _drawn(scan), "csv": _listed(scan)}}


def _columns(scan: CScan) -> tuple[Indices, FloatArray]:
    """Return the columns of the map that were swept, and their angles in degrees, rising.

    The area may cross the seam of the map: it begins behind the widest gap.
    """
    patch = scan.wall.patch
    swept = np.flatnonzero(np.isfinite(scan.amplitude).any(axis=0))
    if not swept.size:
        return swept, np.zeros(0)
    gaps = np.diff(swept, append=swept[0] + patch.columns)
    first = swept[(int(np.argmax(gaps)) + 1) % swept.size]
    count = patch.columns - int(gaps.max()) + 1
    columns = (first + np.arange(count)) % patch.columns
    begin = float(patch.places[0, first, 0]) % (2 * np.pi)
    return columns, np.degrees(begin + np.arange(count) * patch.step / patch.radius)


def _drawn(scan: CScan) -> bytes:
    """Return a picture of the map as PNG: amplitude of the echoes, and depth by their time."""
    figure, axes = new_figure(2, 1, height=4.2, sharex=True)
    columns, phi = _columns(scan)
    z = 1e3 * scan.wall.patch.places[:, 0, 1]
    depth = 1e3 * np.where(np.isfinite(scan.wall.depth), scan.wall.depth, np.nan)
    for one, values, title, label in (
        (axes[0], scan.amplitude, "amplitude of the echo", "of a plain wall"),
        (axes[1], depth, "depth by the time of flight", "[mm]"),
    ):
        one.grid(False)
        one.set(title=title, ylabel="along [mm]")
        if phi.size:
            extent = (phi[0], phi[-1], z[0], z[-1])
            shown = one.imshow(values[:, columns], origin="lower", extent=extent, aspect="auto")
            figure.colorbar(shown, ax=one, label=label)
    axes[1].set_xlabel("around the pipe [degrees], 90 at the bottom")
    picture = BytesIO()
    figure.savefig(picture, format="png")
    return picture.getvalue()


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
