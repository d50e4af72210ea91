"""Images of the wall, unrolled."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy import ndimage

from minorloop_head.geometry import wall_point
from minorloop_head.vision._alignment_kernels import sample
from minorloop_head.vision.calibrated_camera import irradiance, numbers, unroll

from .walls import AIM, CAMERA, LEDS, photograph, texture, window_around


@given(u=st.floats(5, 634), v=st.floats(5, 474))
def test_a_pixel_on_the_wall_projects_to_itself(u, v):
    place = CAMERA.place((u, v), *AIM)
    if np.isfinite(place).all() and place[1] < 0.5:
        np.testing.assert_allclose(CAMERA.pixel(place, *AIM), (u, v), atol=1e-6)


@given(u=st.floats(20, 620), v=st.floats(20, 460), by=st.floats(-0.01, 0.01))
def test_a_place_after_an_unknown_turn_is_that_of_its_pixel(u, v, by):
    before, after = np.array(AIM), np.array(AIM) + np.array([by, -by])
    place = CAMERA.place((u, v), *AIM)
    assume(np.isfinite(place).all() and place[1] < 0.5)
    seen = CAMERA.place(CAMERA.pixel(place, *after), *AIM)
    np.testing.assert_allclose(CAMERA.shifted(place, before, after), seen, atol=1e-8)
    behind = CAMERA.shifted(np.array([place[0], -1.0]), before, after)
    assert np.isnan(behind).all()


def test_a_frame_laid_flat_shows_what_is_painted_on_the_wall():
    window = window_around(0.5, 20e-3, size=6e-3)
    flat = unroll(photograph(*AIM, noise=0.0), CAMERA, window, *AIM)
    rows, columns = np.mgrid[: window.rows, : window.columns]
    place = window.place(columns, rows, CAMERA.radius)
    expected = 20 + 150 * texture(place[..., 0], place[..., 1])
    assert np.isfinite(flat).mean() > 0.95
    np.testing.assert_allclose(flat, np.where(np.isfinite(flat), expected, np.nan), atol=1.5)


FULL = replace(CAMERA, lens=replace(CAMERA.lens, k3=0.05, p1=6e-3, p2=-5e-3, aspect=1.1))


def test_compiled_loops_see_through_the_full_lens_as_numpy_does():
    noise = np.random.default_rng(0).normal(128, 400, (480, 640))
    image = ndimage.gaussian_filter(noise, 4).clip(0, 255).astype(np.uint8)
    window = window_around(0.5, 20e-3, size=6e-3)
    rows, columns = np.mgrid[: window.rows, : window.columns]
    place = window.place(columns, rows, FULL.radius)
    seen = FULL.pixel(place, *AIM)[..., ::-1]
    expected = ndimage.map_coordinates(image.astype(float), seen.reshape(-1, 2).T, order=1)
    flat = unroll(image, FULL, window, *AIM, least=5e3)
    there = np.isfinite(flat)
    assert there.mean() > 0.9
    np.testing.assert_allclose(flat[there], expected.reshape(flat.shape)[there], atol=1e-3)
    points = wall_point(place[::9, ::9, 0].ravel(), place[::9, ::9, 1].ravel(), FULL.radius)
    lens, image = numbers(FULL.lens), image.astype(np.float32)

    def sampled(pan, tilt):
        pose = FULL.mount.pose(pan, tilt)
        turns, moves = np.empty((2, 3, 3)), np.empty((2, 3))
        for k, step in enumerate(1e-6 * np.eye(2)):
            after, before = FULL.mount.pose(*(AIM + step)), FULL.mount.pose(*(AIM - step))
            turns[k] = (after.rotation - before.rotation) / 2e-6
            moves[k] = (after.position - before.position) / 2e-6
        values, slopes = np.empty(len(points)), np.empty((2, len(points)))
        assert sample(
            image, points, lens, pose.rotation, pose.position, turns, moves, np.zeros(2), values,
            slopes,
        )  # fmt: skip
        return values, slopes

    values, slopes = sampled(*AIM)
    np.testing.assert_allclose(values, expected.reshape(flat.shape)[::9, ::9].ravel(), atol=1e-3)
    for k, step in enumerate(1e-6 * np.eye(2)):
        by_step = (sampled(*(AIM + step))[0] - sampled(*(AIM - step))[0]) / 2e-6
        close = np.abs(by_step - slopes[k]) < 1e-3 * np.abs(slopes).max()
        assert close.mean() > 0.97  # where no edge of a pixel lies between


def test_light_falls_as_cosine_over_the_square_of_the_distance():
    window = window_around(0.5, 20e-3, size=2e-3)
    light = irradiance(CAMERA, window, *AIM)
    place = window.place(10, 30, CAMERA.radius)
    point = wall_point(*place, CAMERA.radius)
    normal = -np.array([np.cos(place[0]), np.sin(place[0]), 0.0])
    for level, led in zip(light, CAMERA.mount.pose(*AIM).to_pipe(LEDS), strict=True):
        way = led - point
        expected = (way @ normal) / np.linalg.norm(way) ** 3 * 1e-4
        assert level[30, 10] == pytest.approx(expected, rel=1e-5)
