import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop.errors import ParameterError
from minorloop.geometry import (
    Mount,
    Pinhole,
    body_rates,
    cone_half_angle,
    meet_wall,
    meet_wall_jacobian,
    pan_tilt,
    pan_tilt_of,
    rotation_z,
    wall_point,
    wrapped,
)

RADIUS = 10e-3
angles = st.floats(-1.2, 1.2)
inside = st.tuples(st.floats(-6e-3, 6e-3), st.floats(-6e-3, 6e-3), st.floats(-0.1, 0.1))
directions = st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)).filter(
    lambda d: np.hypot(d[0], d[1]) > 0.05
)
lenses = st.builds(Pinhole, k1=st.floats(-0.25, 0.3), k2=st.floats(-0.05, 0.1))
pixels = st.tuples(st.floats(0, 639), st.floats(0, 479))


@given(angles, angles)
def test_rotations_are_rotations(pan, tilt):
    turned = pan_tilt(pan, tilt)
    np.testing.assert_allclose(turned @ turned.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(turned) == pytest.approx(1.0)


@given(angles, angles)
def test_pan_and_tilt_come_back_from_the_axis(pan, tilt):
    assert pan_tilt_of(pan_tilt(pan, tilt)[:, 2]) == pytest.approx((pan, tilt), abs=1e-12)


def test_positive_pan_looks_right_and_positive_tilt_up():
    assert pan_tilt(0.3, 0.0)[0, 2] > 0
    assert pan_tilt(0.0, 0.3)[1, 2] < 0


@given(angles, angles, st.floats(-1, 1), st.floats(-1, 1))
def test_body_rates_are_those_of_a_small_turn(pan, tilt, pan_rate, tilt_rate):
    h = 1e-6
    before = pan_tilt(pan - h * pan_rate, tilt - h * tilt_rate)
    after = pan_tilt(pan + h * pan_rate, tilt + h * tilt_rate)
    skew = pan_tilt(pan, tilt).T @ (after - before) / (2 * h)
    expected = body_rates(tilt) @ [pan_rate, tilt_rate]
    np.testing.assert_allclose([skew[2, 1], skew[0, 2], skew[1, 0]], expected, atol=1e-8)


@given(lenses, pixels)
def test_undistorting_undoes_distorting(lens, pixel):
    np.testing.assert_allclose(lens.pixels(lens.normalised(pixel)), pixel, atol=1e-8)


@given(lenses, pixels, st.floats(1e-3, 0.5))
def test_a_point_on_the_ray_projects_onto_its_pixel(lens, pixel, depth):
    np.testing.assert_allclose(lens.project(depth * lens.rays(pixel)), pixel, atol=1e-8)


def test_what_is_behind_the_camera_is_not_seen():
    assert np.isnan(Pinhole().project([0.0, 0.0, -0.01])).all()


@given(lenses, pixels, st.floats(2e-3, 0.1))
def test_jacobian_of_the_projection_is_its_slope(lens, pixel, depth):
    point = depth * lens.rays(pixel)
    h = 1e-6 * depth
    slopes = [
        (lens.project(point + h * e) - lens.project(point - h * e)) / (2 * h) for e in np.eye(3)
    ]
    expected = lens.project_jacobian(point)
    np.testing.assert_allclose(np.array(slopes).T, expected, atol=1e-5 * np.abs(expected).max())


@given(inside, directions)
def test_rays_end_on_the_wall_ahead(origin, direction):
    phi, z, length = meet_wall(origin, direction, RADIUS)
    point = np.array(origin) + length * np.array(direction)
    assert length > 0
    np.testing.assert_allclose(point, wall_point(phi, z, RADIUS), atol=1e-12)


@given(inside, st.floats(-3, 3), st.floats(-0.1, 0.1))
def test_the_ray_to_a_point_of_the_wall_meets_it(origin, phi, z):
    direction = wall_point(phi, z, RADIUS) - np.array(origin)
    found = meet_wall(origin, direction, RADIUS)
    np.testing.assert_allclose(found, [phi, z, 1.0], atol=1e-10)


@given(inside, directions)
def test_jacobian_of_the_wall_is_its_slope(origin, direction):
    d, h = np.array(direction), 1e-7
    slopes = []
    for e in np.eye(3):
        ahead, behind = (meet_wall(origin, d + s * h * e, RADIUS)[:2] for s in (1, -1))
        slopes.append([wrapped(ahead[0] - behind[0]), ahead[1] - behind[1]])
    expected = meet_wall_jacobian(origin, d, RADIUS)
    size = np.abs(expected).max()
    np.testing.assert_allclose(np.array(slopes).T / (2 * h), expected, atol=1e-5 * size)


def test_along_the_axis_there_is_no_wall():
    assert np.isinf(meet_wall([0.0, 0.0, 0.0], [0.0, 0.0, 1.0], RADIUS)[2])


@given(st.tuples(st.floats(-1e-3, 1e-3), st.floats(-1e-3, 1e-3)), angles, angles, st.floats(-3, 3))
def test_aiming_centres_the_point(offset, pan, tilt, roll):
    mount = Mount(offset=offset, roll=roll, advance=0.02)
    pose = mount.pose(pan, tilt)
    point = pose.to_pipe([0.0, 0.0, 5e-3])
    np.testing.assert_allclose(mount.aim(point), (pan, tilt), atol=1e-9)


@given(angles, angles, inside)
def test_poses_go_there_and_back(pan, tilt, point):
    pose = Mount(roll=0.3).pose(pan, tilt)
    np.testing.assert_allclose(pose.to_camera(pose.to_pipe(point)), point, atol=1e-15)


def test_rolling_the_head_turns_what_it_sees():
    straight, rolled = Mount().pose(0.4, 0.1), Mount(roll=0.5).pose(0.4, 0.1)
    np.testing.assert_allclose(rolled.position, rotation_z(0.5) @ straight.position)


@given(st.floats(-50, 50))
def test_wrapping_keeps_the_direction(angle):
    assert -np.pi <= wrapped(angle) < np.pi
    assert np.cos(wrapped(angle)) == pytest.approx(np.cos(angle), abs=1e-12)


def test_half_the_pixels_are_twice_as_large():
    full, half = Pinhole(k1=-0.1), Pinhole(k1=-0.1).scaled(0.5)
    point = [1e-3, -2e-3, 0.01]
    np.testing.assert_allclose((full.project(point) + 0.5) / 2 - 0.5, half.project(point))


@given(st.floats(7e-3, 12e-3), st.floats(0, 2e-3))
def test_the_nose_stays_off_the_wall_within_the_cone(lever, eccentricity):
    most = cone_half_angle(lever, 6e-3, RADIUS, eccentricity)
    within = np.linspace(0.0, most, 50)
    rim = lever * np.sin(within) + 6e-3 * np.cos(within)
    assert rim.max() <= RADIUS - eccentricity + 1e-12
    if most < np.pi / 2:
        assert rim[-1] == pytest.approx(RADIUS - eccentricity)


def test_a_short_head_may_turn_freely_and_a_longer_one_not():
    assert cone_half_angle(7.9e-3, 6e-3, RADIUS) == np.pi / 2
    assert cone_half_angle(8.5e-3, 6e-3, RADIUS) < np.deg2rad(60)


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (lambda: Pinhole(focal=0.0), "positive"),
        (lambda: Pinhole(k1=-2.0), "folds"),
        (lambda: Mount(lever=np.nan), "finite"),
        (lambda: meet_wall([0.011, 0.0, 0.0], [1.0, 0.0, 0.0], RADIUS), "inside"),
        (lambda: cone_half_angle(8e-3, 6e-3, 5e-3), "does not fit"),
    ],
)
def test_refuses_what_cannot_be(bad, message):
    with pytest.raises(ParameterError, match=message):
        bad()
