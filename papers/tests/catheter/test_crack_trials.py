"""Cracks among marks that are none: scenes, matching, and figures."""

import math
from dataclasses import replace

import numpy as np
import pytest

from minorloop.identification.bands import PER_DEVIATION
from minorloop_head.geometry import Mount, meet_wall
from minorloop_head.twins.camera import Camera
from minorloop_head.twins.pipe import Crack, Pipe
from minorloop_head.vision.cracks import TracedCrack
from papers.catheter import crack_trials
from papers.catheter.crack_scenes import FINE
from papers.catheter.crack_trials import CrackOutcome, crack_figures, score_cracks
from papers.catheter.inspection import crack_table, draw_walls, verdict_words


def outcome(width, *, found=True, false=0, scan="", depth=math.nan):
    errors = (-0.1, 5e-6) if found else (math.nan, math.nan)
    return CrackOutcome(1, width, found, (1.0, 1.0), *errors, false, scan, depth)


@pytest.mark.whole
def test_a_crack_is_found_and_measured_and_marks_are_not_taken_for_one():
    found = score_cracks(1014, True, scan=True)
    assert found.found
    assert found.false == 0
    assert abs(found.length_error) < 0.2
    assert abs(found.width_error) < 20e-6
    assert abs(found.width_error) / PER_DEVIATION < found.width_sd < 30e-6
    assert found.scan == "measured"
    assert abs(found.depth_error) < 0.1e-3
    none = score_cracks(1013, False)
    assert (none.width, none.found, none.false) == (0.0, False, 0)


def test_a_crack_narrower_than_a_pixel_takes_light_in_proportion_to_its_width():
    pose = Mount().pose(0.0, 0.5)
    phi, z, _ = meet_wall(pose.position, pose.rotation[:, 2], Pipe.radius)
    points = ((phi - 0.1, z - 0.3e-3), (phi + 0.1, z + 0.3e-3))
    camera = Camera(Pipe(), Mount())
    camera.look(0.0, 0.5)
    bare = camera._radiance().copy()
    taken = []
    for width in (20e-6, 40e-6):
        camera.repaint(Pipe(cracks=(Crack(points, (width, width), albedo=0.05),)))
        taken.append(float((bare - camera._radiance()).sum()))
    assert taken[0] > 0
    assert taken[1] == pytest.approx(2 * taken[0], rel=0.1)


def test_figures_count_by_width_and_give_intervals():
    outcomes = [
        outcome(150e-6, scan="measured", depth=20e-6),
        outcome(120e-6, found=False),
        outcome(60e-6, scan="no floor echo"),
        outcome(0.0, found=False, false=1),
    ]
    found = crack_figures(outcomes)
    assert (found["recall_100um"], found["recall_50um"]) == (0.5, 1.0)
    assert math.isnan(found["recall_30um"])
    assert found["false_per_acquisition"] == 0.25
    low, high = found["false_interval"]
    assert (low, high) == (pytest.approx(0.0063, abs=1e-4), pytest.approx(1.393, abs=1e-3))
    assert found["length_error_pct"] == pytest.approx(10)
    assert found["width_error_um"] == pytest.approx(5)
    assert (found["scans"], found["depth_share"]) == (2, 0.5)
    sure = [replace(one, width_sd=sd) for one, sd in zip(outcomes[:3:2], (4e-6, 2e-6), strict=True)]
    bands = crack_figures(sure)  # both are off by 5 um
    assert bands["width_coverage"] == 0.5
    assert bands["width_band_um"] == pytest.approx(3.0 * PER_DEVIATION)
    assert found["depth_error_mm"] == pytest.approx(0.02)
    assert len(crack_table(found).rows) == 2
    assert verdict_words(found) == "measured 1, no floor echo 1"
    assert draw_walls([]) is None


class Search:
    """A true course, and traces beside it."""

    def __init__(self, course, traces):
        class Camera:
            radius = 10e-3

        class View:
            width = 80e-6

        self.camera, self.view, self.course, self.traces = Camera, View, course, traces
        self.widths = np.full(len(course), 80e-6)


def test_a_trace_beside_the_crack_is_false_and_half_of_the_course_must_be_traced():
    along = np.arange(0.0, 4e-3, FINE)
    course = np.stack([np.zeros(len(along)), along], axis=1)

    def trace(part, off):
        places = course[part] + [off / 10e-3, 0.0]
        return TracedCrack(places, np.full(len(places), 85e-6), len(places) * FINE, 0.5)

    cases = [
        (trace(slice(0, 45), 0.1e-3), True, 0),
        (trace(slice(0, 30), 0.1e-3), False, 0),
        (trace(slice(0, 80), 0.3e-3), False, 1),
    ]
    for one, found, false in cases:
        result = crack_trials.outcome_of(1, Search(course, (one,)))
        assert (result.found, result.false) == (found, false)
    result = crack_trials.outcome_of(1, Search(course, (cases[0][0],)))
    assert result.width_error == pytest.approx(5e-6)
    assert result.length_error == pytest.approx(45 / 80 - 1)
