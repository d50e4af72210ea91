"""Sweeps of partly flooded pipes drawn by seed, whose finds are scored after the sweep.

The estimator has the data of a real head: noisy angles, mount and water temperature with small
errors, and readings of the catheter. The sweep is the procedure of any loop.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from minorloop.arrays import BoolArray, FloatArray
from minorloop.identification.bands import PER_DEVIATION
from minorloop.threads import one_thread
from minorloop_head.geometry import Mount, Probe, wall_distance
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.meter import Light, meter
from minorloop_head.procedures.probe_steps import resampled
from minorloop_head.procedures.sweep import ProbeSweep, SweptArea
from minorloop_head.procedures.values import NOTHING, Reading, Running, apply_to_tip
from minorloop_head.reconstruction.depth_map import (
    BOTH,
    CAMERA,
    ECHOES,
    DepthMap,
    Patch,
    camera_map,
    coupled_at,
)
from minorloop_head.twins.catheter import Catheter
from minorloop_head.twins.pipe import Bore, Crack, Dent, Pipe, draw_crack, draw_pit
from minorloop_head.twins.rig import SimulatedTip
from minorloop_head.twins.surroundings import Filling
from minorloop_head.twins.ultrasound import INTERVAL
from minorloop_head.ultrasound.c_scan import CRACK, CUT, PIT, CScan, EchoFind, c_scan
from minorloop_head.vision.reflectance_map import LitFrame, lay_flat
from papers.catheter import scoring
from papers.catheter.crack_scenes import FINE, fine_course
from papers.catheter.scan_trials import GYROSCOPE_NOISE, JOINT_NOISE, PHASES, SWAY
from papers.harness import Results, Study, deviation, mean, median

PITS = 3
"""Pits in the swept part of a pipe: 0.8 to 1.5 mm wide and 0.3 to 1 mm deep."""
AROUND, ALONG = (-0.2, math.pi + 0.2), (20e-3, 22.4e-3)
"""Swept part of the pipe in radians and metres: the flooded half, with some drained wall."""
SAME = 0.5e-3
"""Largest distance in metres of a find from its defect."""
_APART = 2.5e-3
"""Distance of pits in metres from each other and from the crack."""
_UNITS = np.array([1e-3, math.radians(1.0)])
_VIEWS = 8
"""Views of the camera to all sides."""


@dataclass(frozen=True, eq=False)
class ScoredSweep:
    """One sweep with its truth."""

    scan: CScan
    fused: CScan
    """Map fused with the pictures of the drained part."""
    picture: FloatArray
    """The pictures, as of `pipe_map`."""
    pipe: Pipe
    """For scoring only."""
    level: float
    """Height of the water in metres. For scoring only."""
    seconds: float
    """Duration from the first line to the last, in seconds of the head."""


def draw_sweep(seed: int, pits: int = PITS) -> Results:
    """Draw a pipe with pits and a crack under water, and a head in it, by seed.

    The ``tip`` has camera and probe, ``calibration`` is the known one; ``rng`` is of the noise of
    joints and gyroscope, and of the sway; ``pipe``, and ``level``, the height of the water in
    metres, are for scoring only.
    """
    rng = np.random.default_rng([seed, 41])
    drawn = Pipe.draw(seed)
    bores: list[Bore] = []
    while len(bores) < pits:
        phi, z = _somewhere(rng)
        one = replace(
            draw_pit(rng, phi, z),
            diameter=float(rng.uniform(0.8e-3, 1.5e-3)),
            depth=float(rng.uniform(0.3e-3, 1e-3)),
        )
        if _is_clear(one, bores, drawn.dents):
            bores.append(one)
    crack = draw_crack(rng, *_somewhere(rng))
    while any(_off(crack, bore) < _APART for bore in bores):
        crack = draw_crack(rng, *_somewhere(rng))
    thickness = float(rng.uniform(1.5e-3, 4e-3))
    pipe = replace(drawn, bores=tuple(bores), cracks=(crack,), thickness=thickness)
    off, warm = rng.uniform(-0.2e-3, 0.2e-3, 2), float(rng.uniform(10, 40))
    known = off + rng.normal(0, 0.05e-3, 2)
    # About half full; wherever there is a pit, the probe is under water too.
    level = float(rng.uniform(-1.5e-3, 0.4e-3))
    tip = SimulatedTip(
        pipe,
        mount=Mount(offset=(float(off[0]), float(off[1]))),
        specimen=seed,
        seed=seed,
        flooded=Filling(level=level, temperature=warm),
        # Motion in which the twin's echo is not computed again: an eighth of the beam.
        probe={"settle": 0.03e-3},
    )
    calibration = HeadCalibration(
        lens=tip.camera.calibration,
        leds=tip.camera.leds,
        offset=(float(known[0]), float(known[1])),
        thickness=thickness * float(rng.uniform(0.97, 1.03)),
        temperature=warm + float(rng.normal(0, 0.3)),
    )
    return Results(
        calibration=calibration, tip=tip, catheter=Catheter(seed, 0.02, seed), rng=rng,
        pipe=pipe, level=level,
    )  # fmt: skip


def _somewhere(rng: np.random.Generator) -> tuple[float, float]:
    """Draw a phi and a z in the swept part under water, 0.8 mm or more from its ends."""
    low, high = ALONG
    phi = float(rng.uniform(0.35, np.pi - 0.35))
    return phi, float(rng.uniform(low + 0.8e-3, high - 0.8e-3))


def _is_clear(one: Bore, others: Sequence[Bore], dents: Sequence[Dent]) -> bool:
    """Return whether a pit is beside all others and all dents.

    A dent is shallower than 30 um there: a pit in a dent is another defect.
    """
    return all(_apart(one, pit) > _APART for pit in others) and all(
        _apart(one, dent) > one.diameter / 2 + 2.5 * dent.size for dent in dents
    )


def _apart(one: Any, other: Any) -> float:
    """Return the distance on the wall in metres of two objects with a place."""
    return float(wall_distance((one.phi, one.z), (other.phi, other.z), Pipe.radius))


def _off(crack: Crack, other: Any) -> float:
    """Return the distance in metres of an object with a place from the course of a crack."""
    course, _ = fine_course(crack, Pipe.radius)
    return float(wall_distance(course, (other.phi, other.z), Pipe.radius).min())


@one_thread()
def sweep(
    trial: Results,
    around: tuple[float, float] = AROUND,
    along: tuple[float, float] = ALONG,
) -> SweptArea:
    """Sweep by the procedure, while flow sways the head and friction holds the catheter.

    The joints follow at once; joints, base and catheter are measured with noise.
    """
    scanning = ProbeSweep(calibration=trial.calibration)
    area, request = scanning.area(around, along), NOTHING
    running = Running(scanning.sweep(area), lambda request: None)
    tip, rng, catheter = trial.tip, trial.rng, trial.catheter
    joints, begin = np.zeros(2), float(rng.uniform(0.0, PHASES))
    place, ticks = np.zeros(2), 0
    before = now = scoring.catheter_place(catheter)
    while not running.done:
        t = ticks * catheter.tick
        joints = joints if request.angles is None else request.angles
        apply_to_tip(tip, replace(request, frame=False))
        shots = []
        for k in range(request.shots):
            late = k * INTERVAL
            here = now + late * (now - before) / catheter.tick
            tip.move_to((*(joints + SWAY.at(begin + t + late)), 0.0, 0.0, *here))
            shots += tip.shots(1)
        angles = joints + JOINT_NOISE * rng.standard_normal(2)
        base = SWAY.at(begin + t) + GYROSCOPE_NOISE * rng.standard_normal(2)
        reading = Reading(
            t=t, angles=angles, place=place, base=base, shots=tuple(shots), fired=bool(shots)
        )
        request = running.advance(reading)
        before, place = now, np.asarray(catheter.exchange(request.rates / _UNITS)) * _UNITS
        now = scoring.catheter_place(catheter)
        ticks += 1
    return area


def pictures(trial: Results, patch: Patch) -> list[FloatArray]:
    """Return pictures of a patch in views to all sides, before the sweep.

    It looks 25 degrees off the axis, from 4.5 mm, where the views show the swept part.
    """
    tip, rng, seen = trial.tip, trial.rng, []
    for k in range(_VIEWS):
        way = 2 * math.pi * k / _VIEWS
        true = math.radians(25.0) * np.array([math.cos(way), math.sin(way)])
        angles = true + JOINT_NOISE * rng.standard_normal(2)
        place, request, ticks = np.array([4.5e-3, 0.0]), NOTHING, 0
        metering = Running(meter(trial.calibration, Light()), partial(apply_to_tip, tip))
        while not metering.done:
            tip.move_to((*true, 0.0, 0.0, *place))
            image = tip.frame().image if request.frame else None
            reading = Reading(
                t=ticks * trial.catheter.tick, angles=angles, place=place, image=image
            )
            request = metering.advance(reading)
            ticks += 1
        tip.move_to((*true, 0.0, 0.0, *place))
        frame = LitFrame(tip.frame().image, *angles.tolist())
        view = lay_flat([frame], trial.calibration.camera_at(place))
        seen += [] if view is None else [resampled(view, patch)]
    return seen


def pipe_map(scan: CScan, views: Sequence[FloatArray]) -> tuple[CScan, FloatArray]:
    """Merge the map of a sweep with pictures; return it, and the pictures merged (rows, columns).

    Views (rows, columns) are logarithms of the reflectance on the patch of the sweep, such as
    `resampled` returns; NaN where unknown. Water refracts a picture, so that the camera counts only
    above the water line. Echoes extend above it by the width of the beam, where both sources
    overlap. Views under other lights differ by the constant of their medians.
    """
    patch = scan.wall.patch
    total, count = (np.zeros(scan.amplitude.shape) for _ in range(2))
    drained = ~scan.water.wet(patch.places[..., 0], patch.radius)
    for view in views:
        seen = np.isfinite(view) & drained
        if seen.any():
            total[seen] += view[seen] - np.median(view[seen])
            count[seen] += 1
    picture = np.divide(total, count, out=np.full_like(total, np.nan), where=count > 0)
    camera = camera_map(patch, count > 0, np.zeros(count.shape))
    return replace(scan, wall=blend(camera, scan.wall)), picture


def blend(first: DepthMap, second: DepthMap) -> DepthMap:
    """Merge two maps of one patch: by inverse variance where both have data."""
    assert first.patch == second.patch, "the maps are of different patches"
    with np.errstate(divide="ignore", invalid="ignore"):
        weights = [np.where(np.isnan(m.depth), 0.0, 1 / m.sd**2) for m in (first, second)]
        total = weights[0] + weights[1]
        depth = sum(
            np.where(weight > 0, weight * np.nan_to_num(m.depth, posinf=0.0), 0.0)
            for weight, m in zip(weights, (first, second), strict=True)
        ) / np.where(total > 0, total, np.nan)
        sd = np.where(total > 0, 1 / np.sqrt(total), np.inf)
    through = np.isposinf(first.depth) | np.isposinf(second.depth)
    depth = np.where(through, np.inf, depth)
    source = (first.source | second.source).astype(np.uint8)
    return DepthMap(first.patch, depth, np.where(through, np.nan, sd), source)


def run_study(seed: int) -> dict[str, ScoredSweep]:
    """Look at the drained part of a pipe, sweep the flooded one, and map both."""
    trial = draw_sweep(seed)
    bursts, patch = sweep(trial).bursts, Patch.ring(*ALONG)
    scan = c_scan(bursts, trial.calibration.probe_at((0.0, 0.0)), patch)
    maps = pipe_map(scan, pictures(trial, patch))
    seconds = bursts[-1].t - bursts[0].t
    return {"sweep": ScoredSweep(scan, *maps, trial.pipe, trial.level, seconds)}


def pit_found(run: ScoredSweep, bore: Bore) -> EchoFind | None:
    """Return the pit of a map that is nearest to a true one; None if none is near."""
    pits = [find for find in run.scan.finds if find.kind == PIT]
    off = [_apart(find, bore) for find in pits]
    return pits[int(np.argmin(off))] if off and min(off) <= SAME else None


def on_crack(run: ScoredSweep, find: EchoFind) -> bool:
    """Return whether a find is on a true crack."""
    return any(_off(crack, find) <= SAME for crack in run.pipe.cracks)


def on_pit(run: ScoredSweep, find: EchoFind) -> bool:
    """Return whether a find is on a true pit."""
    return any(_apart(find, bore) <= SAME for bore in run.pipe.bores)


def within_reach(run: ScoredSweep, crack: Crack) -> bool:
    """Return whether the sweep passed over 1.5 mm of a crack under water, 0.1 mm wide or more.

    A narrower crack takes so little of the echo that bursts between two lines miss it.
    """
    patch = run.scan.wall.patch
    course, widths = fine_course(crack, patch.radius)
    wet = coupled_at(course[:, 0], patch.radius, face=Probe().face) > run.level + SAME
    along = (course[:, 1] - patch.z) / patch.step
    inside = wet & (along >= 0) & (along < patch.rows) & (widths >= 0.1e-3)
    return bool(FINE * inside.sum() >= 1.5e-3)


def true_depth(pipe: Pipe, patch: Patch) -> FloatArray:
    """Return the depth (rows, columns) of a pipe with its dents and beads, in metres."""
    places = patch.places
    depth = pipe.depth(places[..., 0], places[..., 1])
    for dent in pipe.dents:
        off = wall_distance(places, (dent.phi, dent.z), pipe.radius)
        depth = depth - dent.height * np.exp(-0.5 * (off / dent.size) ** 2)
    return depth


def _inside(run: ScoredSweep, source: int) -> BoolArray:
    """Return whether the true depth is inside the 90 % band, for each texel of a source."""
    wall = run.fused.wall
    known = (wall.source == source) & np.isfinite(wall.depth)
    off = np.abs(wall.depth - true_depth(run.pipe, wall.patch))
    return np.asarray((off <= PER_DEVIATION * wall.sd)[known])


def map_figures(runs: Sequence[ScoredSweep]) -> dict[str, float]:
    """Return the shares of texels of the maps whose 90 % band has the true depth, by source."""
    every = {
        name: np.concatenate([_inside(run, source) for run in runs])
        for name, source in (("camera", CAMERA), ("echoes", ECHOES), ("both", BOTH))
    }
    every["map"] = np.concatenate(list(every.values()))
    return {f"{name}_coverage": mean(each) for name, each in every.items()}


def gather(results: Sequence[Mapping[str, ScoredSweep]]) -> dict[str, dict[str, float]]:
    """Return recall, false finds, errors, and the mapped share with its time, of several pipes.

    A find without a pit or a crack is false; a pit found as a crack, or a crack found as a pit, is
    of the wrong kind. A find cut by the edge does not count. A crack counts as found if a part of
    it is found.
    """
    runs = [each["sweep"] for each in results]
    pits = [(pit_found(run, bore), bore) for run in runs for bore in run.pipe.bores]
    hits = [(find, bore) for find, bore in pits if find is not None]
    every = [(run, find) for run in runs for find in run.scan.finds]
    finds = [one for one in every if one[1].kind != CUT]
    errors = 1e6 * np.array([find.depth - bore.depth for find, bore in hits])
    bands = 1e6 * PER_DEVIATION * np.array([find.depth_sd for find, _ in hits])
    off = [1e3 * _apart(find, bore) for find, bore in hits]
    mapped = sum(float(np.isfinite(run.scan.amplitude).sum()) for run in runs)
    gaps = sum(float(run.scan.gap.sum()) for run in runs)
    area = 1e4 * mapped * runs[0].scan.wall.patch.step ** 2
    cracks = [
        any(find.kind == CRACK and on_crack(run, find) for find in run.scan.finds)
        for run in runs
        if any(within_reach(run, crack) for crack in run.pipe.cracks)
    ]
    found = {
        "recall": len(hits) / max(len(pits), 1),
        "pits": len(pits),
        "false_per_cm2": sum(not (on_pit(*one) or on_crack(*one)) for one in finds) / area,
        "wrong_kind": sum(
            on_crack(run, find) if find.kind == PIT else on_pit(run, find) for run, find in finds
        ),
        "area_cm2": area,
        "seconds_per_cm2": sum(run.seconds for run in runs) / area,
        "gap_share": gaps / (mapped + gaps),
        "depth_bias_um": mean(errors),
        "depth_sd_um": deviation(errors),
        "coverage": mean(np.abs(errors) <= bands),
        "size_ratio": median([find.diameter / bore.diameter for find, bore in hits]),
        "place_mm": float(np.quantile(off, 0.9)) if hits else math.nan,
        "crack_recall": mean(cracks),
        "cracks": len(cracks),
        "cut": len(every) - len(finds),
        "water_mm": max(1e3 * abs(run.scan.water.height - run.level) for run in runs),
        **map_figures(runs),
    }
    return {"cscan": found}


STUDY = Study("sweeps", "Sweeps of half-flooded pipes", run_study, gather)
