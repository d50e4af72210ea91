"""Figures from made-up findings, and one scan of a dry pipe."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from minorloop_head.geometry import Mount, Probe, wrapped
from minorloop_head.procedures.scan import DWELL, NO_COUPLING, SHOTS, RasterScan, ScannedRaster
from minorloop_head.procedures.values import NOTHING, Running
from minorloop_head.reconstruction.depth_map import Patch
from minorloop_head.reconstruction.fusion import fuse
from minorloop_head.twins.pipe import Bore
from minorloop_head.ultrasound.field import CalibratedProbe
from minorloop_head.ultrasound.pits import PitDepth, raster
from papers.catheter import scan_trials
from papers.catheter.scan_trials import (
    ScanSite,
    ScoredScan,
    band_figures,
    depth_figures,
    dished_figure,
    draw_trial,
    fusion_figures,
    modality_wrong,
    run_trial,
    scan,
)

TRUTH = Bore(0.0, 20e-3, 1e-3, depth=0.5e-3)
FOUND = PitDepth("measured", 0.0, 20e-3, 1e-3, 0.5e-3, 20e-6, 30e-6, 5e-6, gain=1.0, dish=0.0)
PATCH = Patch.around(0.0, 20e-3, size=1.6e-3)


def run(found=FOUND, truth=TRUTH, *, dry=False, modality="ultrasound"):
    probe = CalibratedProbe(Probe(), Mount())
    place = ScanSite(probe, (0.0, 20e-3), 1e-3, truth, dry)
    return ScoredScan(place, found, 1.0, fuse(found, None, PATCH), modality)


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


def test_a_dished_floor_is_scored_by_its_mean():
    dished = replace(TRUTH, dish=0.1e-3)
    assert dished_figure([run(replace(FOUND, depth=0.46e-3), dished)]) == pytest.approx(0.01)
    flagged = replace(FOUND, verdict="uneven floor", depth=0.9e-3)
    assert np.isnan(dished_figure([run(flagged, dished)]))


def test_a_depth_in_air_or_in_a_hole_is_wrong():
    hole = replace(TRUTH, depth=np.inf)
    assert modality_wrong([run()]) == 0
    assert modality_wrong([run(dry=True, modality="camera")]) == 1
    assert modality_wrong([run(truth=hole)]) == 1
    silent = replace(FOUND, verdict="no coupling", depth=np.nan)
    assert modality_wrong([run(silent, dry=True, modality="camera")]) == 0
    assert modality_wrong([run(silent, dry=True, modality="ultrasound")]) == 1


def test_the_mount_and_the_camera_are_off_together_and_the_place_is_small():
    place = draw_trial(3)
    turned, moved = place.strayed
    assert turned != 0
    assert moved != 0
    assert place.probe.mount.advance != 20e-3
    assert abs(place.centre[1] - moved - place.truth.z) < 4 * 0.035e-3
    # A study of many specimens keeps every place, and hands it from process to process.
    assert len(pickle.dumps(place.site)) < 10_000


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


@pytest.mark.parametrize(("pose", "most"), [("camera", 0.15), ("gyroscope", 0.4), ("joints", 1.3)])
def test_the_pose_of_a_burst_is_what_the_camera_sees_of_the_swaying_head(pose, most):
    head = scan_trials._Head(draw_trial(3, kind="dry", pose=pose))
    made, off, request = ScannedRaster(), [], NOTHING
    scan = RasterScan(calibration=head.view, points=3).scan(made, (0.3, 20e-3), light=head.light)
    running = Running(scan, lambda request: None)
    while not running.done:
        reading = head.reading(request)
        if reading.shots and np.isfinite(reading.base).all():
            true = head._joints + head._sway(reading.t)
            off.append(np.degrees(np.abs(reading.line_of_sight - true)))
        request = running.advance(reading)
        head._trial.twin.wait(0.04)
    assert len(made.bursts) == 9
    assert 0.3 * (pose == "joints") < np.max(off) < most


def test_a_dry_pipe_is_detected():
    assert run_trial(draw_trial(3, kind="dry")).modality == "camera"


def test_a_place_beside_the_catheter_is_scanned_too():
    probe, bursts = scan(draw_trial(70_005, kind="dry"))
    assert len(bursts) == RasterScan.points**2
    assert np.isfinite(probe.mount.roll)
