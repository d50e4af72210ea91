import math

import numpy as np

from minorloop.twins.picture import FOCAL, HEIGHT, LEVER, RADIUS, WIDTH, Picture


def centre_of_hole(picture):
    image = picture.frame().image.astype(float)
    rows, columns = np.nonzero(image[:, WIDTH // 2 :] > 240)
    return columns.mean() + WIDTH // 2, rows.mean()


def test_the_hole_is_where_a_pinhole_sees_it():
    picture = Picture()
    x, y, z = RADIUS * math.cos(0.35), RADIUS * math.sin(0.35), 0.030 - LEVER
    expected = (WIDTH - 1) / 2 + FOCAL * x / z, (HEIGHT - 1) / 2 + FOCAL * y / z
    np.testing.assert_allclose(centre_of_hole(picture), expected, atol=0.7)


def test_to_pan_right_moves_the_hole_left_and_to_tilt_up_moves_it_down():
    picture = Picture()
    u, v = centre_of_hole(picture)
    picture.look(math.radians(5.0), math.radians(5.0))
    after = centre_of_hole(picture)
    assert after[0] < u - 10
    assert after[1] > v + 10


def test_pictures_are_repeatable_and_a_tick_apart():
    one, other = Picture(3), Picture(3)
    first, second = one.frame(), one.frame()
    np.testing.assert_array_equal(first.image, other.frame().image)
    assert (first.image.shape, first.image.dtype) == ((HEIGHT, WIDTH), np.uint8)
    assert second.t - first.t == 0.04
    assert (first.image != second.image).any()
