"""Views drawn for finding holes beside glints."""

import numpy as np
import pytest

from minorloop_head.geometry import meet_wall, wrapped
from papers.catheter.scene_view import LEAST_AXIS, draw_view


@pytest.mark.parametrize("hole", [True, False])
def test_every_view_has_a_glint_near_the_place_and_clear_of_the_rim(hole):
    for seed in range(2):
        view = draw_view(seed, hole=hole)
        assert (view.hole is not None) == hole
        pose = view.mount.pose(view.pan, view.tilt)
        v, u = np.nonzero(view.camera.frame().image == 255)
        rays = view.camera._optics.rays(np.stack([u, v], axis=1)) @ pose.rotation.T
        phi, z, _ = np.moveaxis(meet_wall(pose.position, rays, 10e-3), -1, 0)
        off = np.hypot(10e-3 * wrapped(phi - view.place[0]), z - view.place[1])
        assert (off < 3.2e-3).any()
        if hole:
            rim = view.hole.diameter / 2 + view.hole.chamfer
            assert not ((off > rim + 5e-5) & (off < rim + 1.5e-4)).any()


@pytest.mark.parametrize("inside", ["dark", "backlit", "white"])
def test_holes_are_in_view_and_large_enough(inside):
    view = draw_view(1, hole=True, inside=inside)
    assert view.hole.inside == inside
    assert 0.85e-3 <= view.hole.diameter <= 1.15e-3
    u, v = view.camera._pixel(*view.place)
    assert 20 < u < 620
    assert 20 < v < 460
    edges = view.camera._pixel(
        view.hole.phi + np.array([-0.5, 0.5]) * view.hole.diameter / 10e-3, view.hole.z
    )
    assert np.hypot(*(edges[1] - edges[0])) / 2 > LEAST_AXIS * 0.95
