"""A small sweep of the twin: one pit, some lines of a few millimetres."""

from dataclasses import replace

import numpy as np
import pytest

from minorloop_head.procedures.sweep_map import draw_pipe_map, finds_table
from minorloop_head.reconstruction.depth_map import BOTH, CAMERA, ECHOES, Patch
from minorloop_head.twins.pipe import Dent
from minorloop_head.ultrasound.c_scan import c_scan
from papers.catheter import sweep_trials
from papers.catheter.sweep_trials import (
    ScoredSweep,
    draw_sweep,
    map_figures,
    pictures,
    pipe_map,
    sweep,
    true_depth,
)


@pytest.fixture(scope="module")
def run():
    trial = draw_sweep(1001, pits=1)
    pit = trial.pipe.bores[0]
    around, along = (pit.phi - 0.12, pit.phi + 0.12), (pit.z - 0.7e-3, pit.z + 0.7e-3)
    state = sweep(trial, around, along)
    assert not state.trouble
    patch = Patch.ring(*along)
    scan = c_scan(state.bursts, trial.calibration.probe_at((0.0, 0.0)), patch)
    with pytest.MonkeyPatch.context() as fewer:
        fewer.setattr(sweep_trials, "_VIEWS", 1)
        seen = pictures(trial, patch)
    seconds = state.bursts[-1].t - state.bursts[0].t
    pipe = replace(trial.pipe, cracks=())
    return ScoredSweep(scan, *pipe_map(scan, seen), pipe, trial.level, seconds), state


@pytest.mark.whole
def test_most_bands_of_the_map_hold_the_true_depth(run):
    figures = map_figures([run[0]])
    assert 0.7 <= figures["echoes_coverage"] <= 0.99  # a quarter of these texels are at a rim
    assert 0.8 <= figures["camera_coverage"] <= 1.0
    deeper = replace(run[0], pipe=replace(run[0].pipe, dents=(Dent(1.5, 21e-3, 1.0, -1e-3),)))
    assert map_figures([deeper])["map_coverage"] < 0.1


def test_the_true_depth_has_pits_and_dents():
    trial = draw_sweep(1000)
    pit = trial.pipe.bores[0]
    (depth,) = true_depth(trial.pipe, Patch(pit.phi, pit.z, 1, 1)).ravel()
    assert depth == pytest.approx(pit.depth, abs=30e-6)
    bead = replace(trial.pipe, bores=(), cracks=(), dents=(Dent(0.0, 0.02, 1e-3, 0.2e-3),))
    assert true_depth(bead, Patch(0.0, 0.02, 1, 1)) == pytest.approx(-0.2e-3)


@pytest.mark.whole
def test_the_map_has_picture_and_echoes_and_is_drawn(run):
    fused = run[0].fused
    sources = set(np.unique(fused.wall.source))
    assert {CAMERA, ECHOES} <= sources
    assert BOTH not in sources  # the sweep is far from the water line
    assert len(finds_table(fused).rows) == 1
    assert len(draw_pipe_map(fused, picture=run[0].picture).axes) == 8
