"""The inspection of section 5.2 of the catheter head paper, as one automatic mission on the twin.

Look around, pick, centre, focus, extract, touch, measure, reconstruct; then trace and measure the
cracks that were seen on the way. Head, catheter, camera and probe are twins; everything else would
run in a real inspection.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.threads import one_thread
from minorloop_head.procedures.head_file import HeadFile
from minorloop_head.procedures.probe_steps import (
    SEEN_BEFORE,
    drain,
    fused_wall,
    probe_of,
    reach_words,
    scanned_pit,
)
from minorloop_head.procedures.rig import InspectionRig
from minorloop_head.procedures.ring import ring_sweep
from minorloop_head.procedures.steps import (
    CENTRED_PX,
    CLAIMED,
    REFUSED,
    WITHIN,
    centre,
    extract,
    focus,
    go,
    look,
    meter,
    photo,
    pick,
    search,
    touch,
)
from minorloop_head.procedures.trace import likely, one_course, traces_of
from minorloop_head.procedures.values import LogEntry
from minorloop_head.reconstruction.depth_map import DepthMap, WaterLine
from minorloop_head.reconstruction.findings import Finding, finding_of, kind_of
from minorloop_head.twins.pipe import Bore, Crack
from minorloop_head.ultrasound.pits import PitDepth
from minorloop_head.ultrasound.profile import Profile
from minorloop_head.vision.cracks import TracedCrack
from minorloop_head.vision.defects import Hole, strongest
from minorloop_head.vision.reflectance_map import ReflectanceMap
from papers.catheter import mission_cracks, scoring
from papers.catheter.mission_cracks import SeenCrack
from papers.catheter.mission_scene import RADIUS, distance, draw_mission, reachable
from papers.catheter.pipe_map import ring_of
from papers.harness import Results, Study, mean, median

RING, VIEWS = math.radians(25.0), 8
"""Deflection of the views from one place in radians, and their number."""
ADVANCES = (0.0, 3e-3, 6e-3, 9e-3, 12e-3, 15e-3, 18e-3, 21e-3, 24e-3)
"""Positions of the catheter in metres from which the mission looks around, until echoes confirm a
pit. Their distance makes a hole of 0.85 mm 9 pixels wide, at 320 by 240 pixels, in two views."""
MOST_PICKS = 8
"""Most candidates for a pit that are visited."""
SAME = 1.0e-3
"""Candidates within this distance in metres are one."""
PROMISED = 3.0
"""Most standard deviations by which the depth of a pit may be wrong, and count as measured: the
90 % band is scored by its coverage, and excludes one in ten."""

_OF_CRACKS = ("crack_length_error_pct", "crack_width_error_pct", "crack_off_mm")
_OF_PITS = ("centred_px", "touch_mm", "position_mm", "diameter_error_pct", "depth_error_mm")


@dataclass(frozen=True, eq=False)
class Mission:
    """Result of a mission."""

    seed: int
    truth: Bore
    truth_crack: Crack
    truth_water: float
    """The pit, the crack, and the height of the water in m. For scoring only."""
    log: tuple[LogEntry, ...] = ()
    first: npt.NDArray[np.uint8] | None = None
    centred: npt.NDArray[np.uint8] | None = None
    """Shape (H, W). Images of the finding when picked, and with the axis sent to it."""
    pixel: FloatArray | None = None
    """Shape (2,). Of the finding in the first image."""
    picked: FloatArray | None = None
    """Shape (2,). Phi and z of the candidate in the view that showed it first."""
    found: Hole | None = None
    """By the camera, in the near view."""
    pit: PitDepth | None = None
    """By the echoes."""
    wall: DepthMap | None = None
    ring: DepthMap | None = None
    """About the pit, and once round the pipe."""
    profile: Profile | None = None
    water: WaterLine | None = None
    """Of the sweep round the pipe."""
    cracks: tuple[SeenCrack, ...] = ()
    """That were seen again in a near view."""
    touch: float = np.nan
    """Distance from the true centre at which the tool came to the wall, in m; infinite without a
    contact."""
    off: float = np.nan
    """Distance of the true centre from the optical axis when centred, in pixels."""
    steps: tuple[LogEntry, ...] = ()
    """Those with this pit."""
    reachable: bool = True
    """Whether the wires truly reach the raster in the water. For scoring only."""
    processor: float = np.nan
    """Seconds of the processor, identification of the head included."""

    @property
    def failed(self) -> tuple[str, ...]:
        """Steps with the pit that failed, of those without which it is not measured."""
        return tuple(one.what for one in self.steps if one.what in CLAIMED and not one.succeeded)

    @property
    def finding(self) -> Finding | None:
        """The pit, or what may be one, with a verdict that names what failed; None for a mark."""
        if self.pit is None:
            return None
        found = finding_of(self.pit)
        if self.failed and self.pit.verdict != REFUSED:
            found = replace(found, verdict=f"{found.verdict}, but failed: {', '.join(self.failed)}")
        return None if found.kind == "mark" else found

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings of the table: the pit, or what may be one, and cracks."""
        pits = () if self.finding is None else (self.finding,)
        return (*pits, *(crack.finding for crack in self.cracks))

    def figures(self) -> dict[str, Any]:
        """Return errors of the result; NaN where nothing was found."""
        place = width = depth = water = np.nan
        promised = False
        if self.water is not None and self.water.seen:
            water = 1e3 * abs(self.water.height - self.truth_water)
        if self.pit is not None:
            place = 1e3 * scoring.apart((self.pit.phi, self.pit.z), self.truth, RADIUS)
            width = 100 * abs(self.pit.diameter / self.truth.diameter - 1)
            depth = 1e3 * abs(self.pit.depth - self.truth.depth)
            promised = depth <= 1e3 * PROMISED * self.pit.depth_sd
        return {
            "found": self.found is not None,
            # What was measured elsewhere is not the pit.
            "measured": self.pit is not None
            and self.pit.measured
            and place < 1e3 * SAME
            and promised
            and self.touch <= WITHIN
            and self.off <= CENTRED_PX
            and not self.failed,
            "touched": self.touch <= WITHIN,
            "promised": promised,
            "failed": self.failed,
            "centred_px": self.off,
            "reachable": self.reachable,
            "refused": any(one.what == "reach" and not one.succeeded for one in self.log),
            "steps": [astuple(one) for one in self.log],
            "seconds": self.log[-1].t,
            "processor_s": self.processor,
            "touch_mm": 1e3 * self.touch,
            "position_mm": place,
            "diameter_error_pct": width,
            "depth_error_mm": depth,
            "water_error_mm": water,
            **mission_cracks.crack_figures(self.cracks, self.truth_crack),
        }


