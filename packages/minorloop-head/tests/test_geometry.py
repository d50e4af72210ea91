"""Rays, cylinders, pinhole cameras and rotations, against finite differences."""

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from minorloop_head import _geometry_kernels as kernels
from minorloop_head import geometry
from minorloop_head.distortion import distorted
from minorloop_head.geometry import Mount, Pinhole
from minorloop_head.twins.turbid_water import FlatPort

angles = st.floats(-1.2, 1.2)
pixels = st.tuples(st.floats(0, 639), st.floats(0, 479))


@given(pan=angles, tilt=angles)
def test_aiming_at_where_the_axis_points_gives_pan_and_tilt_back(pan, tilt):
    axis = geometry.pan_tilt(pan, tilt) @ [0.0, 0.0, 1.0]
    np.testing.assert_allclose(geometry.pan_tilt_of(axis), (pan, tilt), atol=1e-12)


def test_positive_pan_looks_right_and_positive_tilt_looks_up():
    x, y, _ = geometry.pan_tilt(0.1, 0.2) @ [0.0, 0.0, 1.0]
    assert x > 0
    assert y < 0


@given(pan=angles, tilt=angles, rates=st.tuples(st.floats(-1, 1), st.floats(-1, 1)))
def test_body_rates_are_those_of_a_small_turn(pan, tilt, rates):
    h = 1e-6
    before = geometry.pan_tilt(pan - h * rates[0], tilt - h * rates[1])
    after = geometry.pan_tilt(pan + h * rates[0], tilt + h * rates[1])
    spin = geometry.pan_tilt(pan, tilt).T @ (after - before) / (2 * h)
    turned = [spin[2, 1], spin[0, 2], spin[1, 0]]
    np.testing.assert_allclose(geometry.body_rates(tilt) @ rates, turned, atol=1e-8)


small = st.floats(-0.01, 0.01)
lenses = st.builds(
    Pinhole,
    k1=st.floats(-0.15, 0.2),
    k2=st.floats(0.0, 0.1),
    k3=st.floats(0.0, 0.1),
    p1=small,
    p2=small,
    aspect=st.floats(0.8, 1.2),
)


@given(lens=lenses, pixel=pixels)
def test_a_pixel_projects_to_itself_through_the_lens(lens, pixel):
    np.testing.assert_allclose(lens.pixels(lens.normalised(pixel)), pixel, atol=1e-9)
    np.testing.assert_allclose(lens.project(7.0 * lens.rays(pixel)), pixel, atol=1e-9)


@given(lens=lenses, pixel=pixels)
def test_the_lens_is_that_of_opencv_and_its_slopes_are_differences(lens, pixel):
    plain = lens.normalised(pixel)
    matrix = np.array([[lens.focals[0], 0, 0], [0, lens.focals[1], 0], [0, 0, 1.0]])
    matrix[:2, 2] = lens.centre
    bent = np.array([lens.k1, lens.k2, lens.p1, lens.p2, lens.k3])
    there, _ = cv2.projectPoints(np.array([[*plain, 1.0]]), np.zeros(3), np.zeros(3), matrix, bent)
    np.testing.assert_allclose(there.ravel(), pixel, atol=1e-8)
    _, _, across, both, down = distorted(*plain, *lens.distortion)
    assert kernels.distorted(*plain, *lens.distortion) == pytest.approx(
        distorted(*plain, *lens.distortion), rel=1e-12
    )
    h = 1e-6 * np.eye(2)
    slopes = (lens.distort(plain + h) - lens.distort(plain - h)) / 2e-6
    np.testing.assert_allclose(slopes, [[across, both], [both, down]], atol=1e-7)


@given(lens=lenses, pixel=pixels)
def test_a_port_in_water_is_seen_through_by_an_equal_lens(lens, pixel):
    wet = FlatPort.of(lens).normalised(pixel)
    assert np.abs(lens.in_water().pixels(wet) - pixel).max() < 1.0


@given(
    off=st.tuples(st.floats(-5e-3, 5e-3), st.floats(-5e-3, 5e-3)),
    d=st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)),
)
def test_a_ray_ends_on_the_wall_ahead_of_it(off, d):
    assume(np.hypot(d[0], d[1]) > 1e-3)
    origin = np.array([*off, 0.02])
    phi, z, length = geometry.meet_wall(origin, d, 10e-3)
    np.testing.assert_allclose(
        geometry.wall_point(phi, z, 10e-3), origin + length * np.array(d), atol=1e-9
    )
    assert length > 0


@given(pan=angles, tilt=angles, roll=st.floats(-3, 3), squint=angles, camera=st.floats(-3, 3))
def test_a_pose_is_the_product_of_its_turns(pan, tilt, roll, squint, camera):
    mount = Mount(8e-3, (1e-3, -0.5e-3), roll, 5e-3, squint, camera)
    pose = mount.pose(pan, tilt)
    turn = geometry.rotation_z(roll) @ geometry.pan_tilt(pan, tilt) @ mount.camera
    np.testing.assert_allclose(pose.rotation, turn, atol=1e-14)
    pivot = np.array([1e-3, -0.5e-3, 5e-3])
    np.testing.assert_allclose(pose.position, pivot + 8e-3 * turn[:, 2], atol=1e-16)


@given(phi=st.floats(-3, 3), z=st.floats(12e-3, 40e-3), roll=st.floats(-3, 3))
@pytest.mark.parametrize("squint", [0.0, 0.06])
def test_aiming_puts_a_point_on_the_optical_axis(squint, phi, z, roll):
    mount = Mount(
        offset=(1e-3, -0.5e-3), roll=roll, advance=2e-3, squint=squint, camera_roll=2.0 * squint
    )
    point = geometry.wall_point(phi, z, 10e-3)
    local = mount.pose(*mount.aim(point)).to_camera(point)
    np.testing.assert_allclose(local[:2], 0, atol=1e-12)


def test_distances_on_the_wall_go_the_short_way_round():
    course = [[3.1, 0.0], [-3.1, 0.0], [-3.1, 5e-3]]
    short = 10e-3 * (2 * np.pi - 6.2)
    assert geometry.wall_distance(course[0], course[1], 10e-3) == pytest.approx(short)
    assert geometry.wall_lengths(course, 10e-3) == pytest.approx([0.0, short, short + 5e-3])
