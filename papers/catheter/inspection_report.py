"""The report of the inspection study: what its template names, its tables and the servo."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.identification.bands import PER_DEVIATION
from minorloop.report import Table
from minorloop_head.geometry import wall_distance, wrapped
from minorloop_head.procedures.sweep_map import SHADES, SOURCES, draw_pipe_map, water_angles
from minorloop_head.reconstruction.depth_map import ECHOES
from minorloop_head.reconstruction.findings import PLACE_SD, Finding, finding_of, save_findings
from minorloop_head.reconstruction.mesh import save_mesh
from minorloop_head.ultrasound.crack_depth import MEASURED
from minorloop_head.vision.defects import DITHER, LEAST_EVIDENCE, SINGLE, SWITCHED, Hole
from papers.catheter.crack_trials import CrackOutcome, search_cracks
from papers.catheter.detection import SceneOutcome, Search, recall_curve, search_scene
from papers.catheter.inspection import gather, run_study
from papers.catheter.inspection_servo import SETTLED_PX, SWAY_WAIT
from papers.catheter.judged import JUDGE, SCENES
from papers.catheter.mission import Mission
from papers.catheter.mission_cracks import SeenCrack
from papers.catheter.mission_scene import RADIUS
from papers.catheter.scan_trials import ScoredScan
from papers.drawing import Paint, draw, level, new_figure, panel, photo
from papers.harness import Results, Study

_WORDS = {
    SWITCHED: ("three lights and none", "C0 - 2.6"),
    SINGLE: ("one frame", "C1 -- 1.8"),
    DITHER: ("five turns of 2 degrees", "C2 : 1.8"),
}
_CRACKS = {"100um": "100 to 200 um", "50um": "50 to 100 um", "30um": "30 to 50 um"}
_WALLS_SHOWN = 4
"""Most walls with cracks that are drawn of each kind of error, by trial."""
_REQUIRED = (0.05, 0.98)
"""Required: most false findings in an acquisition, and least recall."""
_LEAST_SHOWN = 3e-3
"""Left end of the logarithmic axis of false findings, which cannot show 0; by trial."""
_SHOWN = 6
"""Most scenes that are drawn of each kind of error, by trial."""
_HALF = 75
"""Half the side of a drawn cutout in pixels: 3 mm, within which a glint is, 20 mm away."""
_LIGHTS = {0: "first light", 1: "second light", 2: "third light", 4: "all lights"}
"""Drawn frames of an acquisition, and their lights; the one without light is left out."""


def missed_holes(outcomes: Sequence[SceneOutcome]) -> dict[str, int]:
    """Return counts of holes and of missed ones under switched lights, and of false findings."""
    own = [each for each in outcomes if each.mode == SWITCHED]
    missed = [each for each in own if each.hole and not each.found]
    return {
        "holes": sum(each.hole for each in own),
        "missed": len(missed),
        "dark": sum(each.inside == "dark" for each in missed),
        "unseen": sum(not np.isfinite(each.evidence) for each in missed),
        "false": sum(each.false for each in own),
        "of": len(own),
    }


def draw_curve(outcomes: Sequence[SceneOutcome]) -> Any:
    """Draw recall against false findings for each kind of acquisition."""
    most, least = _REQUIRED
    lines: list[Any] = [([_LEAST_SHOWN, most, most], [least, least, 1.0], "0.3 --")]
    for mode, (words, look) in _WORDS.items():
        own = [each for each in outcomes if each.mode == mode]
        if not any(each.hole for each in own):
            continue
        false, recall = recall_curve(own)
        # More false findings before more recall.
        way = np.maximum(np.repeat(false, 2)[1:], _LEAST_SHOWN), np.repeat(recall, 2)[:-1]
        at = max(sum(each.false for each in own) / len(own), _LEAST_SHOWN)
        hits = float(np.mean([each.found for each in own if each.hole]))
        lines += [(*way, look, words), ([at], [hits], f"{look.split()[0]} o 6")]
    x = f"false findings an acquisition ({_LEAST_SHOWN:g} or fewer at the left)"
    y, place = "share of the holes that are found", {"loc": "lower right"}
    frame: dict[str, Any] = {"xscale": "log", "xlim": (_LEAST_SHOWN, 2.0), "ylim": (0.5, 1.03)}
    return draw(panel(x, y, *lines, legend=place, **frame))


def draw_missed(outcomes: Sequence[SceneOutcome]) -> Any:
    """Draw holes that were missed, and the outlines with the most evidence there; None of none."""
    own = [each for each in outcomes if each.mode == SWITCHED and each.hole and not each.found]
    panels: list[Paint] = []
    for each in own[:_SHOWN]:
        (search,) = search_scene(each.seed, True)
        near = next((hole for hole in search.holes if hole.evidence == each.evidence), None)
        panels += _scene(f"scene {each.seed}\n{each.inside}", search, near)
    return _scenes(panels)


def draw_false(outcomes: Sequence[SceneOutcome]) -> Any:
    """Draw findings that were none, the strongest of each scene; None of none."""
    own = [each for each in outcomes if each.mode == SWITCHED and each.false]
    panels: list[Paint] = []
    for each in own[:_SHOWN]:
        (search,) = search_scene(each.seed, each.hole)
        most = max(value for value in each.alarms if value >= LEAST_EVIDENCE[SWITCHED])
        hole = next((hole for hole in search.holes if hole.evidence == most), None)
        panels += _scene(f"scene {each.seed}\nevidence {most:+.1f}", search, hole)
    return _scenes(panels)


def _scenes(panels: Sequence[Paint]) -> Any:
    rows = len(panels) // len(_LIGHTS)
    return draw(*panels, columns=len(_LIGHTS), height=2.35 * rows) if panels else None


def _scene(words: str, search: Search, hole: Hole | None) -> list[Paint]:
    """Return pictures under each light about a finding, with its outline and the true edge."""
    rim = None if hole is None else search.rim(hole)
    true = search.true_rim() if search.view.hole is not None else None
    about = true if rim is None else rim
    middle = np.zeros(2) if about is None else about.mean(axis=0)
    lines = [
        (*np.vstack([edge, edge[:1]]).T, f"{colour} - 0.8")
        for edge, colour in ((true, "C0"), (rim, "C1"))
        if edge is not None
    ]
    roots = {  # shadows are seen so
        light: np.sqrt(search.frames[frame].image, dtype=np.float32)
        for frame, light in _LIGHTS.items()
    }
    first = next(iter(roots))
    return [
        photo(
            root, f"{words}\n{light}" if light == first else light, *lines, middle=middle,
            half=_HALF, vmax=16,
        )
        for light, root in roots.items()
    ]  # fmt: skip


def crack_table(found: Mapping[str, Any]) -> Table:
    """Return a table of recall by width."""
    rows = []
    for name, words in _CRACKS.items():
        if of := found[f"scenes_{name}"]:
            low, high = found[f"recall_{name}_interval"]
            share = f"{found[f'recall_{name}']:.1%} ({low:.1%} to {high:.1%})"
            rows.append((words, share, str(of)))
    return Table(("width", "found (95 % interval)", "cracks"), rows)


def verdict_words(found: Mapping[str, Any]) -> str:
    """Return the verdicts of scans across cracks as a list."""
    return ", ".join(f"{verdict} {count}" for verdict, count in found["verdicts"].items()) or "none"


def draw_walls(outcomes: Sequence[CrackOutcome]) -> Any:
    """Draw the unrolled wall of the widest cracks, with true and traced courses; None of none."""
    shown = sorted(outcomes, key=lambda one: -one.width)[:_WALLS_SHOWN]
    panels = [_wall(one) for one in shown]
    return draw(*panels, columns=2, height=2.6 * -(-len(shown) // 2)) if shown else None


def _wall(outcome: CrackOutcome) -> Paint:
    search = search_cracks(outcome.seed, outcome.width > 0)
    wall, radius = search.findings.wall, search.camera.radius
    title = f"scene {outcome.seed}, {1e6 * outcome.width:.0f} um"
    if wall is None:
        return photo(None, title)
    traced = [(*wall.window.texels(each.places, radius).T, "C1") for each in search.traces]
    true = (*wall.window.texels(search.course, radius).T, "C0 , 1")
    return photo(wall.whole - wall.ground, title, *traced, true, vmin=-0.8, vmax=0.5)


_CROP = 60
"""Half the side of a drawn close-up in pixels, by trial."""
_AROUND = 25.0  # pixels


def save_mission(mission: Mission, folder: Path) -> list[Path]:
    """Write findings as a table and, with trimesh, the wall about each as PLY and glTF.

    Nothing is written of a mission without findings. The folder exists.
    """
    if not mission.findings:
        return []
    written = [save_findings(mission.findings, folder / "findings.csv")]
    walls = {} if mission.wall is None else {"finding": mission.wall}
    many = len(mission.cracks) > 1
    for number, crack in enumerate(mission.cracks, start=1):
        walls[f"crack{number}" if many else "crack"] = crack.wall
    for name, wall in walls.items():
        written += [save_mesh(wall, folder / f"{name}.{kind}") for kind in ("ply", "glb")]
    return written


def draw_images(mission: Mission) -> Any:
    """Draw the picked point as first seen, close up, and with the axis sent to it; None of none."""
    if mission.first is None:
        return None
    panels = []
    for image, pixel, title, half in (
        (mission.first, mission.pixel, "picked", np.inf),
        (mission.first, mission.pixel, "picked, close up", _CROP),
        (mission.centred, None, "the axis sent to it", _CROP),
    ):
        if image is None:
            panels.append(photo(None, title))
            continue
        place = np.array(image.shape[::-1]) / 2 if pixel is None else pixel
        square = partial(ring, at=place, size=18 if np.isinf(half) else 60)
        panels.append(photo(image, title, square, middle=place, half=half))
    return draw(*panels, columns=3, height=3.0)


def ring(axes: Any, at: Any, size: float = 11.0, mark: str = "s", colour: str = "C1") -> None:
    """Draw the outline of a mark about a place (2,)."""
    axes.plot(*at, mark, ms=size, mec=colour, mfc="none", mew=1.4)


def draw_ring(mission: Mission) -> Any:
    """Draw the unrolled pipe: the source of each part, the water line, and the profile."""
    from matplotlib.colors import ListedColormap

    figure, (top, low) = new_figure(2, 1, height=4.6)
    wall, water = mission.ring, mission.water
    if wall is None or water is None:
        return figure
    patch = wall.patch
    extent = (-180.0, 180.0, 1e3 * patch.z, 1e3 * (patch.z + patch.rows * patch.step))
    top.grid(False)
    shown = top.imshow(
        wall.source, origin="lower", extent=extent, aspect="auto", cmap=ListedColormap(SHADES),
        vmin=-0.5, vmax=3.5, interpolation="nearest",
    )  # fmt: skip
    bar = figure.colorbar(shown, ax=top, ticks=range(4))
    bar.ax.set_yticklabels(SOURCES)
    top.set(title=f"seen by; {wall.unseen:.1%} unseen", ylabel="along the pipe [mm]")
    low.grid(False)
    measured = np.isfinite(wall.depth) & (wall.source & ECHOES > 0)
    depth = 1e3 * np.where(measured, wall.depth, np.nan)
    shown = low.imshow(depth, origin="lower", extent=extent, aspect="auto", cmap="viridis")
    figure.colorbar(shown, ax=low, label="depth [mm]")
    low.set(
        title="depth under the wall by echoes; blank without an echo",
        xlabel="around the pipe [degrees]",
        ylabel="along the pipe [mm]",
    )
    for axes in (top, low):
        for phi in water_angles(water.height, patch.radius):
            axes.axvline(phi, color="C3", lw=1.2, ls="--")
        if mission.pit is not None:
            place = np.degrees(wrapped(mission.pit.phi)), 1e3 * mission.pit.z
            ring(axes, place, mark="o")
        for crack in mission.cracks:
            phi, z = crack.course.places.T
            _course(axes, np.degrees(wrapped(phi)), 1e3 * z)
    return figure


def draw_crack(crack: SeenCrack) -> Any:
    """Draw the near view of a crack, its course over it, and its width along it."""
    traced = crack.traced
    image, course = crack.photo.image, crack.photo.pixels(traced.places)
    place = crack.photo.pixels(crack.widest)
    middle = 0.5 * (course.min(axis=0) + course.max(axis=0))
    half = 0.5 * float(np.ptp(course, axis=0).max()) + _AROUND
    along = np.linspace(0.0, 1e3 * traced.length, len(traced.widths))
    near = int(np.argmin(np.linalg.norm(course - place, axis=1)))
    circle = partial(ring, mark="o", colour="C0")
    over = [(*course.T, "C1 - 0.9"), partial(circle, at=place)]
    return draw(
        photo(image, "seen from nearer", middle=middle, half=half),
        photo(image, "as it was traced", *over, middle=middle, half=half),
        panel(
            "along the crack [mm]", "width [mm]", (along, 1e3 * traced.widths, "C1 - 1.5"),
            partial(circle, at=(along[near], 1e3 * crack.width)), title="scanned at the circle",
            ylim=(0.0, 1.3e3 * float(traced.widths.max())),
        ),
        columns=3, height=3.0,
    )  # fmt: skip


def _course(axes: Any, phi: FloatArray, z: FloatArray) -> None:
    """Draw a course on the unrolled wall, broken where it crosses the edge."""
    broken = np.flatnonzero(np.abs(np.diff(phi)) > 180.0) + 1
    axes.plot(np.insert(phi, broken, np.nan), np.insert(z, broken, np.nan), color="C1", lw=1.0)


def draw_depths(runs: Sequence[Mapping[str, Any]]) -> Any:
    """Draw measured minus true depth of every pit, with its 90 % band."""
    panels, probes = [], {"through the lens": ("pit", "fused"), "unfocused disc": ("unfocused",)}
    for title, kinds in probes.items():
        each = [one for run in runs for kind in kinds for one in run["scored"][kind]]
        known = [one for one in each if one.found.measured]
        depth = [1e3 * one.site.depth for one in known]
        error = [1e6 * (one.found.depth - one.site.depth) for one in known]
        band = [1e6 * PER_DEVIATION * one.found.depth_sd for one in known]
        style = {"yerr": band, "fmt": "o", "ms": 3, "lw": 0.8, "capsize": 1.5}
        points = partial(_points, x=depth, y=error, **style)
        words = "true depth [mm]", "measured less true [um], 90 % band"
        title = f"{title}: {len(known)} of {len(each)} measured"
        panels.append(panel(*words, points, level(0.0), title=title))
    return draw(*panels, columns=2, height=3.4)


def _points(axes: Any, x: Sequence[float], y: Sequence[float], **style: Any) -> None:
    if x:
        axes.errorbar(x, y, **style)


def picked_off(mission: Mission) -> float:
    """Return how far the picked place is from that of the pit, in millimetres."""
    assert mission.picked is not None
    assert mission.pit is not None
    return 1e3 * float(wall_distance(mission.picked, (mission.pit.phi, mission.pit.z), RADIUS))


def finding_rows(finding: Finding) -> Table:
    """Return a table of a finding with the 90 % band of each value."""
    rows = []
    for name, what, scale, unit in (
        ("phi", "angle", 180 / np.pi, "deg"),
        ("z", "axial position", 1e3, "mm"),
        ("width", "width", 1e3, "mm"),
        ("length", "length", 1e3, "mm"),
        ("depth", "depth", 1e3, "mm"),
    ):
        value, sd = getattr(finding, name), getattr(finding, f"{name}_sd")
        known = np.isfinite(value)
        band = f"+- {scale * PER_DEVIATION * sd:.3f} {unit}" if known and np.isfinite(sd) else "-"
        rows.append((what, f"{scale * value:.3f} {unit}" if known else "not known", band))
    return Table((f"{finding.kind}: {finding.verdict}", "found", "90 % band"), rows)


_NO_CRACK = "No line was seen again in a near view, so that no crack is reported."


def names(
    study: Results, figures: Mapping[str, Any], runs: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    """Return what the template names beside figures."""
    many, missions, mission = len(runs) > 1, figures["mission"], study.mission
    cracks = [one for run in runs for one in run["cracks"]]
    outcomes = [outcome for run in runs for outcome in run["outcomes"]]
    finding = mission.finding or (mission.pit and finding_of(mission.pit))
    return {
        "own_pipes": "pipes of their own" if many else "a pipe of its own",
        "drawn": f"{'that of ' if many else ''}seed {study.seed}",
        "measured": round(missions["measured"] * missions["of"]),
        "cracked": round(missions["cracks_found"] * missions["of"]),
        "missions": f"mission{'s' if missions['of'] > 1 else ''}",
        "JUDGE": JUDGE,
        "SCENES": SCENES,
        "without_pit": "" if _has_pit(mission) else nothing_found(mission),
        "without_crack": "" if mission.cracks else _NO_CRACK,
        "swept": draw_pipe_map(study.sweep.fused, picture=study.sweep.fused.picture),
        "outcomes": outcomes,
        "missed": missed_holes(outcomes),
        "PLACE_SD_mm": 1e3 * PLACE_SD,
        "missed_cracks": [one for one in cracks if one.width > 0 and not one.found],
        "false_cracks": [one for one in cracks if one.false],
        "pits": [{"finding": finding, "wall": mission.wall}] if _has_pit(mission) else [],
        "rings": [] if mission.ring is None else [mission.ring],
    }


def _has_pit(mission: Mission) -> bool:
    return mission.wall is not None and mission.pit is not None


def narrow_words(crack: SeenCrack) -> str:
    """Return why a crack has no depth; nothing if it has one."""
    why = " The floor of a narrow crack reflects too little of a beam to be measured."
    return "" if crack.finding.verdict == MEASURED else why


def save_beside(study: Results, folder: Path) -> list[str]:
    """Write the findings of the first specimen's mission beside the report: table, PLY and glTF."""
    written = save_mission(study.mission, folder)
    if not written:
        print(nothing_found(study.mission), file=sys.stderr)
    return [f"written: {path}" for path in written]


