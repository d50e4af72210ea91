"""Depths of pits by echoes, from a head that sways: scans of scenes that no fit has seen.

A scan is a raster of 36 places about where the camera saw the mouth, 16 shots at each while the
head sways by a degree. The estimator knows mount, probe, water and wall as they would be
calibrated, each a little off.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.geometry import Mount, Probe, wall_point, wrapped
from minorloop.inspection.echoes import Burst, average, choose_modality
from minorloop.inspection.field import Ear, sound_field
from minorloop.inspection.fusion import fuse, mean_depths
from minorloop.inspection.pits import PitDepth, measure_pit, raster
from minorloop.inspection.unrolled import Patch, WallMap
from minorloop.twins.pipe import Bore, Pipe, draw_pit
from minorloop.twins.seeing import Sway
from minorloop.twins.ultrasound import Ultrasound

RADIUS, PLACE = 10e-3, 20e-3
SHOTS, MOVE = 16, 0.8
"""Shots at a place of the raster, and seconds to the next."""
SNR = 20.0
"""Of the floor echo of an averaged trace, in decibels."""
ANGLE_NOISE = np.radians(0.05)
DISH = 0.1e-3
FUSED = (1e-3, 0.5e-3)
"""Diameter and depth of the pit whose finding is scored, in m."""
SIZE = 2.4e-3
BAND = 1.6449


@dataclass(frozen=True, eq=False)
class DepthScene:
    """One pit, a probe before it, and what is known of both.

    ``bore`` is the truth, for scoring; ``centre`` and ``diameter`` what the camera saw.
    """

    bore: Bore
    probe: Ultrasound
    ear: Ear
    centre: tuple[float, float]
    diameter: float
    rng: np.random.Generator

    @property
    def depth(self) -> float:
        """Mean depth of the floor, in m; infinite for a hole."""
        return self.bore.depth - self.bore.dish / 2


def draw_scene(
    seed: int,
    *,
    focused: bool = True,
    through: bool = False,
    dish: float = 0.0,
    size: tuple[float, float] | None = None,
    water: bool = True,
) -> DepthScene:
    """A pit of 0.85 to 1.5 mm by 0.2 to 1 mm with a tilted floor, or as is said."""
    rng = np.random.default_rng([seed, 23])
    phi = float(rng.uniform(-np.pi, np.pi))
    bore = replace(draw_pit(rng, phi, PLACE), dish=dish)
    if size is not None:
        bore = replace(bore, diameter=size[0], depth=size[1])
    if through:
        bore = replace(bore, depth=np.inf, floor_tilt=(0.0, 0.0))
    surface = -0.9999 * RADIUS if water else None
    pipe = Pipe(bores=(bore,), water=surface, thickness=float(rng.uniform(1.5e-3, 4e-3)))
    off = rng.uniform(-0.2e-3, 0.2e-3, 2)
    true = Mount(
        offset=(float(off[0]), float(off[1])),
        roll=phi + float(rng.normal(0, 0.02)),
        advance=PLACE + float(rng.normal(0, 0.1e-3)),
    )
    seen = off + rng.normal(0, 0.05e-3, 2)
    kind = Probe() if focused else Probe(focus=np.inf)
    temperature = float(rng.uniform(12, 30))
    make: dict[str, Any] = {"specimen": seed, "seed": seed, "temperature": temperature}
    quiet = Ultrasound(pipe, true, kind, noise=0.0, **make)
    level = quiet._floor_level() if not through else (0.83 if focused else 0.18)
    noise = level * 10 ** (-SNR / 20) * np.sqrt(SHOTS)
    probe = Ultrasound(pipe, true, kind, noise=float(noise), **make)
    probe.amplify(float(min(0.5, 0.5 / (0.7 + 4 * noise))))
    ear = Ear(
        kind,
        replace(true, offset=(float(seen[0]), float(seen[1]))),
        thickness=pipe.thickness * float(rng.uniform(0.97, 1.03)),
        temperature=temperature + float(rng.normal(0, 0.3)),
    )
    centre = (
        phi + float(rng.normal(0, 0.035e-3)) / RADIUS,
        PLACE + float(rng.normal(0, 0.035e-3)),
    )
    diameter = bore.diameter * float(np.exp(rng.normal(0, 0.05)))
    return DepthScene(bore, probe, ear, centre, diameter, rng)


def scan(scene: DepthScene, places: int | None = None) -> list[Burst]:
    """The bursts of a raster under sway; of its first places only, if it is interrupted."""
    sway, phases = Sway(1.0), scene.rng.uniform(0, 40.0)
    bursts = []
    for target in raster(scene.ear, scene.centre)[:places]:
        shots, angles = [], []
        for _ in range(SHOTS):
            at = target + np.radians(sway.at(scene.probe.clock + phases))
            scene.probe.look(float(at[0]), float(at[1]))
            shots.append(scene.probe.shot())
            angles.append(at + ANGLE_NOISE * scene.rng.standard_normal(2))
        spots = scene.ear.spots(np.array(angles))
        wanted = scene.ear.spots(target[None])[0]
        off = np.hypot(RADIUS * wrapped(spots[:, 0] - wanted[0]), spots[:, 1] - wanted[1])
        bursts.append(average(shots, np.array(angles), off))
        scene.probe.wait(MOVE)
    return bursts


@dataclass(frozen=True, eq=False)
class Scan:
    """A scene, its bursts, what they gave, and how long that took, in seconds."""

    scene: DepthScene
    bursts: Sequence[Burst]
    pit: PitDepth
    seconds: float

    @property
    def error(self) -> float:
        """Depth less the true mean depth, in m; NaN where none was given."""
        return self.pit.depth - self.scene.depth if self.pit.measured else np.nan


def run_scan(seed: int, **options: Any) -> Scan:
    """Scan and measure one scene."""
    scene = draw_scene(seed, **options)
    bursts = scan(scene)
    sound_field(scene.ear)
    began = time.process_time()
    pit = measure_pit(bursts, scene.ear, scene.centre, scene.diameter)
    return Scan(scene, bursts, pit, time.process_time() - began)


def fused(found: Scan) -> WallMap:
    """The map of depth about a pit."""
    patch = Patch.around(*found.scene.centre, size=SIZE)
    heard = mean_depths(found.bursts, found.scene.ear, patch, found.pit)
    return fuse(found.pit, heard, patch)


def air_is_known(seed: int) -> bool:
    """Whether a scene without water is left to the camera, and no depth made up."""
    scene = draw_scene(seed, water=False)
    bursts = scan(scene, places=6)
    shots = []
    for target in raster(scene.ear, scene.centre)[:3]:
        scene.probe.look(float(target[0]), float(target[1]))
        shots.append(scene.probe.shot())
    stand = RADIUS - scene.ear.probe.face
    modality = choose_modality(shots, stand, scene.ear.speed)
    pit = measure_pit(bursts, scene.ear, scene.centre, scene.diameter)
    return modality == "camera" and not np.isfinite(pit.depth)


def depth_figures(seed: int) -> tuple[dict[str, Any], dict[str, Scan]]:
    """Scans of one seed of every kind, and what they gave; see ``gather_depths``."""
    scans = {
        "flat": run_scan(seed),
        "unfocused": run_scan(seed, focused=False),
        "hole": run_scan(seed + 10_000, through=True),
        "dished": run_scan(seed + 20_000, dish=DISH),
        "fused": run_scan(seed + 30_000, size=FUSED),
    }
    whole = fused(scans["fused"])
    scene, pit = scans["fused"].scene, scans["fused"].pit
    place = np.hypot(RADIUS * float(wrapped(pit.phi - scene.bore.phi)), pit.z - scene.bore.z)
    dished = scans["dished"]
    return {
        "error_um": 1e6 * scans["flat"].error,
        "sd_um": 1e6 * scans["flat"].pit.depth_sd,
        "unfocused_um": 1e6 * scans["unfocused"].error,
        "hole": scans["hole"].pit.verdict,
        "dished_mm": 1e3 * abs(dished.error) if dished.pit.measured else 0.0,
        "scan_seconds": scans["flat"].seconds,
        "air_known": air_is_known(seed + 40_000),
        "position_mm": 1e3 * float(place),
        "diameter_pct": 100 * abs(pit.diameter / scene.bore.diameter - 1),
        "depth_mm": 1e3 * abs(scans["fused"].error),
        "covered": _covered(whole, scans["fused"]),
        "band_mm": _band(whole, scans["fused"]),
    }, scans


def gather_depths(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Numbers over all seeds."""

    def column(name: str) -> FloatArray:
        return np.array([row[name] for row in rows], dtype=np.float64)

    error, unfocused = column("error_um"), column("unfocused_um")
    return {
        "depth": {
            "bias_um": float(np.nanmean(error)),
            "sd_um": float(np.nanstd(error)),
            "measured_fraction": float(np.isfinite(error).mean()),
            "unfocused_bias_um": float(np.nanmean(unfocused))
            if np.isfinite(unfocused).any()
            else np.nan,
            "unfocused_sd_um": float(np.nanstd(unfocused))
            if np.isfinite(unfocused).any()
            else np.nan,
            "unfocused_measured": float(np.isfinite(unfocused).mean()),
            "dished_error_mm": float(column("dished_mm").max()),
            "scan_seconds": float(np.median(column("scan_seconds"))),
        },
        "fusion": {
            "position_mm": float(np.nanmax(column("position_mm"))),
            "diameter_error_pct": float(np.nanmax(column("diameter_pct"))),
            "depth_error_mm": float(np.nanmax(column("depth_mm"))),
            "coverage": float(np.nanmean(column("covered"))),
            "band_mm": float(np.nanmean(column("band_mm"))),
        },
        "modality": {
            "wrong": int(
                sum(row["hole"] == "measured" for row in rows)
                + sum(not row["air_known"] for row in rows)
            )
        },
    }


