"""A small sweep of the twin: one pit, some lines of a few millimetres."""

from dataclasses import replace

import numpy as np
import pytest

from minorloop_head.procedures.sweep_map import draw_pipe_map, finds_table
from minorloop_head.reconstruction.depth_map import BOTH, CAMERA, ECHOES, Patch, unseen_map
from minorloop_head.twins.pipe import Crack, Dent
from minorloop_head.ultrasound.c_scan import CRACK, CUT, PIT, c_scan
from papers.catheter import sweep_trials
from papers.catheter.sweep_trials import (
    ScoredSweep,
    c_scan_figures,
    draw_sweep,
    map_figures,
    on_pit,
    pictures,
    pipe_map,
    sweep,
    true_depth,
    within_reach,
)
from papers.claims import figure


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
    return ScoredSweep(scan, pipe_map(scan, seen), pipe, trial.level, seconds), state


def test_a_pit_is_found_while_the_head_sways_and_the_catheter_sticks(run):
    figures = c_scan_figures([run[0]])
    assert figures["recall"] == 1.0
    assert figures["false_per_cm2"] == figures["wrong_kind"] == 0
    assert abs(figures["depth_bias_um"]) < 30
    assert figures["size_ratio"] == pytest.approx(1.0, abs=0.25)
    assert figures["place_mm"] < 0.3


def test_sweeps_alone_have_the_figures_of_the_whole_study(run):
    found = sweep_trials.gather([{"sweep": run[0]}] * 2)
    assert all(figure(found, claim.key) is not None for claim in sweep_trials.STUDY.claims)
    assert found["cscan"]["pits"] == 2


def test_a_find_elsewhere_is_false_and_one_of_another_kind_is_wrong(run):
    scored, _ = run
    (find,) = scored.scan.finds
    away = replace(find, z=find.z + 1e-3)
    other = replace(find, kind=CRACK)
    scan = replace(scored.scan, finds=(away, other))
    figures = c_scan_figures([replace(scored, scan=scan)])
    assert figures["recall"] == 0.0
    assert figures["false_per_cm2"] == pytest.approx(1 / figures["area_cm2"])
    assert figures["wrong_kind"] == 1
    assert find.kind == PIT
    assert on_pit(scored, find)


def test_what_the_edge_cuts_is_counted_apart(run):
    scored, _ = run
    away = replace(scored.scan.finds[0], kind=CUT, z=scored.scan.finds[0].z + 1e-3)
    figures = c_scan_figures([replace(scored, scan=replace(scored.scan, finds=(away,)))])
    assert (figures["cut"], figures["false_per_cm2"]) == (1, 0)


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


@pytest.mark.parametrize(
    ("width", "phi", "z", "counts"),
    [
        (0.12e-3, 1.5, (20e-3, 24e-3), True),
        (0.09e-3, 1.5, (20e-3, 24e-3), False),
        (0.12e-3, -1.5, (20e-3, 24e-3), False),
        (0.12e-3, 1.5, (20e-3, 21.2e-3), False),
    ],
)
def test_a_crack_counts_if_it_is_wide_and_long_enough_under_water(run, width, phi, z, counts):
    scored, _ = run
    here = replace(scored, scan=replace(scored.scan, wall=unseen_map(Patch.ring(20e-3, 22.4e-3))))
    crack = Crack(((phi, z[0]), (phi, z[1])), (width, width))
    assert within_reach(here, crack) == counts


def test_the_map_has_picture_and_echoes_and_is_drawn(run):
    fused = run[0].fused
    sources = set(np.unique(fused.wall.source))
    assert {CAMERA, ECHOES} <= sources
    assert BOTH not in sources  # the sweep is far from the water line
    assert len(finds_table(fused).rows) == 1
    assert len(draw_pipe_map(fused, picture=fused.picture).axes) == 8