def nothing_found(mission: Mission) -> str:
    """Return a sentence on why a mission has no pit."""
    why = "nothing round was seen" if mission.pit is None else f"verdict: {mission.pit.verdict}"
    return (
        f"The mission of seed {mission.seed} ended without the depth of a pit ({why}); no mesh of "
        "one is written."
    )


def log_table(mission: Mission) -> Table:
    """Return the steps of a mission."""
    rows = [
        (f"{step.t:.0f} s", step.what, step.outcome, "" if step.succeeded else "failed")
        for step in mission.log
    ]
    return Table(("time", "step", "outcome", ""), rows)


def depth_table(scored: Mapping[str, Sequence[ScoredScan]]) -> Table:
    """Return the depths of all scans beside the true ones."""
    rows = []
    for kind, scan in ((kind, one) for kind, each in scored.items() for one in each):
        pit, truth = scan.found, scan.site.depth
        true = "through" if np.isinf(truth) else f"{1e3 * truth:.3f}"
        depth = f"{1e3 * pit.depth:.3f}" if np.isfinite(pit.depth) else "-"
        sd = pit.depth_sd
        band = f"{1e6 * PER_DEVIATION * sd:.1f}" if np.isfinite(sd) else "-"
        rows.append((kind, true, pit.verdict, depth, band))
    return Table(("scene", "true depth, mm", "verdict", "depth, mm", "90 % band, um"), rows)


