"""What the camera of the head tracks, and what its tool marks, graded by the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from minorloop_head.control.head import HeadControl
from papers.catheter import touch_trials
from papers.catheter.inspection_servo import Scene
from papers.catheter.sight_trials import Insertion, Picked, run_insertion, run_pick, sight_figures
from papers.catheter.touch_trials import Touch, run_touch, touch_figures
from papers.catheter.tracking_trials import Followed, run_tracking, tracking_figures
from papers.claims import Claim

SIGHT_CLAIMS = (
    Claim(
        "hole tracked: true error, 95th percentile [px of 320]",
        "tracking.true_error_px_p95",
        "tracked (Fig 14)",
        most=1.0,
    ),
    Claim("the same: frames lost", "tracking.lost_fraction", "tracked (Fig 14)", most=0.01),
    Claim(
        "plain wall, while tracked: error, 99th percentile [px of 320]",
        "tracking.texture_error_px_p99",
        "not studied",
        most=2.0,
    ),
    Claim("the same: frames given up", "tracking.texture_lost_fraction", "not studied"),
    Claim(
        "point picked 5 px of 640 off: error in the end, worst [px of 320]",
        "pick.final_error_px",
        "picked by hand (5.2)",
        most=1.0,
    ),
    Claim("the same: focus found, worst error [%]", "pick.focus_error_pct", "focused (5.2)"),
    Claim("the same: focus not found", "pick.focus_failed", "focused (5.2)"),
    Claim(
        "insertion: strongest finding is the hole",
        "fig14.told_apart",
        "identified (Fig 14 a-c)",
        least=1,
    ),
    Claim(
        "reflections taken for a defect",
        "fig14.reflections_taken",
        "not a defect (Fig 14)",
        most=0,
        bound="the paper's",
    ),
    Claim(
        "tracked while the head turns: error, 95th percentile [px of 320]",
        "fig14.track_error_px_p95",
        "tracked (Fig 14 d-f)",
        most=1.0,
    ),
    Claim("the same: frames lost", "fig14.lost_fraction", "tracked (Fig 14 d-f)", most=0.01),
    Claim("marks: distance, 90th percentile [mm]", "tool.touch_mm_p90", "tool named (2)", most=0.2),
    Claim("marks within 0.3 mm", "tool.within_bound", "tool named (2)", least=0.95, percent=True),
    Claim("marks seen in the next picture", "tool.mark_seen", "tool named (2)", percent=True),
)


@dataclass(frozen=True, eq=False)
class SightStudy:
    """Results of one specimen."""

    followed: tuple[Followed, ...]
    pick: Picked
    insertion: Insertion
    touches: tuple[Touch, ...]


def run_sight(seed: int, control: HeadControl) -> SightStudy:
    """Track, pick, insert and touch with one specimen.

    Parameters
    ----------
    seed : int
    control : HeadControl
        Of the head of this seed.
    """
    return SightStudy(
        followed=tuple(run_tracking(seed)),
        pick=run_pick(Scene(seed)),
        insertion=run_insertion(seed, control),
        touches=tuple(run_touch(seed, k, control) for k in range(touch_trials.TOUCHES)),
    )


def gather_sight(found: Sequence[SightStudy]) -> dict[str, Any]:
    """Return the figures over all points, pictures and touches of several specimens."""
    return {
        "tracking": tracking_figures([one for each in found for one in each.followed]),
        **sight_figures([each.pick for each in found], [each.insertion for each in found]),
        "tool": touch_figures([one for each in found for one in each.touches]),
    }