@dataclass
class Overview:
    """Views so far, traces of lines in them, and the positions from which they were taken."""

    views: list[ReflectanceMap] = field(default_factory=list)
    traces: list[TracedCrack] = field(default_factory=list)
    places: list[float] = field(default_factory=list)


@one_thread()
def run_mission(seed: int, head: HeadFile | None = None) -> Mission:
    """Inspect one pipe with a pit and a crack in it, without an operator, as of `draw_mission`."""
    began = time.process_time()
    (rig, truth), seen = draw_mission(seed, head), Overview()
    mission = Mission(seed, truth.bore, truth.crack, float(truth.water.level or 0.0))
    mission = replace(mission, reachable=reachable(rig, truth))
    said, within = reach_words(rig)
    rig.say("reach", said, succeeded=within)
    best = _examined(rig, truth, mission, seen)
    if best.pit is None:
        rig.say("end of pits", "no pit that echoes confirm was found; no depth is given")
    best = replace(best, cracks=_cracks(rig, seen))
    if best.profile is not None and best.wall is not None:
        parts = [best.wall, *(crack.wall for crack in best.cracks)]
        best = replace(best, ring=ring_of(best.profile, seen.views, parts))
    return replace(best, log=tuple(rig.log), processor=time.process_time() - began)


def _examined(rig: InspectionRig, truth: Results, mission: Mission, seen: Overview) -> Mission:
    """Look around from place after place, and visit candidates, until echoes confirm a pit.

    Candidates that are not seen again in a near view come last. If none is confirmed, the one with
    the best result is kept.
    """
    tried: list[Hole] = []
    doubted: list[Hole] = []
    best = mission
    for advance in (*ADVANCES, None):
        holes = doubted if advance is None else _look_around(rig, advance, seen)
        for hole in holes:
            known = any(distance(hole.place, other.place) < SAME for other in tried)
            if len(tried) >= MOST_PICKS or (known and advance is not None):
                continue
            tried += [] if known else [hole]
            one, again, view = _approached(rig, mission, hole)
            if not again and advance is not None:
                doubted.append(hole)
                continue
            one = _measured(rig, truth, one, view)
            best = one if best.pit is None or _better(one, best) else best
            if best.pit is not None and best.pit.measured:
                return best
    return best


def _better(one: Mission, other: Mission) -> bool:
    """Whether its echoes gave more: a measured depth, or a depth at all."""
    ranks = [
        (pit.measured, bool(np.isfinite(pit.depth))) if pit is not None else (False, False)
        for pit in (one.pit, other.pit)
    ]
    return ranks[0] > ranks[1]


def _approached(
    rig: InspectionRig, mission: Mission, hole: Hole
) -> tuple[Mission, bool, ReflectanceMap | None]:
    """Pick, centre, focus and extract; return whether it is seen again, and the near view."""
    began = len(rig.log)
    first, pixel = pick(rig, hole.place, f"evidence {hole.evidence:+.1f}")
    centre(rig, hole.place, outlined=True)
    off = scoring.off_middle(rig.tip, mission.truth)
    focus(rig)
    centred = photo(rig).image
    near, found, again = extract(rig, hole)
    one = replace(
        mission, first=first, pixel=pixel, centred=centred, off=off, picked=hole.place,
        found=found, steps=tuple(rig.log[began:]),
    )  # fmt: skip
    return one, again, near.wall


