"""Pits, holes and marks drawn by seed, scanned by a swaying probe, and scored after the scan.

What the estimate is given is what a head would know: angles read with noise, a mount and a water
temperature that are a little off, and the place and size that a camera saw.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, check_option
from minorloop.head.geometry import Mount, Probe, wall_distance
from minorloop.head.procedures.measure import wall_about, wall_answers
from minorloop.head.procedures.scan import RasterScan
from minorloop.head.reconstruction.depth_map import DepthMap, Patch
from minorloop.head.studies import scoring
from minorloop.head.twins.pipe import Bore, Pipe, draw_pit
from minorloop.head.twins.ultrasound import Ultrasound
from minorloop.head.ultrasound.echoes import Burst, average
from minorloop.head.ultrasound.field import CalibratedProbe
from minorloop.head.ultrasound.pits import PitDepth, measure_pit, raster
from minorloop.identification.bands import PER_DEVIATION

KINDS = ("pit", "dished", "hole", "mark", "dry")
DISH = 0.1e-3
"""How much shallower a dished floor is at its rim, in metres."""
_Z = 20e-3
_FLOODED = -9.999e-3
_ANGLE_NOISE = math.radians(0.05)
_SWAY = (0.3, 0.23)  # Hz, of pan and tilt
_DARK, _SHADE_NOISE, _EDGE = -1.2, 0.08, 0.05e-3
_ROLL_SD, _ADVANCE_SD = 5e-3, 0.05e-3
"""How far off the known mount is, in radians and metres."""


@dataclass(eq=False)
class ScanSite:
    """A place of a pipe, what is known of it, and what is true.

    Parameters
    ----------
    ear : CalibratedProbe
        What is known of the probe.
    centre : (float, float)
        Of the mouth as the camera saw it, phi and z.
    diameter : float
        As the camera saw it, in metres.
    truth : Bore
        For scoring only.
    dry : bool
        Whether there is no water.
    strayed : (float, float)
        Known less true roll and advance of the mount. For scoring only.
    """

    ear: CalibratedProbe
    centre: tuple[float, float]
    diameter: float
    truth: Bore
    dry: bool
    strayed: tuple[float, float] = (0.0, 0.0)

    @property
    def depth(self) -> float:
        """True mean depth of the floor, in metres. For scoring only."""
        return self.truth.depth - self.truth.dish / 2


@dataclass(eq=False, kw_only=True)
class ScanTrial(ScanSite):
    """A place with a probe before it.

    Parameters
    ----------
    sonar : Ultrasound
        The twin.
    pipe : Pipe
        With water, if any.
    mount : Mount
        As it truly is. For scoring only.
    probe : dict
        Noise, gain and temperature of the twin.
    rng : numpy Generator
        Of the sway, of the noise of the angles, and of the picture.
    """

    sonar: Ultrasound
    pipe: Pipe
    mount: Mount
    probe: dict[str, Any]
    rng: np.random.Generator

    @property
    def site(self) -> ScanSite:
        """The place alone: the twin of a probe fills 19 MB."""
        return ScanSite(self.ear, self.centre, self.diameter, self.truth, self.dry, self.strayed)

    def picture(self, patch: Patch) -> FloatArray:
        """Logarithm (rows, columns) of the image laid flat: a dark mouth where the camera saw it.

        Place and size are off as the camera's are; edges are a texel wide, and every texel has
        noise of its own. A fresh draw each time.
        """
        off = np.linalg.norm(patch.off(*self.centre), axis=-1)
        dark = 1 / (1 + np.exp(np.clip((off - self.diameter / 2) / _EDGE, -30.0, 30.0)))
        shade: FloatArray = _DARK * dark + _SHADE_NOISE * self.rng.standard_normal(off.shape)
        return shade


def draw_sounding(
    seed: int, *, kind: str = "pit", lens: bool = True, snr: float = 20.0, bore: Bore | None = None
) -> ScanTrial:
    """A pit of 0.85 to 1.5 mm by 0.2 to 1 mm, or something else, in a pipe by seed.

    Parameters
    ----------
    seed : int
        Of everything.
    kind : {"pit", "dished", "hole", "mark", "dry"}
        A pit with a flat floor, one that is 0.1 mm shallower at its rim, a through-hole, a spot
        of dirt, or a pit in a pipe without water.
    lens : bool
        Whether the disc has its lens.
    snr : float
        Peak of the floor echo over the noise of a trace of 16 shots, in decibels; of the echo
        of a plain wall where there is no floor.
    bore : Bore, optional
        Its diameter and depth replace those drawn.
    """
    check_option("kind", kind, KINDS)
    rng = np.random.default_rng([seed, 77])
    phi = float(rng.uniform(-np.pi, np.pi))
    pit = draw_pit(rng, phi, _Z)
    if bore is not None:
        pit = replace(pit, diameter=bore.diameter, depth=bore.depth)
    pit = replace(
        pit, dish=DISH if kind == "dished" else 0.0, depth=math.inf if kind == "hole" else pit.depth
    )
    pipe = Pipe(
        bores=() if kind == "mark" else (pit,),
        water=None if kind == "dry" else _FLOODED,
        thickness=float(rng.uniform(1.5e-3, 4e-3)),
    )
    off = rng.uniform(-0.2e-3, 0.2e-3, 2)
    roll = phi + float(rng.normal(0, 0.02))
    true = Mount(
        offset=(float(off[0]), float(off[1])),
        roll=roll,
        advance=_Z + float(rng.normal(0, 0.1e-3)),
    )
    guess = off + rng.normal(0, 0.05e-3, 2)
    known = replace(true, offset=(float(guess[0]), float(guess[1])))
    warm, probe = float(rng.uniform(12, 30)), Probe() if lens else Probe(focus=math.inf)
    level = 1.0
    if kind in ("pit", "dished", "dry"):
        level = scoring.floor_level(
            Ultrasound(pipe, true, probe, noise=0.0, temperature=warm, specimen=seed, seed=seed)
        )
    noise = level * 10 ** (-snr / 20) * math.sqrt(RasterScan.shots)
    heard: dict[str, Any] = {
        "noise": noise,
        "gain": min(0.5, 0.5 / (0.7 + 4 * noise)),
        "temperature": warm,
    }
    sonar = Ultrasound(pipe, true, probe, specimen=seed, seed=seed, **heard)
    ear = CalibratedProbe(
        probe,
        known,
        thickness=pipe.thickness * float(rng.uniform(0.97, 1.03)),
        temperature=warm + float(rng.normal(0, 0.3)),
    )
    centre = (
        phi + float(rng.normal(0, 0.035e-3)) / pipe.radius,
        _Z + float(rng.normal(0, 0.035e-3)),
    )
    seen = pit.diameter * float(np.exp(rng.normal(0, 0.05)))
    # The camera rides on the same mount: what it saw is off by as much as the mount is.
    turned, moved = float(rng.normal(0, _ROLL_SD)), float(rng.normal(0, _ADVANCE_SD))
    known = replace(known, roll=known.roll + turned, advance=known.advance + moved)
    centre = (centre[0] + turned, centre[1] + moved)
    ear = replace(ear, mount=known)
    about = (ear, centre, seen, pit, kind == "dry", (turned, moved))
    return ScanTrial(*about, sonar=sonar, pipe=pipe, mount=true, probe=heard, rng=rng)


def scan(
    sounding: ScanTrial, *, sway: float = 1.0, points: int = RasterScan.points, pause: float = 0.8
) -> list[Burst]:
    """Scan a raster of bursts of 16 shots while the head sways.

    Parameters
    ----------
    sounding : ScanTrial
        Where.
    sway : float
        Amplitude, in degrees, at 0.3 Hz of the pan and 0.23 Hz of the tilt.
    points : int
        In a row of the raster.
    pause : float
        Between bursts, in seconds.
    """
    phase = sounding.rng.uniform(0, 2 * np.pi, 2)
    bursts = []
    for target in raster(sounding.ear, sounding.centre, points=points):
        bursts.append(_burst(sounding, target, math.radians(sway), phase))
        sounding.sonar.wait(pause)
    return bursts


def _burst(sounding: ScanTrial, target: FloatArray, sway: float, phase: FloatArray) -> Burst:
    ear, sonar = sounding.ear, sounding.sonar
    shots, read = [], []
    for _ in range(RasterScan.shots):
        turns = 2 * np.pi * np.array(_SWAY) * sonar.clock + phase
        place = target + sway * np.sin(turns)
        sonar.look(float(place[0]), float(place[1]))
        shots.append(sonar.shot())
        read.append(place + _ANGLE_NOISE * sounding.rng.standard_normal(2))
    aimed, spots = ear.spots(target)[0], ear.spots(np.array(read))
    off = wall_distance(spots[:, :2], aimed[:2], ear.radius)
    return average(shots, np.array(read), off)


@dataclass(frozen=True, eq=False)
class ScoredScan:
    """One scan beside its truth.

    Parameters
    ----------
    sounding : ScanSite
        Where.
    found : PitDepth
        What was found.
    seconds : float
        Processor time of ``measure_pit``.
    wall : DepthMap
        Fused.
    modality : str
        As the front echoes chose it.
    """

    sounding: ScanSite
    found: PitDepth
    seconds: float
    wall: DepthMap
    modality: str


def sound(sounding: ScanTrial) -> ScoredScan:
    """Scan, measure and fuse one place."""
    bursts = scan(sounding)
    target = raster(sounding.ear, sounding.centre, points=1)[0]
    sounding.sonar.look(float(target[0]), float(target[1]))
    shots = [sounding.sonar.shot() for _ in range(RasterScan.shots)]
    modality = "sonar" if wall_answers(shots, sounding.ear) else "camera"
    return examined(sounding, bursts, modality)


def examined(sounding: ScanTrial, bursts: Sequence[Burst], modality: str = "sonar") -> ScoredScan:
    """Measure and fuse the bursts of one place."""
    before = time.process_time()
    found = measure_pit(bursts, sounding.ear, sounding.centre, sounding.diameter)
    seconds = time.process_time() - before
    about = sounding.ear, sounding.centre, sounding.diameter
    wall = wall_about(found, bursts, *about, seen=sounding.picture)
    return ScoredScan(sounding.site, found, seconds, wall, modality)


def depth_figures(scored: Iterable[ScoredScan]) -> dict[str, float]:
    """Bias and deviation of the depths of pits, in micrometres, and how many were measured."""
    runs = list(scored)
    errors = np.array([1e6 * _error(run) for run in runs if run.found.measured])
    return {
        "bias_um": float(errors.mean()) if errors.size else math.nan,
        "sd_um": float(errors.std(ddof=1)) if errors.size > 1 else math.nan,
        "worst_um": float(np.abs(errors).max()) if errors.size else math.nan,
        "measured_fraction": errors.size / max(len(runs), 1),
        "measured": errors.size,
        "scans": len(runs),
        "seconds": float(np.median([run.seconds for run in runs])) if runs else math.nan,
    }


def dished_figure(scored: Iterable[ScoredScan]) -> float:
    """Largest error, in millimetres, of the mean depth of dished floors that was not flagged."""
    return max((1e3 * abs(_error(run)) for run in scored if run.found.measured), default=0.0)


def fusion_figures(scored: Iterable[ScoredScan]) -> dict[str, float]:
    """Largest errors of findings, and how often a texel lies inside its 90 % band."""
    runs = [run for run in scored if run.found.measured]
    depths = np.array([1e3 * _error(run) for run in runs])
    sizes = [run.found.diameter / run.sounding.truth.diameter - 1 for run in runs]
    texels = np.concatenate([_covered(run) for run in runs]) if runs else np.zeros(1, bool)
    return {
        "position_mm": max((1e3 * _miss(run) for run in runs), default=math.nan),
        "diameter_error_pct": 100 * float(np.abs(sizes).max()) if runs else math.nan,
        "depth_error_mm": float(np.abs(depths).max()) if runs else math.nan,
        "texel_coverage": float(texels.mean()),
    }


def band_figures(scored: Iterable[ScoredScan]) -> dict[str, float]:
    """How often the true depth lies inside the 90 % band, half its width, and of how many."""
    runs = [run for run in scored if run.found.measured]
    depths = np.array([abs(1e3 * _error(run)) for run in runs])
    bands = np.array([1e3 * PER_DEVIATION * run.found.depth_sd for run in runs])
    return {
        "coverage": float((depths <= bands).mean()) if runs else math.nan,
        "band_mm": float(np.median(bands)) if runs else math.nan,
        "scans": len(runs),
    }


def modality_wrong(scored: Iterable[ScoredScan]) -> int:
    """How often a depth was claimed in air, a hole called a pit, or the modality mistaken."""
    wrong = 0
    for run in scored:
        dry, hole = run.sounding.dry, run.sounding.truth.through
        claimed = np.isfinite(run.found.depth)
        wrong += bool((dry or hole) and claimed) or run.modality != ("camera" if dry else "sonar")
    return wrong


def _error(run: ScoredScan) -> float:
    return run.found.depth - run.sounding.depth


def _miss(run: ScoredScan) -> float:
    found, truth = run.found, run.sounding.truth
    radius = run.sounding.ear.radius
    return float(wall_distance((found.phi, found.z), (truth.phi, truth.z), radius))


def _covered(run: ScoredScan) -> BoolArray:
    """Whether the truth is inside the band, for each texel of the mouth and its rim.

    In the frame of the head as known: how far that is off counts in the position of a finding.
    """
    patch, bore = run.wall.patch, run.sounding.truth
    turned, moved = run.sounding.strayed
    off = patch.off(bore.phi + turned, bore.z + moved)
    square = (off**2).sum(axis=-1) / (bore.diameter / 2) ** 2
    floor = bore.depth + off @ np.array(bore.floor_tilt) - bore.dish * square
    truth = np.where(square <= 1, floor, 0.0)
    near = square <= (1 + 0.2e-3 / bore.diameter) ** 2
    inside: BoolArray = (np.abs(run.wall.depth - truth) <= PER_DEVIATION * run.wall.sd)[near]
    return inside
