"""The wall that an inspection saw, its shares, and its figure."""

import math

import numpy as np
import pytest

from minorloop_head.console.plant import open_tip
from minorloop_head.procedures.inspected_wall import SeenWall, seen_wall
from minorloop_head.reconstruction.depth_map import Patch
from scripted_inspection import inspected_view

RING = Patch.ring(10e-3, 20e-3, step=0.5e-3)


def searched_between(rows, columns):
    picture = np.full((RING.rows, RING.columns), 0.1)
    searched = np.zeros(picture.shape, bool)
    searched[slice(*rows), slice(*columns)] = True
    return SeenWall(RING, picture, searched, np.zeros(picture.shape, bool))


def test_the_range_and_the_share_of_what_was_searched():
    every = searched_between((6, 9), (0, RING.columns))
    assert every.along == pytest.approx((13e-3, 14e-3))
    assert every.around == (-np.pi, np.pi)
    assert every.searched_share == 1.0
    sector = searched_between((4, 11), (0, 94))
    first, last = np.degrees(sector.around)
    assert first == pytest.approx(-90.0, abs=3.0)
    assert last - first == pytest.approx(360.0 * 93 / RING.columns, abs=3.0)
    assert sector.searched_share == pytest.approx(94 / RING.columns)


def test_wall_counts_as_searched_where_the_smallest_hole_is_shown_whole_and_large_enough():
    """Not at the edge of the picture, nor far along the pipe, where a hole is narrow."""
    tip, view = open_tip("twin:pipe")
    tip.move_to((math.radians(25.0), 0.0, 0.0, 0.0, 5e-3, 0.0))
    angles, image = (math.radians(25.0), 0.0), tip.frame().image
    shown = inspected_view("view 1", image=image, angles=angles, place=(5e-3, 0.0))
    seen = seen_wall([shown], view)
    camera, where = view.camera_at((5e-3, 0.0)), seen.patch.places[seen.searched]
    around = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    rim = 0.425e-3 * np.stack([np.cos(around) / view.radius, np.sin(around)], axis=1)
    pixels = camera.pixel(where[:, None] + rim, math.radians(25.0), 0.0)
    assert (pixels >= 0).all()
    assert (pixels <= (639, 479)).all()
    spread = pixels - pixels.mean(axis=1, keepdims=True)
    moments = np.einsum("nij,nik->njk", spread, spread) / 24
    assert 2 * np.sqrt(2 * np.linalg.eigvalsh(moments)[:, 0].min()) > 17.0
    assert 0.3 < seen.searched.sum() / np.isfinite(seen.picture).sum() < 0.9
