import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from minorloop.teleop.plant import View
from minorloop.teleop.sight import PlainSight, turned
from minorloop.twins.picture import FOCAL, HEIGHT, LEVER, RADIUS, WIDTH, Picture

VIEW = View(width=WIDTH, height=HEIGHT, focal=FOCAL, lever=LEVER, radius=RADIUS)
SIGHT = PlainSight(view=VIEW)
angles = st.floats(-25, 25)


def pixel(point, pan, tilt):
    """Where the camera sees a point of the pipe, by the matrices of the pinhole."""
    turn = turned(pan, tilt)
    x, y, z = turn.T @ (point - LEVER * turn[:, 2])
    return (WIDTH - 1) / 2 + FOCAL * x / z, (HEIGHT - 1) / 2 + FOCAL * y / z


def wall(place):
    return np.array([RADIUS * math.cos(place.phi), RADIUS * math.sin(place.phi), place.z])


def spotted(u, v, radius=4.0, grey=250, ground=90):
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH]
    away = np.hypot(columns - u, rows - v)
    noise = np.random.default_rng(1).normal(0, 1.5, away.shape)
    return np.clip(np.where(away < radius, grey, ground) + noise, 0, 255).astype(np.uint8)


@given(st.floats(0, WIDTH - 1), st.floats(0, HEIGHT - 1), angles, angles)
def test_a_pixel_and_its_place_on_the_wall_are_the_same_point(u, v, pan, tilt):
    place = SIGHT.place(u, v, pan, tilt)
    if place.far < 0.2:  # rays along the axis meet no wall
        assert pixel(wall(place), pan, tilt) == pytest.approx((u, v), abs=1e-6)


@settings(max_examples=30)
@given(st.floats(20, WIDTH - 20), st.floats(20, HEIGHT - 20), angles, angles)
def test_the_servo_brings_a_point_to_the_middle_along_a_straight_line(u, v, pan, tilt):
    image = np.zeros((HEIGHT, WIDTH), np.uint8)
    point = wall(SIGHT.place(u, v, pan, tilt))
    first = np.subtract((u, v), ((WIDTH - 1) / 2, (HEIGHT - 1) / 2))
    if SIGHT.place(u, v, pan, tilt).far > 0.06 or np.hypot(*first) < 5:
        return
    before = None
    step = 0.01
    for _ in range(3):
        at = pixel(point, pan, tilt)
        off = np.subtract(at, ((WIDTH - 1) / 2, (HEIGHT - 1) / 2))
        if before is not None:
            # d(off)/dt = -gain off
            assert off == pytest.approx(before * (1 - SIGHT.gain * step), abs=0.02 + 2e-3 * 100)
        before = off
        target = SIGHT.begin(image, *at)
        rates = SIGHT.rates(target, pan, tilt)
        pan, tilt = pan + step * rates[0], tilt + step * rates[1]


@pytest.mark.parametrize("grey", [250, 10])
def test_a_spot_is_found_to_a_fraction_of_a_pixel_whatever_its_polarity(grey):
    (spot, *_) = SIGHT.spots(spotted(120.3, 80.6, grey=grey))
    assert (spot.u, spot.v) == pytest.approx((120.3, 80.6), abs=0.3)
    assert spot.diameter == pytest.approx(8.0, abs=0.6)
    assert (spot.contrast > 0) == (grey > 90)


def test_an_even_wall_has_no_spots():
    assert SIGHT.spots(spotted(0, 0, radius=0.0)) == []


def test_a_target_is_followed_and_its_loss_is_seen():
    target = SIGHT.begin(spotted(100, 90), 103, 92)
    for k in range(10):
        target = SIGHT.follow(target, spotted(100 + 3 * k, 90 + k))
    assert target.seen
    assert (target.u, target.v) == pytest.approx((127, 99), abs=0.4)
    lost = SIGHT.follow(target, spotted(20, 20))
    assert not lost.seen
    assert (lost.u, lost.v) == (target.u, target.v)


def test_no_pixel_is_outside_the_image():
    image = Picture().frame().image
    for u, v in ((-5.0, -5.0), (1e4, 1e4), (0.0, HEIGHT)):
        target = SIGHT.follow(SIGHT.begin(image, u, v), image)
        assert 0 <= target.u < WIDTH
        assert 0 <= target.v < HEIGHT
