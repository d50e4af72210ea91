"""Sweeps alone: the ultrasonic map of many half-flooded pipes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from papers.catheter.sweep_trials import ScoredSweep, c_scan_figures, run_sweep
from papers.claims import Claim

TITLE = "Sweeps of half-flooded pipes"

CLAIMS = (
    Claim(
        "sweep: pits found, from 0.8 mm wide and 0.3 mm deep",
        "cscan.recall",
        "-",
        least=0.95,
        percent=True,
        count="cscan.pits",
    ),
    Claim(
        "sweep: false finds a cm2", "cscan.false_per_cm2", "-", most=0.05, count="cscan.area_cm2"
    ),
    Claim("sweep: finds of the wrong kind", "cscan.wrong_kind", "-"),
    Claim("sweep: finds that the edge cuts, without a claim", "cscan.cut", "-"),
    Claim(
        "sweep: cracks found, where 0.1 mm wide on 1.5 mm or more",
        "cscan.crack_recall",
        "-",
        percent=True,
        count="cscan.cracks",
    ),
    Claim("sweep: bias of depths [um]", "cscan.depth_bias_um", "-"),
    Claim("sweep: deviation of depths [um]", "cscan.depth_sd_um", "-"),
    Claim("sweep: diameter over the true one, median", "cscan.size_ratio", "-"),
    Claim("sweep: place of pits, 90th percentile [mm]", "cscan.place_mm", "-"),
    Claim("sweep: bands of 90 % of depths of finds cover", "cscan.coverage", "-", percent=True),
    Claim(
        "map of the pipe: bands of 90 % of its places cover",
        "cscan.map_coverage",
        "-",
        least=0.85,
        most=0.95,
        percent=True,
    ),
    *(
        Claim(f"the same: by {source}", f"cscan.{key}_coverage", "-", percent=True)
        for key, source in (("camera", "the camera"), ("echoes", "echoes"), ("both", "both"))
    ),
    Claim("sweep: gaps in the flooded part", "cscan.gap_share", "-", percent=True),
    Claim("sweep: water line, worst error [mm]", "cscan.water_mm", "-"),
    Claim("sweep: seconds of the head a cm2", "cscan.seconds_per_cm2", "-"),
)


@dataclass(frozen=True, eq=False)
class SweepStudy:
    """Results of one specimen."""

    swept: ScoredSweep

    def figures(self) -> dict[str, Any]:
        """Return the input of `gather`."""
        return {"sweep": self.swept}


def run_study(seed: int) -> SweepStudy:
    """Sweep one pipe.

    Parameters
    ----------
    seed : int
        Of pipe, water, probe and noise.
    """
    return SweepStudy(run_sweep(seed))


def gather(runs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the figures over the sweeps of several pipes."""
    return {"cscan": c_scan_figures([run["sweep"] for run in runs])}
