"""Scans alone: the depths of many pits by echoes, and what their bands hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
from papers.harness import Study

SCANS = 6
"""Flat pits for each specimen; the last has the size for the score of fusion."""
_FUSED = Bore(0.0, 0.0, 1e-3, depth=0.5e-3)
_FIRST = 60_000
"""Seed of the first scan."""


def run_study(seed: int, scans: int = SCANS) -> dict[str, Any]:
    """Scan the pits of one specimen, and places where there is no depth; return what is gathered.

    Parameters
    ----------
    seed : int
        Of pipes, probe and noise.
    scans : int
        Number of pits with a flat floor.
    """
    return {"scored": scored_scans(seed, scans)}


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


STUDY = Study("scans", "Depths of pits by ultrasound", run_study, gather)
