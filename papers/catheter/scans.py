"""Scans alone: the depths of many pits by echoes, and what their bands hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from minorloop_head.twins.pipe import Bore
from papers.catheter.scan_trials import (
    ScoredScan,
    band_figures,
    depth_figures,
    dished_figure,
    draw_trial,
    fusion_figures,
    modality_wrong,
    run_trial,
)
from papers.claims import Claim

TITLE = "Depths of pits by ultrasound"
SCANS = 6
"""Flat pits for each specimen; the last has the size for the score of fusion."""
_FUSED = Bore(0.0, 0.0, 1e-3, depth=0.5e-3)
_FIRST = 60_000
"""Seed of the first scan."""

CLAIMS = (
    Claim(
        "depth by visual tracking in a sway of 1 degree: bias [um]",
        "depth.bias_um",
        "announced",
        least=-10,
        most=10,
    ),
    Claim(
        "depth by visual tracking: deviation [um]",
        "depth.sd_um",
        "announced",
        most=20,
        count="depth.measured",
        enough=2,
    ),
    Claim(
        "pits measured by visual tracking",
        "depth.measured_fraction",
        "announced",
        least=0.95,
        percent=True,
        count="depth.scans",
    ),
    *(
        claim
        for pose, words in (("gyroscope", "with a gyroscope"), ("joints", "by joint angles alone"))
        for claim in (
            Claim(f"the same {words}: bias [um]", f"depth.{pose}_bias_um", "-"),
            Claim(
                f"the same {words}: deviation [um]",
                f"depth.{pose}_sd_um",
                "-",
                count=f"depth.{pose}_measured",
                enough=2,
            ),
            Claim(
                f"the same {words}: pits measured",
                f"depth.{pose}_measured_fraction",
                "-",
                percent=True,
                count=f"depth.{pose}_scans",
            ),
        )
    ),
    Claim(
        "unfocused probe: deviation [um]",
        "depth.unfocused_sd_um",
        "-",
        count="depth.unfocused_measured",
        enough=2,
    ),
    Claim(
        "unfocused probe: pits measured",
        "depth.unfocused_measured_fraction",
        "-",
        percent=True,
        count="depth.unfocused_scans",
    ),
    Claim(
        "pits in and beside dents measured",
        "depth.dented_measured_fraction",
        "-",
        percent=True,
        count="depth.dented_scans",
    ),
    Claim("the same: largest error [um]", "depth.dented_worst_um", "-"),
    Claim("dished floors: worst error [mm]", "depth.dished_error_mm", "-", most=0.1),
    Claim("slowest scan of any kind [s, one core]", "depth.seconds_worst", "-", most=5),
    Claim("finding: position [mm]", "fusion.position_mm", "announced", most=0.3),
    Claim("finding: diameter [%]", "fusion.diameter_error_pct", "announced", most=15),
    Claim("finding: depth [mm]", "fusion.depth_error_mm", "announced", most=0.1),
    Claim(
        "bands of 90 % cover",
        "fusion.coverage",
        "-",
        least=0.85,
        most=0.95,
        percent=True,
        count="fusion.scans",
        enough=100,
    ),
    Claim("scans that the bands were scored on", "fusion.scans", "-"),
    Claim("half the 90 % band of a depth, median [mm]", "fusion.band_mm", "-"),
    Claim("wrong modality or depth made up", "modality.wrong", "-", most=0),
    Claim("scans that this was tried on", "modality.scans", "-"),
)


@dataclass(frozen=True, eq=False)
class ScanStudy:
    """Results of one specimen."""

    scored: dict[str, tuple[ScoredScan, ...]]

    def figures(self) -> dict[str, Any]:
        """Return the input of `gather`."""
        return {"scored": self.scored}


def run_study(seed: int, scans: int = SCANS) -> ScanStudy:
    """Scan the pits of one specimen, and places where there is no depth.

    Parameters
    ----------
    seed : int
        Of pipes, probe and noise.
    scans : int
        Number of pits with a flat floor.
    """
    return ScanStudy(scored_scans(seed, scans))


def gather(runs: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the figures over the scans of several specimens."""
    return scan_figures([run["scored"] for run in runs])


def scored_scans(seed: int, pits: int) -> dict[str, tuple[ScoredScan, ...]]:
    """Return the scans of a specimen by the kind of place, or by what gave the pose."""
    first = _FIRST + (pits + 4) * seed
    drawn = {
        "pit": [draw_trial(first + 4 + k) for k in range(max(pits - 1, 1))],
        "fused": [draw_trial(first, bore=_FUSED)],
        "gyroscope": [draw_trial(first + 4, pose="gyroscope")],
        "joints": [draw_trial(first + 4, pose="joints")],
        "unfocused": [draw_trial(first + 4, lens=False)],
        "dished": [draw_trial(first + 1, kind="dished")],
        "dented": [draw_trial(first + 1, kind="dented")],
        "hole": [draw_trial(first + 2, kind="hole")],
        "dry": [draw_trial(first + 3, kind="dry")],
    }
    return {kind: tuple(run_trial(one) for one in each) for kind, each in drawn.items()}


def scan_figures(scored: Sequence[Mapping[str, Sequence[ScoredScan]]]) -> dict[str, Any]:
    """Return bias, deviation and bands of depths, and how often one was made up."""
    kinds = {kind: [one for each in scored for one in each[kind]] for kind in scored[0]}
    return {
        "depth": {
            **depth_figures(kinds["pit"]),
            **{
                f"{kind}_{key}": value
                for kind in ("gyroscope", "joints", "unfocused", "dented")
                for key, value in depth_figures(kinds[kind]).items()
            },
            "dished_error_mm": dished_figure(kinds["dished"]),
            "seconds_worst": max(one.seconds for each in kinds.values() for one in each),
        },
        "fusion": {
            **fusion_figures(kinds["fused"]),
            **band_figures([*kinds["pit"], *kinds["fused"]]),
        },
        "modality": {
            "wrong": sum(bool(np.isfinite(one.found.depth)) for one in kinds["hole"])
            + modality_wrong(kinds["dry"]),
            "scans": len(kinds["hole"]) + len(kinds["dry"]),
        },
    }
