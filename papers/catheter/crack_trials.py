"""Detection of cracks, on scenes that are not those of the fit of the weights of the evidence.

Each seed gives a wall with a crack and one without, with the same kinds of marks. Courses are
compared on the map of the calibrated camera, whose pivot and angles have the errors of the scenes
with holes. Only the part of a crack on this map counts.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.stats import chi2

from minorloop.arrays import BoolArray, FloatArray
from minorloop.identification.bands import PER_DEVIATION
from minorloop_head.geometry import Probe
from minorloop_head.procedures.trace import between, traces_of, widest
from minorloop_head.twins.pipe import Crack, Pipe
from minorloop_head.twins.ultrasound import Ultrasound
from minorloop_head.ultrasound.crack_depth import CrackDepth, crack_depth
from minorloop_head.vision.calibrated_camera import CalibratedCamera, Window
from minorloop_head.vision.cracks import TracedCrack
from minorloop_head.vision.defects import Findings, find_holes
from papers.catheter import scoring
from papers.catheter.crack_scenes import FINE, draw_crack_view, fine_course
from papers.catheter.detection import misjudged, shots, wilson
from papers.catheter.scan_trials import CAMERA_SD, FLOODED, draw_probe, scan, strayed
from papers.catheter.scene_view import SceneView
from papers.harness import Results, mean, median

SAME = 0.2e-3
"""Required distance in metres within which two courses are the same."""
SHARE = 0.5
"""Share of the course of a found crack that is within `SAME` of a trace; a trace is false if less
than this share of it is within `SAME` of the crack."""
CLASSES = {"100um": (100e-6, math.inf), "50um": (50e-6, 100e-6), "30um": (0.0, 50e-6)}
"""Required classes of width in metres."""


@dataclass(frozen=True)
class CrackOutcome:
    """Result of one scene."""

    seed: int
    width: float
    """Drawn width of the crack in metres; 0 without a crack."""
    found: bool
    shares: tuple[float, float]
    """Shares of the drawn course that was traced, and of the trace that is on the drawn course."""
    length_error: float
    width_error: float
    """Relative error of the length, and error of the median width in metres; NaN if not found."""
    false: int
    """Number of false findings."""
    scan: str = ""
    """Verdict of the scan across it; empty without one."""
    depth_error: float = math.nan
    """Error of the depth by the scan, in metres; NaN without a depth."""
    width_sd: float = math.nan
    """Stated standard deviation of the width, in metres; NaN if not found."""


def search_cracks(seed: int, crack: bool, *, lit: bool = False) -> Results:
    """Take an acquisition of one scene by its calibrated camera, and trace its cracks.

    ``findings`` are holes and the map; ``course`` (N, 2) is phi and z of the visible part of the
    crack on the same map, in steps of 50 um, empty without one; ``widths`` (N,) are the true ones
    there, in metres.
    """
    view = draw_crack_view(seed, crack=crack, lit=lit)
    rng = np.random.default_rng([seed, int(crack), 22])
    camera = misjudged(view, rng)
    frames = tuple(shots(view, rng))
    found = find_holes(frames, camera)
    traces = traces_of(found, camera.radius)
    course, widths = _visible(view, camera, found)
    return Results(
        view=view, camera=camera, frames=frames, traces=traces, findings=found, course=course,
        widths=widths,
    )  # fmt: skip


def score_cracks(seed: int, crack: bool, *, scan: bool = False, lit: bool = False) -> CrackOutcome:
    """Search one scene, scan across the found crack, and compare with the truth."""
    search = search_cracks(seed, crack, lit=lit)
    outcome = outcome_of(seed, search)
    if not (scan and outcome.found):
        return outcome
    best = max((trace for trace, _ in _right(search)), key=lambda trace: trace.length)
    view, camera = search.view, search.camera
    true = replace(camera, lens=scoring.true_lens(view.camera), mount=view.mount)
    pixels = camera.pixel(best.places, view.pan, view.tilt)
    places = true.place(pixels, view.pan, view.tilt)
    found = scanned_depth(seed, view.pipe.cracks, best, places)
    error = found.depth - view.pipe.cracks[0].depth
    return replace(outcome, scan=found.verdict, depth_error=error)


def scanned_depth(
    seed: int, cracks: tuple[Crack, ...], traced: TracedCrack, places: FloatArray
) -> CrackDepth:
    """Scan across a crack where it is widest, with the noise of a mission, and measure its depth.

    One of the true ``cracks`` is ``traced``; ``places`` (N, 2) are those of the trace, corrected
    for the error of the mount in the acquisition: the scan has its own mount with its own error,
    which the camera shares.
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
    trial = Results(
        probe=probe, centre=centre, twin=twin, pipe=pipe, mount=mount, rng=rng, pose="camera",
        specimen=seed,
    )  # fmt: skip
    used, bursts = scan(trial)
    return crack_depth(bursts, used, known, width)


