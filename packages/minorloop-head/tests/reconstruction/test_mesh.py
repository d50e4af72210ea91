from dataclasses import replace

import numpy as np
import pytest

from minorloop_head.reconstruction.depth_map import (
    ECHOES,
    SUFFIXES,
    DepthMap,
    Patch,
    faces_of,
    mesh_of,
    save_mesh,
    vertices_of,
)

PATCH = Patch.around(0.3, 20e-3, size=2e-3)
OFF = np.linalg.norm(PATCH.off(0.3, 20e-3), axis=-1)
PIT = DepthMap(
    PATCH,
    np.where(OFF < 0.5e-3, 0.4e-3, 0.0),
    np.full(OFF.shape, 1e-5),
    np.full(OFF.shape, ECHOES, dtype=np.uint8),
)
HOLE = replace(PIT, depth=np.where(OFF < 0.5e-3, np.inf, 0.0))


def test_vertices_lie_on_the_wall_and_under_it():
    r = np.hypot(*np.moveaxis(vertices_of(PIT)[..., :2], -1, 0))
    assert r == pytest.approx(10e-3 + PIT.depth)


def test_faces_look_towards_the_axis():
    points = vertices_of(PIT).reshape(-1, 3)
    a, b, c = (points[faces_of(PIT)[:, n]] for n in range(3))
    normal = np.cross(b - a, c - a)
    flat = np.ptp(np.hypot(*np.stack([a, b, c])[..., :2].transpose(2, 0, 1)), axis=0) < 1e-9
    assert ((normal * a)[flat][:, :2].sum(axis=1) < 0).all()


def test_a_hole_is_cut_out():
    count = (PATCH.rows - 1) * (PATCH.columns - 1) * 2
    assert len(faces_of(PIT)) == count
    inside = np.flatnonzero(np.isposinf(HOLE.depth))
    assert len(faces_of(HOLE)) < count
    assert not np.isin(faces_of(HOLE), inside).any()


def test_what_nobody_knows_is_cut_out():
    unknown = replace(PIT, depth=np.where(OFF > 1e-3, np.nan, PIT.depth))
    assert not np.isin(faces_of(unknown), np.flatnonzero(np.isnan(unknown.depth))).any()


def test_a_ply_says_its_unit(tmp_path):
    head = save_mesh(PIT, tmp_path / "wall.ply").read_bytes()[:400]
    assert b"comment units: metres" in head


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_is_written_can_be_read_again(tmp_path, suffix):
    import trimesh

    path = save_mesh(PIT, tmp_path / f"wall{suffix}")
    again = trimesh.load(path, force="mesh")
    assert len(again.faces) == len(faces_of(PIT))
    assert again.bounds == pytest.approx(mesh_of(PIT).bounds, abs=1e-8)
