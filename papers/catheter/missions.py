"""Missions alone: the inspection of many pipes, each with a pit and a crack."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from papers.catheter.mission import Mission, run_mission
from papers.claims import Claim

TITLE = "Unattended missions in flooded pipes"
_OF_CRACKS = ("crack_length_error_pct", "crack_width_error_pct", "crack_off_mm")
_OF_MISSIONS = (
    "centred_px",
    "touch_mm",
    "position_mm",
    "diameter_error_pct",
    "depth_error_mm",
    "water_error_mm",
)

CLAIMS = (
    Claim(
        "missions that measured their pit, of those within reach",
        "mission.pits_measured",
        "announced",
        least=0.9,
        percent=True,
    ),
    Claim("missions with a pit within reach in their water", "mission.reachable", "-"),
    Claim("of the others, said before travel", "mission.unreachable_said", "-", percent=True),
    Claim("refused although within reach", "mission.refused_in_vain", "-"),
    Claim("pits measured: depth error, median [mm]", "mission.depth_error_mm", "announced"),
    Claim("the same: true centre off the optical axis [px]", "mission.centred_px", "-"),
    Claim(
        "touches within 0.3 mm, of those that were tried",
        "touch.within_bound",
        "tool named (section 2)",
        least=0.95,
        percent=True,
    ),
    Claim("pits measured: water line, median error [mm]", "mission.water_error_mm", "-"),
    Claim(
        "missions that found their crack",
        "mission.cracks_found",
        "announced",
        least=0.9,
        percent=True,
    ),
    Claim("cracks reported where none is, a mission", "mission.false_cracks", "-", most=0.05),
    Claim("cracks found: off their course, median [mm]", "mission.crack_off_mm", "-"),
    Claim("cracks found: length error, median [%]", "mission.crack_length_error_pct", "-"),
    Claim("cracks found: width error, median [%]", "mission.crack_width_error_pct", "-"),
    Claim("cracks found that have a depth", "mission.crack_measured", "announced", percent=True),
    Claim("of those, depth error, median [mm]", "mission.crack_depth_error_mm", "-"),
    Claim("mission: seconds of the head", "mission.seconds", "-"),
    Claim("mission: processor time [s]", "mission.processor_s", "-", most=20),
)


def run_study(seed: int) -> Mission:
    """Inspect one pipe.

    Parameters
    ----------
    seed : int
        Of head, pipe, water and noise.
    """
    return run_mission(seed)


def gather(runs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return shares and medians over the missions of several pipes."""
    return {"mission": mission_figures(runs), "touch": touch_figures(runs)}


def touch_figures(missions: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return how many missions touched a pit, and which share within the bound."""
    tried = [mission for mission in missions if not math.isnan(mission["touch_mm"])]
    within = sum(mission["touched"] for mission in tried)
    return {"of": len(tried), "within_bound": within / len(tried) if tried else math.nan}


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
        "unreachable_said": float(np.mean([one["refused"] for one in beyond]))
        if beyond
        else np.nan,
        "refused_in_vain": sum(one["refused"] for one in within),
        "measured": float(np.mean([one["measured"] for one in missions])),
        **{
            key: float(np.median([one[key] for one in missions]))
            for key in ("seconds", "processor_s")
        },
        **{key: _median(measured, key) for key in _OF_MISSIONS},
        "cracks_found": len(cracks) / len(missions),
        "false_cracks": sum(mission["false_cracks"] for mission in missions) / len(missions),
        **{key: _median(cracks, key) for key in _OF_CRACKS},
        "crack_measured": len(deep) / len(cracks) if cracks else np.nan,
        "crack_depth_error_mm": _median(deep, "crack_depth_error_mm"),
    }


def _median(missions: Sequence[Mapping[str, Any]], key: str) -> float:
    known = [mission[key] for mission in missions if not math.isnan(mission[key])]
    return float(np.median(known)) if known else math.nan