def _right(search: Results) -> list[tuple[TracedCrack, BoolArray]]:
    """Return the traces on the crack, and whether each of their places is on it."""
    right = []
    for trace in search.traces if len(search.course) else ():
        off = between(trace.places, search.course, search.camera.radius)
        near: BoolArray = off.min(axis=1) < SAME
        if near.mean() >= SHARE:
            right.append((trace, near))
    return right


def outcome_of(seed: int, search: Results) -> CrackOutcome:
    """Compare the traces of a scene with the truth."""
    radius, course, none = search.camera.radius, search.course, (math.nan, math.nan)
    if not len(course):
        return CrackOutcome(seed, 0.0, False, none, *none, len(search.traces))
    right = _right(search)
    drawn = np.zeros(len(course), dtype=bool)
    for trace, _ in right:
        drawn |= between(trace.places, course, radius).min(axis=0) < SAME
    false = len(search.traces) - len(right)
    found = bool(drawn.mean() >= SHARE)
    share, width = float(drawn.mean()), search.view.width
    if not found:
        return CrackOutcome(seed, width, False, (share, math.nan), *none, false)
    shares = (share, float(np.concatenate([near for _, near in right]).mean()))
    length = sum(trace.length for trace, _ in right) / (len(course) * FINE) - 1
    widths = np.concatenate([trace.widths[near] for trace, near in right])
    off = float(np.median(widths) - np.median(search.widths[drawn]))
    sd = max((trace for trace, _ in right), key=lambda trace: trace.length).width_sd
    return CrackOutcome(seed, width, True, shares, length, off, false, width_sd=sd)


def crack_figures(outcomes: Sequence[CrackOutcome]) -> dict[str, Any]:
    """Return recall by width, false findings per acquisition, and errors of found cracks."""
    cracks = [one for one in outcomes if one.width > 0]
    found = [one for one in cracks if one.found]
    scans = [one for one in found if one.scan]
    deep = [1e3 * abs(one.depth_error) for one in scans if math.isfinite(one.depth_error)]
    figures: dict[str, Any] = {
        "scenes": len(cracks),
        "false_per_acquisition": sum(one.false for one in outcomes) / max(len(outcomes), 1),
        "false_interval": _rate_interval(sum(one.false for one in outcomes), len(outcomes)),
        "length_error_pct": median([100 * abs(one.length_error) for one in found]),
        "width_error_um": median([1e6 * abs(one.width_error) for one in found]),
        "width_band_um": median([1e6 * PER_DEVIATION * one.width_sd for one in found]),
        "width_coverage": mean(
            [abs(one.width_error) <= PER_DEVIATION * one.width_sd for one in found]
        ),
        "found": len(found),
        "course_traced": median([one.shares[0] for one in found]),
        "trace_right": median([one.shares[1] for one in found]),
        "scans": len(scans),
        "depth_share": mean([math.isfinite(one.depth_error) for one in scans]),
        "depth_error_mm": median(deep),
        "verdicts": dict(Counter(one.scan for one in scans)),
    }
    for name, (low, high) in CLASSES.items():
        own = [one.found for one in cracks if low <= one.width < high]
        figures[f"recall_{name}"] = mean(own)
        figures[f"recall_{name}_interval"] = wilson(sum(own), len(own)) if own else None
        figures[f"scenes_{name}"] = len(own)
    return figures


def _rate_interval(count: int, of: int) -> tuple[float, float]:
    """Return the exact 95 % interval of a rate of rare events (Garwood, Biometrika 28, 1936)."""
    low = chi2.ppf(0.025, 2 * count) / 2 if count else 0.0
    return float(low / max(of, 1)), float(chi2.ppf(0.975, 2 * count + 2) / 2 / max(of, 1))


def _visible(
    view: SceneView, camera: CalibratedCamera, found: Findings
) -> tuple[FloatArray, FloatArray]:
    """Return places (N, 2) on the map of the camera, and widths (N,), of the visible crack."""
    places, widths = [np.empty((0, 2))], [np.empty(0)]
    for crack in view.pipe.cracks if found.wall is not None else ():
        course, wide = fine_course(crack, camera.radius)
        pixels = scoring.true_pixel(view.camera, course[:, 0], course[:, 1])
        on_map = camera.place(pixels, view.pan, view.tilt)
        seen = shown_on_map(found, on_map, camera.radius)
        places.append(on_map[seen])
        widths.append(wide[seen])
    return np.concatenate(places), np.concatenate(widths)


def shown_on_map(found: Findings, places: FloatArray, radius: float) -> BoolArray:
    """Return whether places (N, 2) are on known texels of the map."""
    assert found.wall is not None
    window: Window = found.wall.window
    x, y = np.rint(window.texels(places, radius)).T
    inside = (x >= 0) & (x < window.columns) & (y >= 0) & (y < window.rows)
    seen = np.isfinite(found.wall.whole)
    rows, columns = (np.where(inside, n, 0).astype(int) for n in (y, x))
    visible: BoolArray = inside & seen[rows, columns]
    return visible
