"""The judges of the head: their geometry, their wave equation and their rays."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.judge import _wave_kernels as kernels
from benchmarks.judge import scenes, sound, surface
from benchmarks.judge.score import outdated
from minorloop_head.geometry import Mount, Pinhole, wall_point
from minorloop_head.vision.calibrated_camera import CalibratedCamera
from papers.catheter.detection import JUDGE

SPEED = 1500.0
ROOT = Path(__file__).parents[1]


def test_a_scene_is_seen_where_the_documented_head_and_lens_see_it():
    scene = scenes.draw(1001, scenes.HOLE)
    lens = Pinhole(640, 480, scene.focal, scene.centre, k1=scene.k1, k2=scene.k2)
    offset = (scene.offset[0] / 1e3, scene.offset[1] / 1e3)
    mount = Mount(lever=8e-3, offset=offset, roll=scene.roll, advance=scene.advance / 1e3)
    camera = CalibratedCamera(lens, mount, scene.leds / 1e3)
    phi, z = (
        scene.place[0] + np.array([0.0, 0.05, -0.1]),
        scene.place[1] + np.array([0.0, 1.0, 2.0]),
    )
    theirs = camera.pixel(np.stack([phi, z / 1e3], axis=1), scene.pan, scene.tilt)
    np.testing.assert_allclose(scene.pixels(scenes.wall(phi, z)), theirs, atol=1e-6)
    np.testing.assert_allclose(scenes.wall(phi, z) / 1e3, wall_point(phi, z / 1e3, 10e-3))
    rays = scene.rays(theirs) @ scene.rotation.T
    back = scenes.meet(scene.lens, rays)
    np.testing.assert_allclose(np.stack(back[:2]), np.stack([phi, z]), atol=1e-6)


def test_triangles_of_the_wall_leave_out_the_mouth_and_nothing_else():
    scene = scenes.draw(1001, scenes.HOLE)
    part = surface.wall_triangles(scene)
    a, b, c = (part.points[part.corners[:, n]] for n in range(3))
    area = _area(part)
    whole = 2 * math.pi * scenes.RADIUS * (scenes.END - scenes.START)
    mouth = math.pi * (scene.hole.diameter / 2 + scene.hole.chamfer) ** 2
    assert 0 <= area + mouth - whole < 0.002 * whole  # dimples add some
    facing = (np.cross(b - a, c - a) * part.normals[part.corners[:, 0]]).sum(axis=1)
    assert (facing > 0).all()


def test_flanks_of_a_groove_close_the_gap_that_it_leaves_in_the_wall():
    scene = scenes.draw(1000, scenes.CRACK)
    bare, groove = replace(scene, groove=None), scene.groove
    gap = _area(surface.wall_triangles(bare)) - _area(surface.wall_triangles(scene))
    mouth = float((groove.widths * scenes.FINE).sum())
    assert gap == pytest.approx(mouth, rel=0.05)
    flanks = surface.groove_triangles(scene)
    assert _area(flanks) == pytest.approx(mouth * math.hypot(1, groove.slope), rel=0.05)
    into = -(flanks.normals * flanks.points)[:, :2].sum(axis=1) / scenes.RADIUS
    assert into.min() > 0
    assert np.median(into) == pytest.approx(1 / math.hypot(1, groove.slope), rel=0.05)


def _area(part):
    a, b, c = (part.points[part.corners[:, n]] for n in range(3))
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()


def test_polynomials_on_a_mouth_are_orthonormal():
    nodes, weights = np.polynomial.legendre.leggauss(30)
    r, share = 0.5 * (nodes + 1), 0.5 * weights
    for order in (0, 3):
        shapes = sound.polynomials(order, 11, r)
        around = math.pi if order else 2 * math.pi
        np.testing.assert_allclose(
            around * (shapes * share * r) @ shapes.T, np.eye(len(shapes)), atol=1e-12
        )


@pytest.mark.whole
def test_a_plane_wave_comes_back_from_the_floor_of_a_tube():
    cell, deep, wall = 10e-6, 60, 80
    interval = sound.step_time(cell, SPEED)
    source = sound._pulse(900, interval)
    free, layer = np.ones(2 * 6), sound._damping(wall + deep, sound.LAYER, 0)
    velocity = np.empty((len(source), 1))
    one = np.ones((1, 6))
    kernels.march(
        0, sound.SHARE, source, one[0], one / 6, wall, 6, wall + deep, free, layer, velocity
    )
    f, t = np.array([6e6, 8e6, 10e6, 12e6]), interval * np.arange(len(source))
    wave = np.exp(-2j * np.pi * f[:, None] * t)
    late = np.exp(-1j * np.pi * f * interval)
    answer = late * (wave @ velocity[:, 0]) / (wave @ source)
    exact = 0.5 * (1 - np.exp(-4j * np.pi * f * deep * cell / SPEED))
    assert np.abs(answer - exact).max() < 0.08
    assert abs(answer[2] - exact[2]) < 0.01


@pytest.mark.whole
def test_a_flat_disc_has_the_exact_pressure_on_its_axis():
    disc = sound.Disc(aperture=3e-3, focus=math.inf)
    field = sound.field_of(disc, SPEED, 6e-3, 6.2e-3, 0.04e-3)
    z = field.grid[1] + field.grid[2]
    exact = 2 * np.abs(np.sin(field.k / 2 * (math.hypot(z, 1.5e-3) - z)))
    np.testing.assert_allclose(np.abs(field.table[0, 1, 0]), exact, atol=1e-6)


def test_a_mouth_answers_by_reciprocity_and_takes_power():
    matrix = sound.admittance(1, 0.3e-3, 0.3e-3, SPEED, 5, cell=15e-6)[:, :, 20]
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-12)
    assert np.linalg.eigvalsh(matrix.real).min() > 0


def test_rays_meet_the_wall_and_leave_through_a_bore():
    mi = pytest.importorskip("mitsuba", reason="mitsuba is not installed: make judge installs it")
    mi.set_variant("scalar_rgb")
    from benchmarks.judge.light import mesh

    scene = scenes.draw(1004, scenes.HOLE)
    assert scene.hole.inside == "dark"
    world = mi.load_dict(
        {"type": "scene", "wall": mesh(surface.wall_triangles(scene), None, "wall")}
    )
    lens = mi.Point3f(scene.lens.tolist())
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    mouth = scene.hole.diameter / 2 + scene.hole.chamfer
    for radius, through in ((mouth - 0.01, True), (mouth + 0.01, False)):
        for point in scenes.wall(*scenes.around_hole(scene.hole, radius, angle)):
            way = point - scene.lens
            far = np.linalg.norm(way)
            hit = world.ray_intersect(mi.Ray3f(lens, mi.Vector3f((way / far).tolist())))
            assert hit.is_valid() != through
            if not through:
                assert hit.t == pytest.approx(far, abs=0.02)


def test_documents_give_the_kept_figures_of_the_judge_beside_a_recall():
    recall, false = f"{100 * JUDGE['recall']:.1f} %", f"{JUDGE['false_per_acquisition']:.3f}"
    for name in ("packages/minorloop-head/README.md", "docs/head/reference/studies.md"):
        rows = [row for row in (ROOT / name).read_text().splitlines() if row.startswith("|")]
        assert any(recall in row and false in row and "`make judge`" in row for row in rows), name
    words = (ROOT / "docs/head/reference/studies.md").read_text()
    for each in (JUDGE["corroded"], JUDGE["soil"]):
        assert f"{100 * each['recall']:.1f} %" in words


def test_a_kept_figure_that_is_another_one_now_is_named():
    found = {"all": dict(JUDGE), **{name: dict(JUDGE[name]) for name in ("corroded", "bare")}}
    found["soil"] = {"recall": 0.88888}
    found["all"]["size_within_15pct"] = 0.9793
    assert outdated(found) == []
    found["all"]["recall"] = 0.96
    (line,) = outdated(found)
    assert line.startswith("all.recall is 0.960, and 0.965 is kept")
