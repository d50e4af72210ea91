"""Figures of the wall about a finding."""

from io import BytesIO

import numpy as np
import pytest

from minorloop_head.procedures.finding_map import draw_finding
from minorloop_head.reconstruction.depth_map import (
    CAMERA,
    DepthMap,
    Patch,
    camera_map,
)

LONG = Patch(0.3, 20e-3, 60, 24, step=0.1e-3)
SQUARE = Patch.around(0.3, 20e-3, size=1.6e-3)


def cracked():
    crack = np.zeros((60, 24), bool)
    crack[10:50, 11:13] = True
    return camera_map(LONG, np.ones((60, 24), bool), crack)


def pitted(rim):
    """A pit, and a rim above the wall by its uncertainty."""
    off = np.linalg.norm(SQUARE.off(0.3, 20e-3), axis=-1)
    edge = np.abs(off - 0.5e-3) < 0.1e-3
    depth = np.where(edge, -rim, np.where(off < 0.5e-3, 0.6e-3, 0.0))
    sd = np.where(edge, 0.2e-3, 0.01e-3)
    return DepthMap(SQUARE, depth, sd, np.full(depth.shape, CAMERA, np.uint8))


def colour_bars(figure):
    return [axes for axes in figure.axes if axes.get_label() == "<colorbar>"]


def test_a_rim_above_the_wall_by_less_than_its_band_takes_no_colours():
    for rim, least in ((0.1e-3, 0.0), (0.5e-3, -0.5)):
        figure = draw_finding(pitted(rim))
        low, high = figure.axes[0].images[0].get_clim()
        assert low == pytest.approx(least)
        assert high == pytest.approx(0.6)
        assert len(colour_bars(figure)) == 3


def test_a_surface_is_of_whole_quads_and_is_open_where_nothing_is_known():
    wall = cracked()
    figure = draw_finding(wall)
    figure.savefig(BytesIO(), format="png")
    (solid,) = [axes for axes in figure.axes if hasattr(axes, "get_zlim")]
    (faces,) = solid.collections
    known = np.isfinite(wall.depth)
    whole = known[:-1, :-1] & known[1:, :-1] & known[:-1, 1:] & known[1:, 1:]
    paths = faces.get_paths()
    assert len(paths) == whole.sum()
    assert {len(path.vertices) for path in paths} == {5}
