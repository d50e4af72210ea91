"""The largest circle on the wall that a head can go round."""

from dataclasses import replace

import numpy as np
import pytest

from minorloop.head.geometry import wall_point
from minorloop.head.studies.head_camera import HOLE, RADIUS
from minorloop.head.studies.wall_reach import LEAST, joints_round, wall_reach
from minorloop.head.twins.pipe import Pipe

HIGHEST = 57.0


def test_the_circle_of_the_study_is_within_reach_and_one_that_is_wider_than_the_largest_is_not():
    found = wall_reach(HOLE, HIGHEST)
    assert 2 * RADIUS < found.across < 10e-3
    assert joints_round(HOLE, RADIUS).min() > LEAST
    assert joints_round(HOLE, 0.51 * found.across).min() < LEAST


def test_a_small_stroke_limits_the_circle_too():
    assert wall_reach(HOLE, 20.0).across < 2 * RADIUS
    assert wall_reach(HOLE, 10.0).across == 0.0


def test_farther_along_the_pipe_circles_are_larger_and_an_angle_is_more_of_the_wall():
    near, far = wall_reach(HOLE, HIGHEST), wall_reach(replace(HOLE, z=30e-3), HIGHEST)
    assert far.across > 20e-3
    assert far.per_degree > 2 * near.per_degree


def test_the_way_along_the_wall_for_a_degree_is_that_of_a_line_of_sight():
    found = wall_reach(HOLE, HIGHEST)
    z = found.z + found.across / 2
    ways = np.array([wall_point(HOLE.phi, each, Pipe.radius) for each in (z, z + 1e-5)])
    one, other = ways / np.linalg.norm(ways, axis=1, keepdims=True)
    turned = np.degrees(np.linalg.norm(one - other))
    assert 1e-5 / turned == pytest.approx(found.per_degree, rel=1e-3)
