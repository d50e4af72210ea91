"""Missions alone: the inspection of many pipes, each with a pit and a crack."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from papers.catheter.mission import run_mission
from papers.harness import Study, mean, median

_OF_CRACKS = ("crack_length_error_pct", "crack_width_error_pct", "crack_off_mm")
_OF_MISSIONS = (
    "centred_px",
    "touch_mm",
    "position_mm",
    "diameter_error_pct",
    "depth_error_mm",
    "water_error_mm",
)


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
        **{key: _median(measured, key) for key in _OF_MISSIONS},
        "cracks_found": len(cracks) / len(missions),
        "false_cracks": sum(mission["false_cracks"] for mission in missions) / len(missions),
        **{key: _median(cracks, key) for key in _OF_CRACKS},
        "crack_measured": mean([one["crack_measured"] for one in cracks]),
        "crack_depth_error_mm": _median(deep, "crack_depth_error_mm"),
    }


def _median(missions: Sequence[Mapping[str, Any]], key: str) -> float:
    return median([mission[key] for mission in missions if not math.isnan(mission[key])])


STUDY = Study("missions", "Unattended missions in flooded pipes", run_mission, gather)
