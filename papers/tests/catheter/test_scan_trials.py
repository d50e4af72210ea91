"""Figures from made-up findings, and one scan of a dry pipe."""

from dataclasses import replace

import numpy as np
import pytest

from minorloop_head.geometry import wrapped
from minorloop_head.procedures.scan import DWELL, NO_COUPLING, SHOTS, RasterScan
from minorloop_head.reconstruction.depth_map import Patch
from minorloop_head.reconstruction.fusion import fuse
from minorloop_head.twins.pipe import Bore
from minorloop_head.ultrasound.pits import PitDepth, raster
from papers.catheter.scan_trials import (
    ScanSite,
    ScoredScan,
    band_figures,
    depth_figures,
    draw_trial,
    fusion_figures,
    modality_wrong,
    scan,
)

TRUTH = Bore(0.0, 20e-3, 1e-3, depth=0.5e-3)
FOUND = PitDepth("measured", 0.0, 20e-3, 1e-3, 0.5e-3, 20e-6, 30e-6, 5e-6, gain=1.0, dish=0.0)
PATCH = Patch.around(0.0, 20e-3, size=1.6e-3)


def run(found=FOUND, truth=TRUTH, *, dry=False, modality="ultrasound"):
    return ScoredScan(ScanSite(truth, dry), found, 1.0, fuse(found, None, PATCH), modality)


def test_bias_and_deviation_are_those_of_what_was_measured():
    runs = [run(replace(FOUND, depth=0.5e-3 + error * 1e-6)) for error in (-4.0, 0.0, 4.0)] + [
        run(replace(FOUND, verdict="too few echoes", depth=np.nan))
    ]
    figures = depth_figures(runs)
    assert figures["bias_um"] == pytest.approx(0.0, abs=1e-6)
    assert figures["sd_um"] == pytest.approx(4.0)
    assert figures["worst_um"] == pytest.approx(4.0)
    assert figures["measured_fraction"] == 0.75


def test_coverage_counts_depths_inside_the_band():
    runs = [run(replace(FOUND, depth=0.5e-3 + error)) for error in (0.0, 8e-6, 9e-6, 1e-4)]
    figures = fusion_figures(runs)
    bands = band_figures([*runs, run(replace(FOUND, verdict="disturbed"))])
    assert bands["coverage"] == 0.5
    assert bands["scans"] == 4
    assert bands["band_mm"] == pytest.approx(1.6449 * 5e-3)
    assert figures["depth_error_mm"] == pytest.approx(0.1)
    assert figures["position_mm"] == pytest.approx(0.0, abs=1e-9)


def test_a_depth_in_air_or_in_a_hole_is_wrong():
    hole = replace(TRUTH, depth=np.inf)
    assert modality_wrong([run()]) == 0
    assert modality_wrong([run(dry=True, modality="camera")]) == 1
    assert modality_wrong([run(truth=hole)]) == 1
    silent = replace(FOUND, verdict="no coupling", depth=np.nan)
    assert modality_wrong([run(silent, dry=True, modality="camera")]) == 0
    assert modality_wrong([run(silent, dry=True, modality="ultrasound")]) == 1


def test_the_scan_is_that_of_mission_and_console():
    place = draw_trial(3, kind="dry")
    probe, bursts = scan(place)
    targets = raster(probe, place.centre, points=RasterScan.points)
    rows = targets.reshape(RasterScan.points, RasterScan.points, 2)
    # The catheter rolls on the shorter way, here towards smaller phi.
    assert probe.mount.roll < place.probe.mount.roll
    targets = rows[::-1].reshape(targets.shape)
    assert probe.mount.advance == pytest.approx(place.centre[1], abs=0.06e-3)
    across = wrapped(probe.spots(targets)[:, 0] - place.centre[0])
    assert across.mean() == pytest.approx(0.0, abs=6e-3)
    assert [burst.verdict for burst in bursts] == [NO_COUPLING] * len(targets)
    assert {burst.fired for burst in bursts} == {SHOTS}
    off = np.degrees([burst.angles for burst in bursts] - targets)
    np.testing.assert_array_less(np.abs(off), 1.4)  # a sway of 1 degree, and noise
    assert (off.std(axis=0) > 0.4).all()
    assert place.twin.clock >= (len(targets) - 1) * DWELL