def _inside(whole: WallMap, found: Scan) -> FloatArray:
    """(rows, columns) distance of texels from the true centre, over the true radius."""
    bore = found.scene.bore
    off = whole.patch.off(bore.phi, bore.z)
    return np.asarray(np.hypot(off[..., 0], off[..., 1]) / (bore.diameter / 2))


def _covered(whole: WallMap, found: Scan) -> float:
    """Share of the texels of floor and wall, rims left out, whose truth lies in the 90 % band."""
    bore, share = found.scene.bore, _inside(whole, found)
    off = whole.patch.off(bore.phi, bore.z)
    floor = bore.depth + off @ np.array(bore.floor_tilt) - bore.dish * np.minimum(share**2, 1.0)
    inside = share < 0.8
    known = inside & np.isfinite(whole.sd) & np.isfinite(whole.depth)
    if not known.any():
        return np.nan
    return float(np.mean(np.abs(whole.depth - floor)[known] <= BAND * whole.sd[known]))


def _band(whole: WallMap, found: Scan) -> float:
    """Mean half width of the 90 % band on the floor, in mm."""
    inside = (_inside(whole, found) < 0.8) & np.isfinite(whole.sd)
    return float(1e3 * BAND * whole.sd[inside].mean()) if inside.any() else np.nan
