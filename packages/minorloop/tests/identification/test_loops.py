from itertools import pairwise

import numpy as np
import pytest

from minorloop.identification.curves import Curves
from minorloop.identification.loops import closed_loops, loop_areas

WHOLE = Curves.whole("negative")


def path(*turns, each=20):
    """Straight ways between turning points."""
    ways = [np.linspace(a, b, each, endpoint=False) for a, b in pairwise(turns)]
    return np.concatenate([*ways, turns[-1:]])


def loops_of(u, curves=WHOLE, scored=None):
    every = np.ones(u.size, dtype=bool) if scored is None else scored
    return closed_loops(u, every, curves).tolist()


@pytest.mark.parametrize(
    ("turns", "expected"),
    [
        ((-1, 1, -1), [[0, 40]]),
        ((-1, 1, -0.5, 0.5, -1), [[40, 73], [0, 80]]),
        ((0, 1, -1, 1), [[20, 60]]),
        ((0, 1, -1, 0.8, -0.6, 0.4), []),  # decays
        ((-0.1, 0.2, -0.3, 0.4, -1), [[20, 54]]),  # grows
        ((-1, 1, -0.995, 1), [[0, 40]]),  # comes back nearly
    ],
)
def test_a_loop_closes_where_the_input_comes_back_to_a_turning_point(turns, expected):
    assert loops_of(path(*turns)) == expected


def test_loops_that_are_narrow_short_or_not_measured_are_left_out():
    assert loops_of(path(-1, 1, 0.99, 1, -1)) == [[0, 80]]
    assert loops_of(path(-1, 1, -1, each=3)) == []
    assert loops_of(np.array([-1.0, 1.0, -1.0])) == []
    scored = np.arange(81) != 30
    assert loops_of(path(-1, 1, -1, 1, -1), scored=scored) == [[40, 80]]


def test_a_loop_does_not_reach_into_the_next_curve():
    u = np.concatenate([path(-1, 1, -1), path(0, 1, 0.5), path(0.5, 1, 0.2, 1)])
    assert loops_of(u, Curves(np.array([0, 41, 82]), "negative")) == [[0, 40], [102, 142]]


def test_areas_are_those_of_ellipses_and_positive_where_the_output_is_late():
    angle = np.linspace(0, 2 * np.pi, 2001)
    u, late = np.cos(angle), 5.0 + 2.0 * np.cos(angle - 0.3)
    assert loop_areas(u, late, np.array([[0, 2000]])) == pytest.approx(
        2 * np.pi * np.sin(0.3), rel=1e-5
    )
    early = np.where(angle < 7, 5.0 + 2.0 * np.cos(angle + 0.3), np.nan)
    assert loop_areas(u, early, np.array([[0, 2000]])) == pytest.approx(
        -2 * np.pi * np.sin(0.3), rel=1e-5
    )
    assert loop_areas(u, late, np.zeros((0, 2), dtype=int)).size == 0
