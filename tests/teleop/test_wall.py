import math

import numpy as np

from minorloop.teleop.plant import View
from minorloop.teleop.wall import STEP, Wall
from minorloop.twins.picture import FOCAL, HEIGHT, LEVER, RADIUS, WIDTH, Picture

VIEW = View(width=WIDTH, height=HEIGHT, focal=FOCAL, lever=LEVER, radius=RADIUS)


def brightest(wall):
    """Where the nearer hole is; another one lies farther along."""
    wall.grey[round(0.04 / STEP) :] = 0
    row, column = np.unravel_index(np.argmax(wall.grey), wall.grey.shape)
    return 2 * math.pi * (column + 0.5) / wall.grey.shape[1], STEP * (row + 0.5)


def seen(pan, tilt, advance, roll):
    picture = Picture()
    picture.look(math.radians(pan), math.radians(tilt))
    picture.place(1e-3 * advance, math.radians(roll))
    return picture.frame().image


def test_the_hole_is_on_the_map_where_it_is_on_the_wall():
    for where in ((0.0, 0.0, 0.0, 0.0), (12.0, -6.0, 3.0, 10.0), (5.0, -8.0, 1.0, -20.0)):
        wall = Wall(VIEW, 0.1)
        wall.paint(seen(*where), where)
        phi, z = brightest(wall)
        assert abs(phi - 0.35) < 0.05
        assert abs(z - 0.030) < 6e-4


def test_a_worse_view_does_not_replace_a_better_one():
    wall = Wall(VIEW, 0.1)
    wall.paint(seen(12.0, -6.0, 8.0, 0.0), (12.0, -6.0, 8.0, 0.0))
    before = wall.grey[110:130].copy()
    wall.paint(np.zeros((HEIGHT, WIDTH), np.uint8), (0.0, 0.0, -25.0, 0.0))
    np.testing.assert_array_equal(wall.grey[110:130], before)


def test_the_window_goes_along_and_stays_on_the_map():
    wall = Wall(VIEW, 0.3)
    for advance in (-50.0, 0.0, 80.0, 1e4):
        grey, first, last = wall.window(advance)
        assert grey.shape[0] == round((last - first) / (1e3 * STEP))
        assert first >= 0
        assert last <= 300
    assert len(wall.seen) == 1


def test_beyond_the_end_nothing_is_painted():
    wall = Wall(VIEW, 0.1)
    wall.paint(seen(0, 0, 0, 0), (0.0, 0.0, 500.0, 0.0))
    assert not wall.grey.any()
