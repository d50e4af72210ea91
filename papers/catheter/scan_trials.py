"""Pits, holes and marks drawn by seed, scanned by a probe that sways, and scored after the scan.

The estimator has the data of a real head: noisy angles, mount and water temperature with small
errors, and place and size by the camera. The scan is the procedure of mission and console.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from minorloop.arrays import BoolArray, FloatArray
from minorloop.identification.bands import PER_DEVIATION
from minorloop_head.geometry import Mount, Probe, wall_distance
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.meter import Light
from minorloop_head.procedures.scan import RasterScan, ScannedRaster, has_coupling
from minorloop_head.procedures.seen_base import SeenBase
from minorloop_head.procedures.values import NOTHING, Reading, Request, Running, apply_to_tip
from minorloop_head.reconstruction.depth_map import DepthMap, Patch
from minorloop_head.reconstruction.fusion import wall_about
from minorloop_head.sources import Shot
from minorloop_head.twins.camera import LENS
from minorloop_head.twins.pipe import Bore, Dent, Pipe, draw_dent, draw_pit
from minorloop_head.twins.rig import SimulatedTip
from minorloop_head.twins.surroundings import Sway
from minorloop_head.twins.ultrasound import Ultrasound
from minorloop_head.ultrasound.echoes import Burst
from minorloop_head.ultrasound.field import CalibratedProbe
from minorloop_head.ultrasound.pits import PitDepth, measure_pit
from minorloop_head.vision.calibrated_camera import Image
from papers.harness import Results, Study, deviation, mean, median

JOINT_NOISE = GYROSCOPE_NOISE = math.radians(0.05)
"""Standard deviations of a reading of a joint, as in a mission, and of a gyroscope in the base."""
SWAY, PHASES = Sway(), 1e3
"""Motion of the base in the flow, and range of times in it at which a scan begins, in seconds."""
FLOODED = -9.999e-3
"""Height of the water of a full pipe, in metres."""
CAMERA_SD = 0.035e-3
"""Standard deviation of a place by the camera, around and along the pipe, in metres."""
_Z, _TICK = 20e-3, 0.04
"""Place of the pits along the pipe in metres, and interval of the loop in seconds."""


@dataclass(frozen=True, eq=False)
class ScanSite:
    """Truth of a place of a pipe. For scoring only."""

    truth: Bore
    dry: bool
    """Whether there is no water."""
    strayed: tuple[float, float] = (0.0, 0.0)
    """Known minus true roll and advance of the mount."""

    @property
    def depth(self) -> float:
        """True mean depth of the floor, in metres."""
        return self.truth.depth - self.truth.dish / 2


def draw_trial(
    seed: int,
    *,
    kind: str = "pit",
    lens: bool = True,
    bore: Bore | None = None,
    pose: str = "camera",
) -> Results:
    """Draw a pit of 0.85 to 1.5 mm by 0.2 to 1 mm, or another defect, in a pipe by seed.

    ``kind`` is "pit" with a flat floor; "dished", a pit that is 0.1 mm shallower at its rim;
    "dented", in or beside a dent; "hole", through the wall; "mark", a spot of dirt; or "dry", a pit
    in a dry pipe. ``lens``: whether the probe has its lens. Diameter and depth of a ``bore``
    replace the drawn ones. ``pose`` and the results are as of `scan`; beside them there are the
    ``temperature`` of the water, the ``diameter`` by the camera in metres, and the true ``site``.
    """
    rng = np.random.default_rng([seed, 77])
    phi = float(rng.uniform(-np.pi, np.pi))
    pit = draw_pit(rng, phi, _Z)
    if bore is not None:
        pit = replace(pit, diameter=bore.diameter, depth=bore.depth)
    dish, deep = 0.1e-3 if kind == "dished" else 0.0, math.inf if kind == "hole" else pit.depth
    pit = replace(pit, dish=dish, depth=deep)
    transducer = Probe() if lens else Probe(focus=math.inf)
    true, probe, thickness, warm = draw_probe(rng, phi, _Z, transducer)
    pipe = Pipe(
        bores=() if kind == "mark" else (pit,),
        dents=(_dent_beside(pit, np.random.default_rng([seed, 78])),) if kind == "dented" else (),
        water=None if kind == "dry" else FLOODED,
        thickness=thickness,
    )
    # The noise is that of the transducer, whatever the pit.
    twin = Ultrasound(pipe, true, transducer, temperature=warm, specimen=seed, seed=seed)
    around, along = (float(rng.normal(0, CAMERA_SD)) for _ in range(2))
    seen = pit.diameter * float(np.exp(rng.normal(0, 0.05)))
    # The camera has the same mount, so that its places have the error of the mount.
    probe, (turned, moved) = strayed(rng, probe)
    centre = (phi + around / pipe.radius + turned, _Z + along + moved)
    return Results(
        probe=probe, centre=centre, diameter=seen, twin=twin, pipe=pipe, mount=true, rng=rng,
        temperature=warm, pose=pose, specimen=seed,
        site=ScanSite(pit, kind == "dry", (turned, moved)),
    )  # fmt: skip


def _dent_beside(pit: Bore, rng: np.random.Generator) -> Dent:
    """Draw a dent that a pit is in or beside; no bead."""
    # Up to where the widest one slopes most, and a raster.
    way, off = rng.uniform(-np.pi, np.pi), 2.5e-3 * math.sqrt(rng.uniform())
    phi, z = pit.phi + off * math.cos(way) / Pipe.radius, pit.z + off * math.sin(way)
    while (dent := draw_dent(rng, float(phi), float(z))).height > 0:
        pass
    return dent


def draw_probe(
    rng: np.random.Generator, phi: float, z: float, transducer: Probe
) -> tuple[Mount, CalibratedProbe, float, float]:
    """Return true mount, calibrated probe, thickness of the wall and temperature of the water.

    The probe is before a place; its calibration has small errors.
    """
    thickness = float(rng.uniform(1.5e-3, 4e-3))
    off = rng.uniform(-0.2e-3, 0.2e-3, 2)
    roll = phi + float(rng.normal(0, 0.02))
    true = Mount(
        offset=(float(off[0]), float(off[1])), roll=roll, advance=z + float(rng.normal(0, 0.1e-3))
    )
    guess = off + rng.normal(0, 0.05e-3, 2)
    known = replace(true, offset=(float(guess[0]), float(guess[1])))
    warm = float(rng.uniform(12, 30))
    probe = CalibratedProbe(
        transducer,
        known,
        thickness=thickness * float(rng.uniform(0.97, 1.03)),
        temperature=warm + float(rng.normal(0, 0.3)),
    )
    return true, probe, thickness, warm


def strayed(
    rng: np.random.Generator, probe: CalibratedProbe
) -> tuple[CalibratedProbe, tuple[float, float]]:
    """Return a probe with an error of its roll and advance, and this error, in rad and m."""
    turned, moved = float(rng.normal(0, 5e-3)), float(rng.normal(0, 0.05e-3))
    known = probe.mount
    known = replace(known, roll=known.roll + turned, advance=known.advance + moved)
    return replace(probe, mount=known), (turned, moved)


def scan(trial: Results) -> tuple[CalibratedProbe, tuple[Burst, ...]]:
    """Scan a raster by the procedure of mission and console, while flow sways the head.

    The calibrated ``probe`` is before a place of a ``pipe`` with water, if any, which has phi and z
    ``centre`` by the camera. ``twin`` is the true probe on the true ``mount``; ``rng`` draws sway,
    noise of the angles, and picture; ``specimen`` is the seed of camera and wall. ``pose`` is the
    source of the pose of a burst besides the joints: "camera" for pictures, "gyroscope" for one in
    the base, or "joints" without one.

    Joints and catheter follow at once; the joints are measured with noise. The returned probe is at
    the place of the scan.
    """
    head = _Head(trial)
    made, request = ScannedRaster(), NOTHING
    scan = RasterScan(calibration=head.view).scan(made, trial.centre, light=head.light)
    running = Running(scan, lambda request: None)
    while not running.done:
        request = running.advance(head.reading(request))
        trial.twin.wait(_TICK)
    return head.view.probe_at(made.reference), made.bursts


class _Head:
    """A head before the place of a trial, which sways once the pipe is flooded.

    ``view`` is its known calibration; ``light`` that of its camera, None without a camera.
    """

    def __init__(self, trial: Results) -> None:
        self._trial, self._wet = trial, False
        self._place = self._start = np.array([trial.probe.mount.advance, trial.probe.mount.roll])
        self._joints, self._begin = np.zeros(2), float(trial.rng.uniform(0.0, PHASES))
        self.view = _calibration(trial.probe)
        self.light: Light | None = None
        self._base: SeenBase | None = None
        if trial.pose != "camera":
            return
        wall, seed = Pipe.draw(trial.specimen), trial.specimen
        wall = replace(wall, bores=trial.pipe.bores, cracks=trial.pipe.cracks)
        optics = LENS.scaled(0.5)
        self._tip = SimulatedTip(wall, mount=trial.mount, specimen=seed, seed=seed, optics=optics)
        camera = self._tip.camera
        self.view = replace(self.view, lens=camera.calibration, leds=camera.leds)
        self.light, self._base = Light(), SeenBase(self.view)

    def reading(self, request: Request) -> Reading:
        """Carry out a request, and read joints, catheter, and the other source of the pose."""
        trial, rng = self._trial, self._trial.rng
        t = trial.twin.clock
        self._joints = self._joints if request.angles is None else request.angles
        self._place = self._place + _TICK * request.rates
        angles = self._joints + JOINT_NOISE * rng.standard_normal(2)
        image = self._picture(request, t, angles)
        shots = self._shots(request.shots)
        base = self._turned(t, image if shots else None)
        return Reading(
            t=t, angles=angles, place=self._place, base=base, image=image, shots=tuple(shots),
            fired=bool(shots),
        )  # fmt: skip

    def _sway(self, t: float) -> FloatArray:
        """Return the true turn (2,) of the base."""
        return SWAY.at(self._begin + t) if self._wet else np.zeros(2)

    def _shots(self, count: int) -> list[Shot]:
        trial, (advance, roll) = self._trial, (self._place - self._start).tolist()
        true, shots = trial.mount, []
        trial.twin.move(replace(true, advance=true.advance + advance, roll=true.roll + roll))
        for _ in range(count):
            pan, tilt = self._joints + self._sway(trial.twin.clock)
            trial.twin.look(float(pan), float(tilt))
            shots.append(trial.twin.shot())
        return shots

    def _picture(self, request: Request, t: float, angles: FloatArray) -> Image | None:
        """Set camera and water as requested, and take a picture if there is one to take.

        The last one before the water comes in is that of the base at rest.
        """
        flooding = bool(request.water) and not self._wet
        image = None
        if self._base is not None:
            now = self._joints + self._sway(t)
            rates = (self._joints + self._sway(t + _TICK) - now) / _TICK
            place = self._place - self._start
            self._tip.move_to((*now.tolist(), *rates.tolist(), *place.tolist()))
            self._base.read(t, angles, self._place)
            apply_to_tip(self._tip, replace(request, water=None))
            image = self._tip.frame().image if request.frame or flooding else None
            if flooding and image is not None:
                self._base.begin(image, t)
        self._wet = self._wet or flooding
        return image

    def _turned(self, t: float, image: Image | None) -> FloatArray:
        """Return the measured turn (2,) of the base; zeros by the joints alone."""
        if self._base is not None and self._wet:
            if image is not None:
                self._base.see(image, t)
            return self._base.at(t)
        if self._trial.pose != "gyroscope":
            return np.zeros(2)
        return np.asarray(self._sway(t) + GYROSCOPE_NOISE * self._trial.rng.standard_normal(2))


def _calibration(probe: CalibratedProbe) -> HeadCalibration:
    """Return the calibration of a head with this probe in this pipe."""
    return HeadCalibration(
        lens=LENS, leds=np.empty((0, 3)), offset=probe.mount.offset, lever=probe.mount.lever,
        probe=probe.transducer, radius=probe.radius, thickness=probe.thickness,
        temperature=probe.temperature,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class ScoredScan:
    """One scan with its truth."""

    site: ScanSite
    found: PitDepth
    seconds: float
    """Processor time of ``measure_pit``."""
    wall: DepthMap
    """Fused."""
    modality: str
    """Modality by the first burst."""

    @property
    def error(self) -> float:
        """Error of the depth, in metres."""
        return self.found.depth - self.site.depth

    @property
    def miss(self) -> float:
        """Distance of the place from the true one, in metres."""
        found, truth = self.found, self.site.truth
        places = (found.phi, found.z), (truth.phi, truth.z)
        return float(wall_distance(*places, Pipe.radius))


def run_trial(trial: Results) -> ScoredScan:
    """Scan, measure and fuse one place."""
    trial.probe, bursts = scan(trial)
    return measured(trial, bursts, "ultrasound" if has_coupling(bursts) else "camera")


def measured(trial: Results, bursts: Sequence[Burst], modality: str = "ultrasound") -> ScoredScan:
    """Measure and fuse the bursts of one place."""
    before = time.process_time()
    about = trial.probe, trial.centre, trial.diameter
    found = measure_pit(bursts, *about)
    seconds = time.process_time() - before
    wall = wall_about(found, bursts, *about, seen=partial(_picture, trial))
    return ScoredScan(trial.site, found, seconds, wall, modality)


def _picture(trial: Results, patch: Patch) -> FloatArray:
    """Return the logarithm (rows, columns) of the unrolled image with a dark mouth.

    Place and size have the camera's errors; edges are a texel wide, and each texel has its noise.
    """
    off = np.linalg.norm(patch.off(*trial.centre), axis=-1)
    dark = 1 / (1 + np.exp(np.clip((off - trial.diameter / 2) / 0.05e-3, -30.0, 30.0)))
    return np.asarray(-1.2 * dark + 0.08 * trial.rng.standard_normal(off.shape))


def depth_figures(scored: Iterable[ScoredScan]) -> dict[str, float]:
    """Return bias and standard deviation of depths in micrometres, and the number measured."""
    runs = list(scored)
    errors = np.array([1e6 * run.error for run in runs if run.found.measured])
    return {
        "bias_um": mean(errors),
        "sd_um": deviation(errors),
        "worst_um": max(np.abs(errors).tolist(), default=math.nan),
        "measured_fraction": errors.size / max(len(runs), 1),
        "measured": errors.size,
        "scans": len(runs),
        "seconds": median([run.seconds for run in runs]),
    }


def fusion_figures(scored: Iterable[ScoredScan]) -> dict[str, float]:
    """Return the largest errors of findings, and the share of texels inside their 90 % band."""
    runs = [run for run in scored if run.found.measured]
    sizes = [100 * abs(run.found.diameter / run.site.truth.diameter - 1) for run in runs]
    texels = np.concatenate([_covered(run) for run in runs]) if runs else np.zeros(1, bool)
    return {
        "position_mm": max((1e3 * run.miss for run in runs), default=math.nan),
        "diameter_error_pct": max(sizes, default=math.nan),
        "depth_error_mm": depth_figures(runs)["worst_um"] / 1e3,
        "texel_coverage": float(texels.mean()),
    }


def band_figures(scored: Iterable[ScoredScan]) -> dict[str, float]:
    """Return the share of depths inside their 90 % band, half its width, and their number."""
    runs = [run for run in scored if run.found.measured]
    depths = np.array([abs(1e3 * run.error) for run in runs])
    bands = np.array([1e3 * PER_DEVIATION * run.found.depth_sd for run in runs])
    return {
        "coverage": mean(depths <= bands),
        "band_mm": median(bands),
        "scans": len(runs),
    }


def modality_wrong(scored: Iterable[ScoredScan]) -> int:
    """Return the number of depths in air or of holes, and of wrong modalities."""
    wrong = 0
    for run in scored:
        dry, hole = run.site.dry, run.site.truth.through
        made_up = bool((dry or hole) and np.isfinite(run.found.depth))
        wrong += made_up or run.modality != ("camera" if dry else "ultrasound")
    return wrong


def _covered(run: ScoredScan) -> BoolArray:
    """Return for each texel of the mouth and its rim whether the truth is inside the band.

    The frame is the known one of the head: its error counts in the position of a finding.
    """
    patch, bore = run.wall.patch, run.site.truth
    turned, moved = run.site.strayed
    off = patch.off(bore.phi + turned, bore.z + moved)
    square = (off**2).sum(axis=-1) / (bore.diameter / 2) ** 2
    floor = bore.depth + off @ np.array(bore.floor_tilt) - bore.dish * square
    truth = np.where(square <= 1, floor, 0.0)
    near = square <= (1 + 0.2e-3 / bore.diameter) ** 2
    inside: BoolArray = (np.abs(run.wall.depth - truth) <= PER_DEVIATION * run.wall.sd)[near]
    return inside


SCANS = 6
"""Flat pits for each specimen; the last has the size for the score of fusion."""


def run_scans(seed: int, scans: int = SCANS) -> dict[str, Any]:
    """Scan pits with a flat floor, and places where there is no depth.

    ``scored`` are the scans by the kind of place, or by the source of the pose.
    """
    first = 60_000 + (scans + 4) * seed
    drawn = {
        "pit": [draw_trial(first + 4 + k) for k in range(max(scans - 1, 1))],
        "fused": [draw_trial(first, bore=Bore(0.0, 0.0, 1e-3, depth=0.5e-3))],
        "gyroscope": [draw_trial(first + 4, pose="gyroscope")],
        "joints": [draw_trial(first + 4, pose="joints")],
        "unfocused": [draw_trial(first + 4, lens=False)],
        "dished": [draw_trial(first + 1, kind="dished")],
        "dented": [draw_trial(first + 1, kind="dented")],
        "hole": [draw_trial(first + 2, kind="hole")],
        "dry": [draw_trial(first + 3, kind="dry")],
    }
    return {"scored": {kind: tuple(map(run_trial, each)) for kind, each in drawn.items()}}


def gather(runs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return bias, deviation and bands of the depths of all specimens, and of false depths."""
    kinds = {
        kind: [one for run in runs for one in run["scored"][kind]] for kind in runs[0]["scored"]
    }
    return {
        "depth": {
            **depth_figures(kinds["pit"]),
            **{
                f"{kind}_{key}": value
                for kind in ("gyroscope", "joints", "unfocused", "dented")
                for key, value in depth_figures(kinds[kind]).items()
            },
            "dished_error_mm": depth_figures(kinds["dished"])["worst_um"] / 1e3,
            "seconds_worst": max(one.seconds for each in kinds.values() for one in each),
        },
        "fusion": {
            **fusion_figures(kinds["fused"]),
            **band_figures([*kinds["pit"], *kinds["fused"]]),
        },
        "modality": {
            "wrong": modality_wrong([*kinds["hole"], *kinds["dry"]]),
            "scans": len(kinds["hole"]) + len(kinds["dry"]),
        },
    }


STUDY = Study("scans", "Depths of pits by ultrasound", run_scans, gather)