def draw_servo(study: Results) -> Any:
    """Draw distances against time: centring, and holding against sway."""
    sensor, camera, still, swayed = (
        study.runs[name] for name in ("sensor", "camera", "still", "swayed")
    )
    centring = [(sensor.t, sensor.off, "C0", "with angle sensor")]
    centring.append((camera.t, camera.off, "C1", "camera only"))
    late = swayed.t > SWAY_WAIT
    t = swayed.t[late] - SWAY_WAIT
    lines = [(still.t, still.off, "C0", "constant angles, without camera")]
    lines.append((t, swayed.off[late], "C1", "tracked and held"))
    if swayed.left is not None:
        lines.append((t, swayed.left[late], "C2", "and the picture shifted"))
    most = 1.5 * float(max(still.off.max(), swayed.off[late].max(initial=0.0)))
    words, limit = ("time [s]", "off the middle [px]"), level(SETTLED_PX, "0.3 -- 0.8")
    frame: dict[str, Any] = {"title": "sway of 1 degree", "ylim": (0.0, most)}
    return draw(
        panel(*words, *centring, limit, yscale="log"),
        panel(*words, *lines, legend={"loc": "upper right"}, **frame),
        columns=2,
        height=3.6,
    )


STUDY = Study(
    "inspection",
    "In-pipe inspection with a catheter head",
    run_study,
    gather,
    {
        "missions": "papers.catheter.mission",
        "scans": "papers.catheter.scan_trials",
        "sweeps": "papers.catheter.sweep_trials",
    },
    page=__name__,
    beside=save_beside,
)
