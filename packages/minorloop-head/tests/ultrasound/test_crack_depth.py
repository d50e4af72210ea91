"""Cracks on the twin: a wide one has a depth, a narrow one a bound."""

import numpy as np
import pytest

from minorloop_head.geometry import Mount, Probe
from minorloop_head.reconstruction.depth_map import BOTH, CAMERA, Patch
from minorloop_head.twins.pipe import Crack, Pipe
from minorloop_head.twins.ultrasound import Ultrasound
from minorloop_head.ultrasound.crack_depth import CrackDepth, crack_depth, crack_finding, crack_map
from minorloop_head.ultrasound.field import CalibratedProbe
from minorloop_head.ultrasound.pits import raster

from .synthetic import heard

MOUNT = Mount(advance=20e-3)
PROBE = CalibratedProbe(Probe(), MOUNT)
CENTRE = (0.0, 20e-3)
COURSE = np.array([(-0.3, 20.1e-3), (0.3, 19.9e-3)])


def scan(width, depth, noise=0.05, points=4):
    crack = Crack(tuple(map(tuple, COURSE)), (width, width), depth=depth)
    sonar = Ultrasound(Pipe(cracks=(crack,), water=-9.99e-3), MOUNT, seed=1, noise=noise)
    return [heard(sonar, place) for place in raster(PROBE, CENTRE, points=points)]


def test_a_wide_crack_has_a_depth():
    found = crack_depth(scan(0.3e-3, 0.5e-3, points=5), PROBE, COURSE, 0.3e-3)
    assert found.verdict == "measured"
    assert found.depth == pytest.approx(0.5e-3, abs=max(3 * found.depth_sd, 10e-6))
    assert found.depth_sd < 50e-6


def test_beyond_its_range_no_depth_is_given():
    found = crack_depth(scan(0.2e-3, 1.35e-3), PROBE, COURSE, 0.2e-3)
    assert found.verdict in ("deeper than 1.25 mm", "no floor echo")
    assert np.isnan(found.depth)


def test_a_crack_without_a_depth_has_a_lower_bound_that_is_kept():
    for width, depth in ((0.2e-3, 1.4e-3), (0.3e-3, 1.1e-3)):
        found = crack_depth(scan(width, depth), PROBE, COURSE, width)
        assert np.isnan(found.depth)
        assert 0.3e-3 < found.least_depth < depth
        assert "at least" in crack_finding(COURSE, width, found, 10e-3, width_sd=1e-5).verdict


def test_a_hair_is_too_narrow_and_the_bound_is_given():
    bursts = scan(0.02e-3, 0.5e-3, noise=0.3)
    found = crack_depth(bursts, PROBE, COURSE, 0.02e-3)
    assert found.verdict == "too narrow for a depth"
    assert np.isnan(found.depth)
    assert 0.02e-3 < found.least_width < 0.3e-3
    row = crack_finding(COURSE, 0.02e-3, found, 10e-3, width_sd=8e-6)
    assert row.kind == "crack"
    assert "under" in row.verdict
    assert row.length == pytest.approx(6e-3, rel=0.01)
    assert (row.width, row.width_sd) == (0.02e-3, 8e-6)


def test_the_map_is_as_deep_as_was_measured_and_open_where_it_was_not():
    patch = Patch.around(*CENTRE, size=7e-3)
    found = CrackDepth("measured", 0.5e-3, 10e-6)
    wall = crack_map(COURSE, 0.3e-3, found, CENTRE, patch)
    off = patch.off(*CENTRE)
    on = np.abs(off[..., 1] + off[..., 0] / 30) < 0.05e-3
    inner, outer = np.abs(off[..., 0]) < 0.9e-3, np.abs(off[..., 0]) > 1.2e-3
    assert (wall.depth[on & inner] == 0.5e-3).all()
    assert (wall.source[on & inner] == BOTH).all()
    assert np.isnan(wall.depth[on & outer & (np.abs(off[..., 0]) < 2.9e-3)]).all()
    assert (wall.depth[np.abs(off[..., 1]) > 0.5e-3] == 0).all()
    silent = crack_map(COURSE, 0.3e-3, CrackDepth("no floor echo"), CENTRE, patch)
    assert np.isnan(silent.depth[on & inner]).all()
    assert (silent.source == CAMERA).all()