def _measured(
    rig: InspectionRig, truth: Results, one: Mission, view: ReflectanceMap | None
) -> Mission:
    """Touch and measure; if echoes give a depth, sweep round the pipe and reconstruct."""
    hole = one.found
    if hole is None:
        return one
    began = len(rig.log)
    touch(rig, hole)
    off = scoring.touch_off(rig.tip, truth.bore, RADIUS)
    pit, scanned = scanned_pit(rig, hole)
    one = replace(one, touch=off, pit=pit, steps=(*one.steps, *rig.log[began:]))
    if scanned.refused:
        return one
    if np.isfinite(pit.depth):
        wall = fused_wall(scanned, probe_of(rig, scanned), pit, hole, view)
        ring = ring_sweep(rig)
        size = f"{1e3 * pit.diameter:.2f} mm by {1e3 * pit.depth:.3f} mm"
        rig.say("reconstruct", f"{kind_of(pit.verdict)} of {size}")
        one = replace(one, wall=wall, profile=ring.profile, water=ring.water)
    drain(rig)
    return one


def _cracks(rig: InspectionRig, seen: Overview) -> tuple[SeenCrack, ...]:
    """Visit candidates for cracks, and look around from further places until one is confirmed.

    Lines of a single view come last: a line that further views show counts without an echo. One
    that is part of a crack that was found is not visited.
    """
    found: list[SeenCrack] = []
    tried: list[TracedCrack] = []
    further = [(place, SEEN_BEFORE) for place in ADVANCES if place not in seen.places]
    for advance, least in ((None, SEEN_BEFORE), *further, (None, 1)):
        if advance is not None:
            _look_around(rig, advance, seen)
        for trace, views in likely(seen.traces, tried, RADIUS):
            if any(one_course(trace.places, crack.course.places, RADIUS) for crack in found):
                continue
            if views >= least and len(tried) < mission_cracks.MOST:
                tried.append(trace)
                crack = mission_cracks.examined(rig, trace, views)
                found += [] if crack is None else [crack]
        if found:
            break
    return tuple(found)


def _look_around(rig: InspectionRig, advance: float, seen: Overview) -> list[Hole]:
    """Return the candidates seen from one place, the likeliest first; add views and traces."""
    seen.places.append(advance)
    holes: list[Hole] = []
    lines, there = 0, False
    for k in range(VIEWS):
        way = 2 * np.pi * k / VIEWS
        if not there:
            go(rig, place=(advance, 0.0))
        there = look(rig, f"view {k + 1}", RING * np.array([np.cos(way), np.sin(way)]))
        meter(rig)
        found = search(rig)
        holes += found.holes
        traces = traces_of(found, RADIUS)
        lines += len(traces)
        seen.traces += traces
        seen.views += [found.wall] if found.wall is not None else []
    each = strongest(holes, RADIUS, -np.inf)
    words = f"{len(each)} candidate{'s' if len(each) > 1 else ''}" if each else "nothing"
    words += f"; {lines} line{'s' if lines > 1 else ''}" if lines else ""
    rig.say("look around", f"from {1e3 * advance:g} mm, {VIEWS} views: {words}")
    return list(each)


def gather(runs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return shares and medians over the missions of several pipes."""
    return {"mission": mission_figures(runs), "touch": touch_figures(runs)}


def touch_figures(missions: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return how many missions touched a pit, and which share within the bound."""
    tried = [mission for mission in missions if not math.isnan(mission["touch_mm"])]
    return {"of": len(tried), "within_bound": mean([one["touched"] for one in tried])}


def mission_figures(missions: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return shares of all missions, and medians over those with a result."""
    measured = [mission for mission in missions if mission["measured"]]
    within = [mission for mission in missions if mission["reachable"]]
    beyond = [mission for mission in missions if not mission["reachable"]]
    cracks = [mission for mission in missions if mission["crack_found"]]
    deep = [mission for mission in cracks if mission["crack_measured"]]
    return {
        "of": len(missions),
        "each": [dict(mission) for mission in missions],
        "pits_measured": sum(one["measured"] for one in within) / max(len(within), 1),
        "reachable": len(within),
        "unreachable_said": mean([one["refused"] for one in beyond]),
        "refused_in_vain": sum(one["refused"] for one in within),
        "measured": mean([one["measured"] for one in missions]),
        **{key: _median(missions, key) for key in ("seconds", "processor_s")},
        **{key: _median(measured, key) for key in (*_OF_PITS, "water_error_mm")},
        "cracks_found": len(cracks) / len(missions),
        "false_cracks": sum(mission["false_cracks"] for mission in missions) / len(missions),
        **{key: _median(cracks, key) for key in _OF_CRACKS},
        "crack_measured": mean([one["crack_measured"] for one in cracks]),
        "crack_depth_error_mm": _median(deep, "crack_depth_error_mm"),
    }


def _median(missions: Sequence[Mapping[str, Any]], key: str) -> float:
    return median([mission[key] for mission in missions if not math.isnan(mission[key])])


STUDY = Study("missions", "Unattended missions in flooded pipes", run_mission, gather)
